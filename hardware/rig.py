"""A rig: what turns, what photographs, where the one sits on the other, and the one lock that orders go through.

A whole pose is one order, so that nothing turns the rig between its move and its last photograph. `stop` takes no
lock: it reaches the wire whatever else is going on. Times are seconds, angles degrees.
"""

import contextlib
import enum
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from hardware.errors import ExposureError, HardwareError, NoZeroError, StoppedError
from hardware.interfaces import Angles, Bracket, Camera, Frame, Geometry, Motion, Taken

AGAINS, AGAIN_S = 50, 0.1  # a stop is repeated so often, as long as the order it was to end goes on


class Step(enum.Enum):
    """The parts of a pose."""

    MOVE = enum.auto()  # and settle
    EXPOSE = enum.auto()
    FETCH = enum.auto()


@dataclass(frozen=True, slots=True)
class Shot:
    """One pose as it was taken: its photographs in the order of the bracket, and where the rig said it stood."""

    frames: tuple[Frame, ...]
    angles: Angles | None  # None: nobody can tell


def find_zero(motion: Motion, at_zero: bool, order: str, home: Callable[[], Angles] | None = None) -> Angles:
    """Home a rig that does not know where it stands; one that cannot find its zero must have been turned there.

    Args:
        at_zero: a person says that it stands at its zero.
        order: what to give again with `--at-zero`, for the message.
        home: homes it; `motion.home` if None.

    Raises:
        NoZeroError: it cannot find its zero, and nobody says that it stands there; nothing moved.
        HardwareError: as `Motion.home` says.
    """
    if not motion.features.homes and not at_zero:
        raise NoZeroError(
            f"{motion.name}: does not know its position and cannot find its zero by itself; turn it there by"
            f" hand, then {order} with --at-zero"
        )
    return (home or motion.home)()


class _Order:
    """One order that somebody gave, from the moment they asked for it."""

    def __init__(self) -> None:
        self.stopped, self.over = threading.Event(), threading.Event()


class Rig:
    """One set-up. Any thread may give an order; while one is under way, others wait."""

    def __init__(
        self,
        motion: Motion,
        camera: Camera,
        geometry: Geometry | None = None,
        settle_s: float = 0.0,
        wait: Callable[[threading.Event, float], object] = threading.Event.wait,
    ):
        """
        Args:
            geometry: None where nobody measured it.
            settle_s: from standing still to the first exposure, for what sways; also the pause before each
                shot of a rig without axes.
            wait: lets so many seconds pass, fewer if the event is set.
        """
        self.motion, self.camera, self.geometry, self.settle_s = motion, camera, geometry, settle_s
        self._wait = wait
        self._lock = threading.Lock()
        self._orders: list[_Order] = []  # those that wait for their turn too
        self._running: _Order | None = None

    @property
    def name(self) -> str:
        return f"{self.motion.name} with {self.camera.name}"

    def take(
        self,
        angles: Angles | None,
        bracket: Bracket,
        folder: Path,
        enter: Callable[[Step], None] = lambda step: None,
    ) -> Shot:
        """Go there, settle, take the bracket and put its files into `folder`, under the camera's own names.

        Args:
            angles: None: wherever the person holds it.
            enter: hears each step before it begins; may raise to end the order there.

        Raises:
            StoppedError: `stop` was called meanwhile.
            HardwareError: as `Motion.move`, `Camera.expose` and `Camera.download` say; `folder` may then hold
                photographs of a bracket that does not count.
        """
        with self._order() as order:
            enter(Step.MOVE)
            reached = self._go(angles, order)
            enter(Step.EXPOSE)
            taken = self.camera.expose(bracket)
            self._check(order)
            enter(Step.FETCH)
            return Shot(self._fetch(taken, folder, order), reached)

    def go(self, angles: Angles | None) -> Angles | None:
        """Go there and wait until nothing sways; returns where the rig says it stands.

        Raises:
            HardwareError: as `Motion.move` says; StoppedError also for a stop while it settled.
        """
        with self._order() as order:
            return self._go(angles, order)

    def home(self, enter: Callable[[], None] = lambda: None) -> Angles:
        """See `Motion.home`; `enter` hears when its turn has come, and may raise to end it there."""
        with self._order():
            enter()
            return self.motion.home()

    def stop(self) -> None:
        """Stop what moves and give up waiting for the camera, at once, from any thread.

        Raises:
            HardwareError: the rig could not be told; the camera was stopped all the same.
        """
        going_on = [order for order in tuple(self._orders) if not order.stopped.is_set()]
        self._end_orders()
        running = self._running
        try:
            self._halt()
        finally:
            if running in going_on:
                # It may just have been on its way from its last look at `stopped` into the driver.
                insist = threading.Thread(target=self._insist, args=[running], name="insist on stop")
                insist.daemon = True
                insist.start()

    def close(self) -> None:
        """Stop and let go of both; may be called twice."""
        self._end_orders()
        try:
            self.motion.close()
        finally:
            self.camera.close()

    def _end_orders(self) -> None:
        for order in tuple(self._orders):
            order.stopped.set()

    def _halt(self) -> None:
        try:
            self.motion.stop()
        finally:
            self.camera.stop()

    def _insist(self, order: _Order) -> None:
        for _ in range(AGAINS):
            if order.over.wait(AGAIN_S):
                return
            with contextlib.suppress(HardwareError):
                self._halt()

    def _check(self, order: _Order) -> None:
        if order.stopped.is_set():
            raise StoppedError(f"{self.motion.name}: stopped on request; start again to go on")

    def _go(self, angles: Angles | None, order: _Order) -> Angles | None:
        reached = None
        if not self.motion.features.axes:
            self.motion.move(Angles(0.0))  # the next place, wherever that is
        elif angles is not None:
            reached = self.motion.move(angles)
        self._check(order)
        if self.settle_s > 0:
            self._wait(order.stopped, self.settle_s)
            self._check(order)
        return reached

    def _fetch(self, taken: Sequence[Taken], folder: Path, order: _Order) -> tuple[Frame, ...]:
        names = [PurePosixPath(one.handle).name for one in taken]
        if len(set(names)) != len(names):
            raise ExposureError(
                f"{self.camera.name}: named two photographs of one bracket the same ({', '.join(names)}); "
                "set it to number its files"
            )
        frames = []
        for one, name in zip(taken, names, strict=True):
            frames.append(self.camera.download(one, folder / name))
            self._check(order)
        return tuple(frames)

    @contextlib.contextmanager
    def _order(self) -> Iterator[_Order]:
        """Wait for one's turn.

        Raises:
            StoppedError: `stop` was called since one asked for it.
        """
        order = _Order()
        self._orders.append(order)
        try:
            with self._lock:
                self._running = order
                try:
                    self._check(order)
                    yield order
                finally:
                    self._running = None
        finally:
            self._orders.remove(order)
            order.over.set()
