"""Pause, go on, cancel, stop: asked by any thread, heard by the one that captures and by the rig.

A rig or camera in the midst of an order is told at once; everything else is noticed at the capture's next step.
"""

import enum
import threading

from app.capture.status import Phase
from engine.errors import Cancelled
from hardware.rig import Rig

IN_MOTION = frozenset({Phase.HOMING, Phase.MOVING})


class Asked(enum.IntEnum):
    """How a capture shall end, if before its last pose."""

    NOTHING = 0
    CANCEL = 1  # after the exposure under way
    STOP = 2  # at once


class Control:
    """What was asked so far, and of which rig; every method may be called from any thread."""

    def __init__(self) -> None:
        self.rig: Rig | None = None  # the one in use, as the capture says
        self.phase = Phase.PREPARING  # likewise
        self._changed = threading.Condition()
        self._paused = self._held = False
        self._asked = Asked.NOTHING

    # ---- asking

    def pause(self) -> None:
        """Wait before the next pose; a rig that moves and can hold does so at once.

        Raises:
            HardwareError: the rig could not be told; the capture pauses at the next pose all the same.
        """
        self._paused = True
        rig = self.rig
        if rig is not None and self.phase is Phase.MOVING and rig.motion.features.holds:
            self._held = True
            rig.motion.hold()

    def resume(self) -> None:
        """Go on after `pause`.

        Raises:
            HardwareError: the rig that was held could not be told.
        """
        with self._changed:
            self._paused = False
            self._changed.notify_all()
        if self._held and self.rig is not None:
            self._held = False
            self.rig.motion.resume()

    def cancel(self) -> None:
        """End after the exposure under way, which is still kept; a rig that turns is stopped now.

        Raises:
            HardwareError: the stop did not reach the rig.
        """
        self._end(Asked.CANCEL)
        rig, phase = self.rig, self.phase
        if rig is None:
            return
        # A camera that cannot be set waits for a person to press its button, perhaps for ever.
        waits = phase is Phase.EXPOSING and not rig.camera.features.sets_exposure
        if phase in IN_MOTION or waits:
            rig.stop()

    def stop(self) -> None:
        """End at once: rig and camera are stopped, the pose under way is dropped.

        Raises:
            HardwareError: the stop did not reach the rig.
        """
        self._end(Asked.STOP)
        if self.rig is not None:
            self.rig.stop()

    def _end(self, how: Asked) -> None:
        """What was asked never becomes less."""
        with self._changed:
            self._asked = max(self._asked, how)
            self._changed.notify_all()

    # ---- hearing

    @property
    def paused(self) -> bool:
        return self._paused

    @property
    def asked(self) -> Asked:
        return self._asked

    def check(self) -> None:
        """
        Raises:
            Cancelled: the end was asked for.
        """
        if self._asked:
            raise Cancelled("the capture was cancelled; what was taken is kept")

    def wait_while_paused(self) -> None:
        """Return at once unless paused.

        Raises:
            Cancelled: the end was asked for.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._asked or not self._paused)
        self.check()

    def sleep(self, seconds: float) -> None:
        """Let time pass.

        Raises:
            Cancelled: the end was asked for, before or meanwhile.
        """
        with self._changed:
            self._changed.wait_for(lambda: bool(self._asked), timeout=seconds)
        self.check()
