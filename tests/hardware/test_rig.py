import hashlib
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from hardware.errors import DisconnectedError, ExposureError, HardwareError, PositionLostError, StoppedError
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
from hardware.rig import Rig, Step
from tests.hardware.contracts.orders import PATIENCE_S, Order, wait

BRACKET = Bracket(Exposure(0.01))


class Log:
    """What both devices were told, in order; `at` is called at each step and may wait or raise."""

    def __init__(self) -> None:
        self.steps: list[str] = []
        self.at: Callable[[str], None] = lambda step: None

    def __call__(self, step: str) -> None:
        self.steps.append(step)
        self.at(step.split()[0])


class Table(Motion):
    def __init__(self, log: Log, axes: int = 1):
        self._log, self._axes = log, axes

    @property
    def name(self) -> str:
        return "table"

    @property
    def features(self) -> MotionFeatures:
        return MotionFeatures((Axis("pan", None, None, 0.01, 10.0),) * self._axes, True, True, True, True)

    def status(self) -> MotionStatus:
        return MotionStatus(State.IDLE, None)

    def home(self) -> Angles:
        self._log("home")
        return Angles(0.0)

    def move(self, angles: Angles) -> Angles:
        self._log(f"move {angles.pan_deg:g}")
        return Angles(angles.pan_deg + 0.01)

    def stop(self) -> None:
        self._log("stop-motion")

    def hold(self) -> None: ...
    def resume(self) -> None: ...

    def close(self) -> None:
        self._log("close-motion")


class Body(Camera):
    def __init__(self, log: Log, names: Sequence[str] = ("IMG_1.DNG", "IMG_2.DNG", "IMG_3.DNG")):
        self._log, self._names = log, names

    @property
    def name(self) -> str:
        return "body"

    @property
    def features(self) -> CameraFeatures:
        return CameraFeatures("body", (), (), (), ".dng", True)

    def status(self) -> CameraStatus:
        return CameraStatus(True)

    def expose(self, bracket: Bracket) -> tuple[Taken, ...]:
        self._log("expose")
        return tuple(
            Taken(f"/store/DCIM/{name}", ev, bracket.base)
            for name, ev in zip(self._names, bracket.stops, strict=True)
        )

    def download(self, taken: Taken, to: Path) -> Frame:
        self._log(f"download {to.name}")
        to.write_bytes(taken.handle.encode())
        return Frame(to, to.name, hashlib.sha256(taken.handle.encode()).hexdigest(), to.stat().st_size, taken)

    def forget(self, taken: Sequence[Taken]) -> None: ...

    def stop(self) -> None:
        self._log("stop-camera")

    def close(self) -> None:
        self._log("close-camera")


@pytest.fixture
def log() -> Log:
    return Log()


def rig(log: Log, **options: object) -> Rig:
    return Rig(Table(log), Body(log), wait=lambda stopped, seconds: log(f"settle {seconds:g}"), **options)


class Gate:
    """Holds the order that comes to a step until it is let go."""

    def __init__(self, log: Log, step: str):
        self._step, self._arrived, self._let_go = step, threading.Event(), threading.Event()
        log.at = self

    def __call__(self, step: str) -> None:
        if step == self._step:
            self._arrived.set()
            assert self._let_go.wait(PATIENCE_S)

    def reached(self) -> None:
        assert self._arrived.wait(PATIENCE_S)

    def open(self) -> None:
        self._let_go.set()


def test_a_pose_is_moved_to_settled_taken_and_fetched_in_this_order(log: Log, tmp_path: Path):
    shot = rig(log, settle_s=0.3).take(Angles(20.0), BRACKET, tmp_path)
    assert log.steps == [
        "move 20", "settle 0.3", "expose", "download IMG_1.DNG", "download IMG_2.DNG", "download IMG_3.DNG",
    ]  # fmt: skip
    assert shot.angles == Angles(20.01)
    assert [frame.taken.ev for frame in shot.frames] == [-3.0, 0.0, 3.0]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["IMG_1.DNG", "IMG_2.DNG", "IMG_3.DNG"]


def test_without_angles_nothing_turns(log: Log, tmp_path: Path):
    assert rig(log).take(None, BRACKET, tmp_path).angles is None
    assert log.steps[0] == "expose"


def test_a_rig_without_axes_is_told_to_take_its_next_place(log: Log, tmp_path: Path):
    handheld = Rig(Table(log, axes=0), Body(log))
    assert handheld.take(None, BRACKET, tmp_path).angles is None
    assert log.steps[:2] == ["move 0", "expose"]


def test_two_photographs_of_one_name_are_refused(log: Log, tmp_path: Path):
    twice = Rig(Table(log), Body(log, ("A.DNG", "A.DNG", "B.DNG")))
    with pytest.raises(ExposureError, match="named two photographs"):
        twice.take(Angles(0.0), BRACKET, tmp_path)
    assert not list(tmp_path.iterdir())


def test_stop_reaches_both_while_an_order_holds_the_lock(log: Log, tmp_path: Path):
    gate, one = Gate(log, "move"), rig(log)
    order = Order(lambda: one.take(Angles(20.0), BRACKET, tmp_path))
    gate.reached()
    one.stop()
    assert log.steps[:3] == ["move 20", "stop-motion", "stop-camera"]
    gate.open()
    assert isinstance(order.finished(), StoppedError)
    assert "expose" not in log.steps


def test_a_stop_ends_the_settling_at_once(log: Log):
    one = Rig(Table(log), Body(log), settle_s=3600.0)
    order = Order(lambda: one.go(Angles(20.0)))
    wait(lambda: "move 20" in log.steps, "it never moved")
    one.stop()
    assert isinstance(order.finished(), StoppedError)


@pytest.mark.parametrize("step", ["settle", "expose", "download"])
def test_a_stop_at_any_step_ends_the_order_after_it(step: str, log: Log, tmp_path: Path):
    one = rig(log, settle_s=0.1)

    def at(now: str) -> None:
        if now == step:
            log.at = lambda step: None
            one.stop()

    log.at = at
    with pytest.raises(StoppedError):
        one.take(Angles(20.0), BRACKET, tmp_path)
    orders = [told.split()[0] for told in log.steps if not told.startswith("stop")]
    assert orders[-1] == step


def test_an_order_that_waits_for_its_turn_is_stopped_too(log: Log, tmp_path: Path):
    gate, one = Gate(log, "move"), rig(log)
    first = Order(lambda: one.go(Angles(1.0)))
    gate.reached()
    second = Order(lambda: one.go(Angles(2.0)))
    wait(lambda: len(one._orders) == 2, "the second was never given")
    one.stop()
    gate.open()
    assert isinstance(first.finished(), StoppedError)
    assert isinstance(second.finished(), StoppedError)
    assert "move 2" not in log.steps


def test_a_stop_is_repeated_while_the_order_it_was_for_goes_on(log: Log):
    """The order may have been on its way into the driver when the first stop came too early for it."""
    gate, one = Gate(log, "move"), rig(log)
    order = Order(lambda: one.go(Angles(1.0)))
    gate.reached()
    one.stop()
    for device in ("stop-motion", "stop-camera"):
        wait(lambda device=device: log.steps.count(device) >= 3, f"{device} was not repeated")
    gate.open()
    order.finished()
    insisting = [thread for thread in threading.enumerate() if thread.name == "insist on stop"]
    for thread in insisting:
        thread.join(PATIENCE_S)
    told = len(log.steps)
    one.go(Angles(2.0))  # is not meant
    assert log.steps[told:] == ["move 2"]


def test_a_stop_at_rest_does_not_end_the_next_order(log: Log, tmp_path: Path):
    one = rig(log)
    one.stop()
    assert not [thread for thread in threading.enumerate() if thread.name == "insist on stop"]
    one.take(Angles(1.0), BRACKET, tmp_path)
    assert log.steps.count("stop-motion") == 1


def test_the_camera_is_stopped_even_if_the_rig_cannot_be_told(log: Log):
    def at(step: str) -> None:
        if step == "stop-motion":
            raise DisconnectedError("gone")

    log.at = at
    with pytest.raises(DisconnectedError):
        rig(log).stop()
    assert "stop-camera" in log.steps


def test_a_fault_on_the_way_takes_no_photograph(log: Log, tmp_path: Path):
    def at(step: str) -> None:
        if step == "move":
            raise PositionLostError("stalled")

    log.at = at
    with pytest.raises(PositionLostError):
        rig(log).take(Angles(1.0), BRACKET, tmp_path)
    assert log.steps == ["move 1"]


def test_two_orders_at_once_take_turns(log: Log, tmp_path: Path):
    one = rig(log)
    folders = [tmp_path / name for name in "abcd"]
    for folder in folders:
        folder.mkdir()
    orders = [Order(lambda folder=folder: one.take(Angles(5.0), BRACKET, folder)) for folder in folders]
    for order in orders:
        assert not isinstance(order.finished(), HardwareError)
    told = [step.split()[0] for step in log.steps]
    assert told == ["move", "expose", "download", "download", "download"] * 4


@pytest.mark.parametrize("step", ["expose", "download"])
def test_nothing_turns_between_a_poses_move_and_its_last_photograph(step: str, log: Log, tmp_path: Path):
    gate, one = Gate(log, step), rig(log)
    pose = Order(lambda: one.take(Angles(5.0), BRACKET, tmp_path))
    gate.reached()
    jogged, homed = Order(lambda: one.go(Angles(9.0))), Order(one.home)
    wait(lambda: len(one._orders) == 3, "they were never given")
    gate.open()
    for order in (pose, jogged, homed):
        assert not isinstance(order.finished(), HardwareError)
    last = max(place for place, told in enumerate(log.steps) if told.startswith("download"))
    assert set(log.steps[last + 1 :]) == {"move 9", "home"}


def test_whoever_hears_the_steps_may_end_a_pose_before_each(log: Log, tmp_path: Path):
    heard: list[Step] = []

    def enter(step: Step) -> None:
        heard.append(step)
        if step is Step.EXPOSE:
            raise KeyError("enough")

    one = rig(log)
    with pytest.raises(KeyError):
        one.take(Angles(5.0), BRACKET, tmp_path, enter)
    assert (heard, log.steps) == ([Step.MOVE, Step.EXPOSE], ["move 5"])
    with pytest.raises(KeyError):
        one.home(lambda: enter(Step.EXPOSE))
    assert "home" not in log.steps
    one.take(Angles(5.0), BRACKET, tmp_path)  # its turn is over


def test_closing_closes_both_and_a_waiting_order_ends(log: Log):
    gate, one = Gate(log, "move"), rig(log)
    first = Order(lambda: one.go(Angles(1.0)))
    gate.reached()
    second = Order(lambda: one.go(Angles(2.0)))
    wait(lambda: len(one._orders) == 2, "the second was never given")
    one.close()
    assert log.steps == ["move 1", "close-motion", "close-camera"]
    gate.open()
    assert isinstance(first.finished(), StoppedError)
    assert isinstance(second.finished(), StoppedError)


def test_the_camera_is_closed_even_if_the_rig_cannot_be(log: Log):
    def at(step: str) -> None:
        if step == "close-motion":
            raise DisconnectedError("gone")

    log.at = at
    with pytest.raises(DisconnectedError):
        rig(log).close()
    assert log.steps[-1] == "close-camera"
