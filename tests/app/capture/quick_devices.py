"""A rig and a camera in memory that take no time, leave real RAW files, and fail when a test says so.

`Faults` decides at every order; the table knows whether it is homed, the camera numbers its photographs and writes
the angles at which it stood into their pixels, so that a test can tell a mislabelled shot.
"""

import datetime
import hashlib
import itertools
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from engine.io.raw import read_mosaic
from hardware.errors import (
    DisconnectedError,
    ExposureError,
    HardwareError,
    LimitError,
    PositionLostError,
    StoppedError,
)
from hardware.interfaces import (
    Angles,
    Axis,
    Bracket,
    Camera,
    CameraFeatures,
    CameraStatus,
    Exposure,
    Frame,
    Motion,
    MotionFeatures,
    MotionStatus,
    State,
    Taken,
)
from hardware.rig import Rig
from hardware.virtual import dng, sensor

SIZE = 32  # pixels, both ways
BLACK, WHITE = 512, 16383
Fault = Callable[[str], None]  # called with the order's name before it is obeyed; raises to fail it


class Table(Motion):
    """Pan and tilt, at once where it was sent."""

    def __init__(self, fault: Fault = lambda order: None, tilts: bool = True, homes: bool = True):
        self._fault, self._tilts, self._homes = fault, tilts, homes
        self.state = State.UNHOMED
        self.angles = Angles(0.0)
        self.moves: list[Angles] = []
        self.homings = self.stops = self.holds = self.deaf_stops = 0
        self.off_deg = 0.0  # how far from where it was sent it stands, by its own account
        self._heard_stop = False
        self.moving, self.may_move = threading.Event(), threading.Event()
        self.may_move.set()

    @property
    def name(self) -> str:
        return "quick table"

    @property
    def features(self) -> MotionFeatures:
        axes = [Axis("pan", -360.0, 720.0, 0.01, 1e6)] + [Axis("tilt", -80.0, 80.0, 0.01, 1e6)] * self._tilts
        return MotionFeatures(tuple(axes), True, self._homes, True, True)

    def status(self) -> MotionStatus:
        return MotionStatus(self.state, self.angles)

    def home(self) -> Angles:
        try:
            self._fault("home")
        except HardwareError:
            self.state = State.UNHOMED
            raise
        self.homings += 1
        self.state, self.angles = State.IDLE, Angles(0.0)
        return self.angles

    def move(self, angles: Angles) -> Angles:
        if abs(angles.tilt_deg) > 80:
            raise LimitError(f"tilt {angles.tilt_deg:g} is beyond 80")
        if self.state is not State.IDLE:
            raise PositionLostError("the table is not homed; home it first")
        self._heard_stop = False
        self.moving.set()
        while not self.may_move.wait(0.01) and not self._heard_stop:
            pass
        self.moving.clear()
        if self._heard_stop:
            raise StoppedError("the table was stopped")
        try:
            self._fault("move")
        except HardwareError as error:
            if isinstance(error, PositionLostError | DisconnectedError):
                self.state = State.UNHOMED
            raise
        self.moves.append(angles)
        self.angles = angles
        return Angles(angles.pan_deg + self.off_deg, angles.tilt_deg)

    def stop(self) -> None:
        self.stops += 1
        self._heard_stop = self.stops > self.deaf_stops

    def hold(self) -> None:
        self.holds += 1
        self.may_move.clear()

    def resume(self) -> None:
        self.may_move.set()

    def close(self) -> None:
        self.state = State.OFFLINE


def _counts(angles: Angles) -> tuple[int, int]:
    """Angles as two counts, in tenths of a degree."""
    return BLACK + round(angles.pan_deg * 10) % 3600, BLACK + 1000 + round(angles.tilt_deg * 10)


def stood_at(file: Path, angles: Angles) -> bool:
    """Was this photograph taken there?"""
    return tuple(read_mosaic(file).counts[0, :2].tolist()) == _counts(angles)


class Body(Camera):
    """Takes small noisy RAW files whose pixels tell where the table stood; bare bytes if `suffix` is not .dng."""

    def __init__(
        self,
        table: Table,
        fault: Fault = lambda order: None,
        suffix: str = ".dng",
        size: int = SIZE,
        told_bytes: int | None = None,
        number: Callable[[], int] | None = None,
    ):
        self._table, self._fault, self._suffix, self._size = table, fault, suffix, size
        self._shots: dict[str, dng.Photograph] = {}
        self._told_bytes = told_bytes
        self._next = number or counter()
        self.stale = self.swapped = 0  # how many of the next brackets are handed over wrongly
        self._before: tuple[Taken, ...] = ()
        self.dial_s = 0.02  # where its shutter stands; a bracket leaves it at its last exposure
        self.fails_at: dict[Angles | None, int] = {}  # how often still, by where the table stands
        self.forgotten: list[str] = []
        self.spoil: Callable[[Path], None] = lambda path: None  # what the cable does to a file
        self.closed = False

    @property
    def name(self) -> str:
        return "quick camera"

    @property
    def features(self) -> CameraFeatures:
        return CameraFeatures(
            "quick camera", (), (), (), self._suffix, True, self._told_bytes or 2 * self._size**2 + 1000
        )

    def status(self) -> CameraStatus:
        return CameraStatus(not self.closed)

    def expose(self, bracket: Bracket) -> tuple[Taken, ...]:
        self._fault("expose")
        if self.fails_at.get(self._table.angles):
            self.fails_at[self._table.angles] -= 1
            raise ExposureError("it would not focus")
        shutter_s = bracket.base.shutter_s or self.dial_s
        if self.stale and self._before:
            self.stale -= 1
            return self._before
        taken = []
        for ev in bracket.stops:
            number = self._next()
            exposure = Exposure(shutter_s * 2.0**ev, bracket.base.iso or 100, 8.0)
            self.dial_s = shutter_s * 2.0**ev
            handle = f"/card/IMG_{number:04d}{self._suffix.upper()}"
            self._shots[handle] = self._photograph(exposure, number)
            taken.append(Taken(handle, ev, exposure))
        if self.swapped:
            self.swapped -= 1
            taken = [replace(one, ev=-one.ev) for one in taken]
        self._before = tuple(taken)
        return self._before

    def _photograph(self, exposure: Exposure, number: int) -> dng.Photograph:
        assert exposure.shutter_s is not None
        assert exposure.iso is not None
        noise = np.random.default_rng().integers(1900, 2100, (self._size, self._size))
        mosaic = noise.astype(np.uint16)
        mosaic[0, :2] = _counts(self._table.angles)
        moment = datetime.datetime(2026, 1, 1) + datetime.timedelta(seconds=number)
        return dng.Photograph(
            mosaic, BLACK, WHITE, sensor.Sensor().camera_from_xyz, (0.5, 1.0, 0.6), exposure.shutter_s,
            exposure.iso, 8.0, moment,
        )  # fmt: skip

    def download(self, taken: Taken, to: Path) -> Frame:
        self._fault("download")
        photograph = self._shots[taken.handle]
        if self._suffix == ".dng":
            dng.write(to, photograph)
        else:
            to.write_bytes(photograph.mosaic.tobytes())
        with to.open("rb") as file:
            os.fsync(file.fileno())
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        count = to.stat().st_size
        self.spoil(to)
        return Frame(to, Path(taken.handle).name, sha256, count, taken)

    def forget(self, taken: Sequence[Taken]) -> None:
        self._fault("forget")
        for one in taken:
            self.forgotten.append(one.handle)
            if self.stale == 0:
                self._shots.pop(one.handle, None)

    def stop(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True


def counter() -> Callable[[], int]:
    """Numbers photographs, also for the cameras that follow."""
    numbers = itertools.count(1)
    return lambda: next(numbers)


def rig(fault: Fault = lambda order: None, tilts: bool = True, homes: bool = True, **options: Any) -> Rig:
    """`options` are the camera's."""
    table = Table(fault, tilts, homes)
    return Rig(table, Body(table, fault, **options))
