"""Bring rig and camera back to where another try makes sense, within bounds.

A rig that was lost is opened again; one that does not know its position is homed before it moves; nothing is
moved while the rig still turns. Every loop here ends: with a rig that is ready, or with the error that says why not.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from app.capture.control import Control
from app.capture.status import Phase
from hardware.errors import DisconnectedError, ExposureError, HardwareError, PositionLostError
from hardware.interfaces import State
from hardware.rig import Rig, find_zero


@dataclass(frozen=True, slots=True)
class Patience:
    """How often and how long to try before giving up."""

    tries: int = 3  # of one pose in one round
    in_a_row: int = 3  # poses that failed one after the other stop the capture
    recoveries: int = 3  # to get rig and camera ready once
    reopenings: int = 5  # of ports that are gone
    wait_s: float = 0.5  # before the second try; doubles with each further one
    poll_s: float = 0.2
    still_s: float = 60.0  # for a rig to stop turning by itself
    ready_s: float = 30.0  # for a camera to be ready again


class Recovery:
    """Knows how to get ready again; one per capture."""

    def __init__(
        self,
        control: Control,
        patience: Patience,
        reopen: Callable[[], Rig],
        enter: Callable[[Phase, str], None],
        note: Callable[..., None],
        zero_here: bool,
    ) -> None:
        """
        Args:
            enter: tells a phase and its message, or raises Cancelled.
            note: writes the journal.
            zero_here: a rig that cannot find its zero by itself stands there now.
        """
        self._zero_here = zero_here
        self._control, self._patience, self._reopen = control, patience, reopen
        self._enter, self._note = enter, note

    def ready(self, rig: Rig, error: HardwareError | None = None) -> Rig:
        """The rig, connected, standing still, knowing its position, with a camera that is ready.

        Args:
            error: what just failed; None at the start.

        Raises:
            HardwareError: it cannot be brought there.
            Cancelled: the end was asked for.
        """
        for attempt in range(1, self._patience.recoveries + 1):
            try:
                if isinstance(error, DisconnectedError) or rig.motion.status().state is State.OFFLINE:
                    rig = self._opened_again(rig, error)
                self._stand_still(rig)
                state = rig.motion.status().state
                if state in (State.UNHOMED, State.FAULT) or isinstance(error, PositionLostError):
                    self._home(rig)
                self._camera_ready(rig)
                return rig
            except HardwareError as failed:
                self._control.check()
                self._note("failed", step="getting ready", attempt=attempt, reason=str(failed))
                last_try = attempt == self._patience.recoveries
                if last_try or not failed.transient:
                    raise
                error = failed
                self._control.sleep(self._patience.wait_s * 2 ** (attempt - 1))
        raise AssertionError("the last try returns or raises")

    def _opened_again(self, rig: Rig, error: HardwareError | None) -> Rig:
        lost = error or DisconnectedError(
            f"{rig.motion.name}: does not answer; check cable and power, then go on"
        )
        with contextlib.suppress(HardwareError):
            rig.close()
        for attempt in range(self._patience.reopenings):
            self._enter(Phase.RECOVERING, f"opening rig and camera again after: {lost}")
            self._control.sleep(self._patience.wait_s * 2**attempt)
            try:
                rig = self._reopen()
            except HardwareError as failed:
                self._note("failed", step="opening again", attempt=attempt + 1, reason=str(failed))
                if attempt + 1 == self._patience.reopenings:
                    raise
            else:
                self._note("reconnected", rig=rig.motion.name, camera=rig.camera.name)
                return rig
        raise AssertionError("the last try returns or raises")

    def _stand_still(self, rig: Rig) -> None:
        """Wait for a motion that nobody waits for any more; stop it where it takes too long."""
        polls = max(1, round(self._patience.still_s / self._patience.poll_s))
        for _ in range(polls):
            status = rig.motion.status()
            if status.state not in (State.MOVING, State.HOMING):
                break
            self._enter(Phase.RECOVERING, "waiting for the rig to stand still")
            self._control.sleep(self._patience.poll_s)
        else:
            rig.motion.stop()
            raise PositionLostError(
                f"{rig.motion.name}: still turns after {self._patience.still_s:g} s and was stopped"
            )
        if status.state is State.HELD:
            rig.motion.stop()  # whoever held it forgot; what it was doing then is of no use now

    def _home(self, rig: Rig) -> None:
        features = rig.motion.features
        if not features.axes or not features.automatic:
            return  # a person turns it and knows where it stands
        at_zero, self._zero_here = self._zero_here, False
        enter = partial(self._enter, Phase.HOMING, "finding the rig's zero")
        angles = find_zero(rig.motion, at_zero, "resume", lambda: rig.home(enter))
        self._note("homed", pan_deg=angles.pan_deg, tilt_deg=angles.tilt_deg)

    def _camera_ready(self, rig: Rig) -> None:
        message = ""
        polls = max(1, round(self._patience.ready_s / self._patience.poll_s))
        for _ in range(polls):
            status = rig.camera.status()
            if status.ready:
                return
            message = status.message
            self._enter(Phase.RECOVERING, f"waiting for the camera: {message or 'not ready'}")
            self._control.sleep(self._patience.poll_s)
        raise ExposureError(
            f"{rig.camera.name}: not ready after {self._patience.ready_s:g} s"
            f" ({message or 'it does not say why'}); check battery, card and focus switch"
        )
