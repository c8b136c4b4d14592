"""Rigs without a motor: a person turns the stand when asked (`Manual`), or holds camera and object (`Handheld`).

A `Manual` rig asks once per pose and waits until the person says it is done, or `stop` is called; where it stands is
what was asked for, and nothing measures it. Angles are degrees.
"""

import math
import select
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TextIO

from hardware.errors import DisconnectedError, LimitError, StoppedError
from hardware.interfaces import Angles, Axis, Motion, MotionFeatures, MotionStatus, State

POINTING_DEG = 1.0  # how finely a person sets a scale
TURNING_DEG_S = 30.0
TILT_DEG = (-90.0, 90.0)
_SLICE_S = 0.1  # how soon a question in the terminal is withdrawn


@dataclass(frozen=True, slots=True)
class Request:
    """What a person is asked to do; answer it from any thread, once. Later answers count for nothing."""

    text: str
    angles: Angles
    _over: threading.Event = field(default_factory=threading.Event)
    _outcome: list[str] = field(default_factory=list)  # why it is not done; empty if it is

    def confirm(self) -> None:
        """It is done."""
        self._over.set()

    def withdraw(self, reason: str) -> None:
        """It will not be done."""
        if not self._over.is_set():
            self._outcome.append(reason)
        self._over.set()

    @property
    def is_over(self) -> bool:
        """Answered or withdrawn: there is nothing to ask any more."""
        return self._over.is_set()

    def wait(self) -> str:
        """Until it is over; why it was not done, "" if it was."""
        self._over.wait()
        return self._outcome[0] if self._outcome else ""


Ask = Callable[[Request], None]  # show the request; may wait for the answer or come back at once


def ask_in_terminal(request: Request, source: TextIO | None = None, screen: TextIO | None = None) -> None:
    """Show a request and wait for Enter, or until it is withdrawn; without a keyboard it withdraws it."""
    keyboard: TextIO = source or sys.stdin
    print(f"{request.text}, then press Enter", file=screen or sys.stderr, flush=True)
    while not request.is_over:
        ready, _, _ = select.select([keyboard.fileno()], [], [], _SLICE_S)
        if ready:
            if keyboard.readline():
                request.confirm()
            else:
                request.withdraw("there is no keyboard to confirm it on")


class Manual(Motion):
    """A stand with a scale, turned by hand; with or without a tilt axis."""

    def __init__(self, ask: Ask, tilt_deg: tuple[float, float] | None = TILT_DEG):
        """
        Args:
            tilt_deg: lowest and highest tilt; None for a stand that only turns.
        """
        self._ask, self._tilt_deg = ask, tilt_deg
        self._stands: Angles | None = None
        self._request: Request | None = None
        self._answering = threading.Lock()  # between `stop` and a request that is about to be made
        self._closed = False

    @property
    def name(self) -> str:
        return "a stand turned by hand"

    @property
    def features(self) -> MotionFeatures:
        axes = [Axis("pan", None, None, POINTING_DEG, TURNING_DEG_S)]
        if self._tilt_deg:
            axes.append(Axis("tilt", *self._tilt_deg, POINTING_DEG, TURNING_DEG_S))
        return MotionFeatures(tuple(axes), automatic=False, homes=True, holds=False, reports_angles=False)

    def status(self) -> MotionStatus:
        request = self._request
        if self._closed:
            return MotionStatus(State.OFFLINE, None, "closed")
        if request is not None:
            return MotionStatus(State.MOVING, self._stands, request.text)
        return MotionStatus(State.IDLE, self._stands)

    def home(self) -> Angles:
        return self._turned("Turn the stand to the zero of its scale", Angles(0.0))

    def move(self, angles: Angles) -> Angles:
        if not math.isfinite(angles.pan_deg) or not math.isfinite(angles.tilt_deg):
            raise LimitError(f"{angles.pan_deg:g}, {angles.tilt_deg:g} are no angles; correct the plan")
        if self._tilt_deg is None and abs(angles.tilt_deg) > 1e-6:
            raise LimitError(f"tilt {angles.tilt_deg:g} degrees: this stand only turns; change the plan")
        if self._tilt_deg is not None and not self._tilt_deg[0] <= angles.tilt_deg <= self._tilt_deg[1]:
            low, high = self._tilt_deg
            raise LimitError(
                f"tilt {angles.tilt_deg:g} degrees is beyond {low:g} to {high:g}; change the plan"
            )
        text = f"Turn the stand to pan {angles.pan_deg % 360.0:g} degrees"
        return self._turned(text + (f", tilt {angles.tilt_deg:g} degrees" if self._tilt_deg else ""), angles)

    def _turned(self, text: str, angles: Angles) -> Angles:
        request = Request(text, angles)
        with self._answering:
            if self._closed:
                raise DisconnectedError(f"{self.name}: was closed; open it again")
            self._request = request
        try:
            self._ask(request)
            reason = request.wait()
        finally:
            self._request = None
        if reason:
            raise StoppedError(f"{self.name}: was not turned ({reason}); go on when somebody can turn it")
        self._stands = angles
        return angles

    def stop(self) -> None:
        with self._answering:
            if self._request is not None:
                self._request.withdraw("stopped on request")

    def hold(self) -> None:
        """A person pauses without being told."""

    def resume(self) -> None:
        """See `hold`."""

    def close(self) -> None:
        self.stop()
        self._closed = True


class Handheld(Motion):
    """Nothing turns and nobody is asked: a person holds camera and object, and the camera takes what there is."""

    def __init__(self) -> None:
        self._closed = False

    @property
    def name(self) -> str:
        return "handheld"

    @property
    def features(self) -> MotionFeatures:
        return MotionFeatures((), automatic=False, homes=False, holds=False, reports_angles=False)

    def status(self) -> MotionStatus:
        return MotionStatus(State.OFFLINE if self._closed else State.IDLE, None)

    def home(self) -> Angles:
        return self.move(Angles(0.0))

    def move(self, angles: Angles) -> Angles:
        if self._closed:
            raise DisconnectedError("handheld: was closed; open it again")
        if not (abs(angles.pan_deg) < 1e-6 and abs(angles.tilt_deg) < 1e-6):
            raise LimitError(
                f"pan {angles.pan_deg:g}, tilt {angles.tilt_deg:g} degrees: nothing turns here; use a free plan"
            )
        return angles

    def stop(self) -> None:
        """Nothing moves."""

    def hold(self) -> None:
        """Nothing moves."""

    def resume(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        self._closed = True
