"""A rig: what turns, what photographs, where the one sits on the other, and the one lock that orders go through.

`stop` takes no lock: it reaches the wire whatever else is going on. Times are seconds, angles degrees.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from hardware.errors import ExposureError, HardwareError, StoppedError
from hardware.interfaces import Angles, Bracket, Camera, Frame, Geometry, Motion, Taken

AGAIN_S = 0.1  # after a stop, if the order it was to end has not ended


@dataclass(frozen=True, slots=True)
class Shot:
    """One pose as it was taken: its photographs in the order of the bracket, and where the rig said it stood."""

    frames: tuple[Frame, ...]
    angles: Angles | None  # None: nobody can tell


class Rig:
    """One set-up. Any thread may give an order; while one is under way, others wait."""

    def __init__(
        self,
        motion: Motion,
        camera: Camera,
        geometry: Geometry | None = None,
        settle_s: float = 0.0,
        sleep: Callable[[float], None] = time.sleep,
    ):
        """
        Args:
            geometry: None where nobody measured it.
            settle_s: from standing still to the first exposure, for what sways; also the pause before each
                shot of a rig without axes.
        """
        self.motion, self.camera, self.geometry, self.settle_s = motion, camera, geometry, settle_s
        self._sleep = sleep
        self._lock = threading.Lock()
        self._stops = 0
        self._running: object = None  # the order under way

    @property
    def name(self) -> str:
        return f"{self.motion.name} with {self.camera.name}"

    def take(self, angles: Angles | None, bracket: Bracket, folder: Path) -> Shot:
        """Go there, settle, take the bracket and put its files into `folder`, under the camera's own names.

        `angles` None: wherever the person holds it.

        Raises:
            StoppedError: `stop` was called meanwhile.
            HardwareError: as `Motion.move`, `Camera.expose` and `Camera.download` say; `folder` may then hold
                photographs of a bracket that does not count.
        """
        with self._order() as check:
            reached = self._go(angles, check)
            taken = self.camera.expose(bracket)
            check()
            return Shot(self._fetch(taken, folder, check), reached)

    def go(self, angles: Angles | None) -> Angles | None:
        """Go there and wait until nothing sways; returns where the rig says it stands.

        Raises:
            HardwareError: as `Motion.move` says; StoppedError also for a stop while it settled.
        """
        with self._order() as check:
            return self._go(angles, check)

    def fetch(self, taken: Sequence[Taken], folder: Path) -> tuple[Frame, ...]:
        """Download photographs into `folder` under the camera's own names.

        Raises:
            ExposureError: two of them have the same name.
            HardwareError: as `Camera.download` says.
        """
        with self._order() as check:
            return self._fetch(taken, folder, check)

    def home(self) -> Angles:
        """See `Motion.home`."""
        with self._order():
            return self.motion.home()

    def stop(self) -> None:
        """Stop what moves and give up waiting for the camera, at once, from any thread.

        Raises:
            HardwareError: the rig could not be told; the camera was stopped all the same.
        """
        self._stops += 1
        running = self._running
        try:
            self.motion.stop()
        finally:
            self.camera.stop()
        if running is not None:
            # An order may just have been on its way from its last look at `_stops` into the driver.
            again = threading.Timer(AGAIN_S, self._stop_again, [running])
            again.daemon = True
            again.start()

    def close(self) -> None:
        """Stop and let go of both; may be called twice."""
        self._stops += 1
        try:
            self.motion.close()
        finally:
            self.camera.close()

    def _stop_again(self, running: object) -> None:
        if self._running is running:
            with contextlib.suppress(HardwareError):
                self.motion.stop()

    def _go(self, angles: Angles | None, check: Callable[[], None]) -> Angles | None:
        reached = None
        if not self.motion.features.axes:
            self.motion.move(Angles(0.0))  # the next place, wherever that is
        elif angles is not None:
            reached = self.motion.move(angles)
        check()
        if self.settle_s > 0:
            self._sleep(self.settle_s)
            check()
        return reached

    def _fetch(self, taken: Sequence[Taken], folder: Path, check: Callable[[], None]) -> tuple[Frame, ...]:
        names = [PurePosixPath(one.handle).name for one in taken]
        if len(set(names)) != len(names):
            raise ExposureError(
                f"{self.camera.name}: named two photographs of one bracket the same ({', '.join(names)}); "
                "set it to number its files"
            )
        frames = []
        for one, name in zip(taken, names, strict=True):
            frames.append(self.camera.download(one, folder / name))
            check()
        return tuple(frames)

    @contextlib.contextmanager
    def _order(self) -> Iterator[Callable[[], None]]:
        """Wait for one's turn; yields what raises StoppedError if `stop` was called since one asked for it."""
        began = self._stops

        def check() -> None:
            if self._stops != began:
                raise StoppedError(f"{self.motion.name}: stopped on request; start again to go on")

        with self._lock:
            self._running = check
            try:
                check()
                yield check
            finally:
                self._running = None
