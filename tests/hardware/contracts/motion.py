"""The promises of `Motion`, kept by every rig: subclass `MotionPromises` with a fixture `made`.

`made` is a rig just opened, never moved, with the facts that a test needs of it (`Made`). A promise that does not
apply to a rig (it has no limits, cannot hold, ...) is skipped for it by what its own features say.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import pytest

from hardware.errors import DisconnectedError, HardwareError, LimitError, PositionLostError, StoppedError
from hardware.interfaces import Angles, Motion, State
from tests.hardware.contracts.orders import PATIENCE_S, Order, wait
from tests.hardware.contracts.pace import FAST, SLOW


@dataclass(frozen=True, slots=True)
class Made:
    """A rig under test and what is known of it."""

    rig: Motion
    near: Angles  # within travel and 5 degrees of pan below its end, not where `home` leaves it, soon reached
    far: Angles  # within travel; from `near` it takes at least 1 s of real time at the pace `SLOW`
    beyond: tuple[Angles, ...]  # each outside the travel; empty if it turns endlessly
    truth: Callable[[], Angles] | None = None  # where the mechanics really stand
    sent: Callable[[], bytes] | None = None  # all that the device has heard, queries for its state left out
    pull: Callable[[], None] | None = None  # unplugs it
    pace: Callable[[float], None] = lambda rate: None  # makes its time pass faster or slower


def same(a: Angles, b: Angles, tolerance_deg: float) -> bool:
    return abs(a.pan_deg - b.pan_deg) <= tolerance_deg and abs(a.tilt_deg - b.tilt_deg) <= tolerance_deg


@contextlib.contextmanager
def moving(made: Made) -> Iterator[Order]:
    """Homed, at `near`, and on its way to `far`."""
    made.rig.home()
    made.rig.move(made.near)
    made.pace(SLOW)
    stood = made.truth() if made.truth else None
    order = Order(lambda: made.rig.move(made.far))
    wait(lambda: made.rig.status().state is State.MOVING, "it never began to move")
    if made.truth is not None:
        wait(lambda: made.truth is None or made.truth() != stood, "it said that it moves and did not")
    yield order
    made.pace(FAST)


class MotionPromises:
    """Subclass me with a fixture `made`."""

    def tolerance(self, made: Made) -> float:
        """What two statements of the same place may differ by."""
        return max((axis.resolution_deg for axis in made.rig.features.axes), default=0.0) + 1e-6

    def test_features_can_be_meant(self, made: Made):
        features = made.rig.features
        assert [axis.name for axis in features.axes] in ([], ["pan"], ["pan", "tilt"])
        for axis in features.axes:
            assert (axis.lowest_deg is None) == (axis.highest_deg is None)
            if axis.lowest_deg is not None and axis.highest_deg is not None:
                assert axis.lowest_deg < axis.highest_deg
            assert axis.resolution_deg > 0
            assert axis.fastest_deg_s > 0
        assert made.rig.name

    def test_nothing_moves_before_it_is_homed(self, made: Made):
        if made.rig.status().state is not State.UNHOMED:
            pytest.skip("knows where it stands from the beginning")
        before = made.sent() if made.sent else b""
        with pytest.raises(PositionLostError):
            made.rig.move(made.near)
        assert not made.sent or made.sent() == before
        assert made.rig.status().state is State.UNHOMED

    def test_after_homing_it_stands_and_tells_where(self, made: Made):
        angles = made.rig.home()
        status = made.rig.status()
        assert status.state is State.IDLE
        if made.rig.features.reports_angles:
            assert status.angles is not None
            assert same(status.angles, angles, self.tolerance(made))

    def test_a_move_ends_where_it_was_told_to(self, made: Made):
        made.rig.home()
        reached = made.rig.move(made.near)
        assert same(reached, made.near, self.tolerance(made))
        status = made.rig.status()
        assert status.state is State.IDLE
        if made.rig.features.reports_angles:
            assert status.angles == reached

    def test_where_it_says_it_stands_is_where_it_stands(self, made: Made):
        if made.truth is None:
            pytest.skip("nobody can look")
        made.rig.home()
        for angles in (made.near, replace(made.near, pan_deg=made.near.pan_deg + 5.0), made.near):
            made.rig.move(angles)
            assert same(made.truth(), angles, self.tolerance(made))

    def test_the_same_place_again_is_the_same_place(self, made: Made):
        made.rig.home()
        assert made.rig.move(made.near) == made.rig.move(made.near)

    def test_out_of_range_moves_nothing(self, made: Made):
        made.rig.home()
        stands = made.rig.move(made.near)
        before = made.sent() if made.sent else b""
        for angles in made.beyond:
            with pytest.raises(LimitError):
                made.rig.move(angles)
        assert not made.sent or made.sent() == before
        assert made.rig.move(made.near) == stands

    @pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf])
    def test_what_is_no_angle_moves_nothing(self, made: Made, angle: float):
        made.rig.home()
        before = made.sent() if made.sent else b""
        with pytest.raises(LimitError):
            made.rig.move(Angles(angle))
        with pytest.raises(LimitError):
            made.rig.move(Angles(0.0, angle))
        assert not made.sent or made.sent() == before

    def test_an_axis_it_lacks_moves_nothing(self, made: Made):
        if not made.rig.features.axes or len(made.rig.features.axes) == 2:
            pytest.skip("has no axis to lack")
        made.rig.home()
        before = made.sent() if made.sent else b""
        with pytest.raises(LimitError):
            made.rig.move(replace(made.near, tilt_deg=10.0))
        assert not made.sent or made.sent() == before

    def test_an_endless_axis_counts_on(self, made: Made):
        axes = made.rig.features.axes
        if not axes or axes[0].lowest_deg is not None:
            pytest.skip("has limits")
        made.rig.home()
        reached = made.rig.move(replace(made.near, pan_deg=370.0))
        assert reached.pan_deg == pytest.approx(370.0, abs=self.tolerance(made))

    def test_stop_ends_a_move_and_it_stands(self, made: Made):
        with moving(made) as order:
            made.rig.stop()
            outcome = order.finished()
        assert isinstance(outcome, StoppedError | PositionLostError)
        if made.truth is not None:
            stands = made.truth()
            assert not same(stands, made.far, self.tolerance(made))
            time.sleep(0.1)
            assert made.truth() == stands
        assert made.rig.status().state is not State.MOVING

    def test_after_a_stop_it_can_go_on(self, made: Made):
        with moving(made) as order:
            made.rig.stop()
            outcome = order.finished()
        if isinstance(outcome, PositionLostError):
            made.rig.home()
        reached = made.rig.move(made.near)
        assert same(reached, made.near, self.tolerance(made))
        if made.truth is not None:
            assert same(made.truth(), made.near, self.tolerance(made))

    def test_stop_at_rest_does_no_harm(self, made: Made):
        made.rig.stop()
        made.rig.home()
        made.rig.stop()
        made.rig.stop()
        assert same(made.rig.move(made.near), made.near, self.tolerance(made))

    def test_hold_pauses_and_resume_goes_on(self, made: Made):
        if not made.rig.features.holds:
            pytest.skip("cannot hold")
        with moving(made) as order:
            made.rig.hold()
            wait(lambda: made.rig.status().state is State.HELD, "it was never held")
            if made.truth is not None:
                held = made.truth()
                time.sleep(0.1)
                assert made.truth() == held
            assert order.is_alive()
            made.rig.resume()
            made.pace(FAST)
            reached = order.finished()
        assert isinstance(reached, Angles), reached
        assert same(reached, made.far, self.tolerance(made))

    def test_a_held_move_can_be_stopped(self, made: Made):
        if not made.rig.features.holds:
            pytest.skip("cannot hold")
        with moving(made) as order:
            made.rig.hold()
            wait(lambda: made.rig.status().state is State.HELD, "it was never held")
            made.rig.stop()
            assert isinstance(order.finished(), StoppedError | PositionLostError)

    def test_hold_and_resume_at_rest_do_no_harm(self, made: Made):
        made.rig.home()
        made.rig.hold()
        made.rig.resume()
        assert same(made.rig.move(made.near), made.near, self.tolerance(made))

    def test_status_is_told_during_a_move(self, made: Made):
        with moving(made) as order:
            start = time.monotonic()
            status = made.rig.status()
            assert time.monotonic() - start < 2.0  # promised are 0.5 s; this machine may be busy
            assert status.state is State.MOVING
            made.rig.stop()
            order.finished()

    def test_a_pulled_cable_ends_a_move_and_is_told(self, made: Made):
        if made.pull is None:
            pytest.skip("has no cable")
        with moving(made) as order:
            made.pull()
            assert isinstance(order.finished(), DisconnectedError)
        assert made.rig.status().state is State.OFFLINE
        with pytest.raises(HardwareError):
            made.rig.move(made.near)

    def test_status_never_raises_without_a_cable(self, made: Made):
        if made.pull is None:
            pytest.skip("has no cable")
        made.rig.home()
        made.pull()
        assert made.rig.status().state is State.OFFLINE

    def test_close_may_be_called_twice_and_ends_the_work(self, made: Made):
        made.rig.home()
        made.rig.close()
        made.rig.close()
        with pytest.raises(HardwareError):
            made.rig.move(made.near)
        assert made.rig.status().state is State.OFFLINE

    def test_close_stops_what_moves(self, made: Made):
        with moving(made) as order:
            made.rig.close()
            assert isinstance(order.finished(), HardwareError)
        if made.truth is not None:
            wait_until_still(made.truth)
            assert not same(made.truth(), made.far, self.tolerance(made))


def wait_until_still(truth: Callable[[], Angles]) -> None:
    """Until it has stood for 0.2 s."""
    end = time.monotonic() + PATIENCE_S
    before, since = truth(), time.monotonic()
    while time.monotonic() - since < 0.2:
        assert time.monotonic() < end, "it never stood"
        time.sleep(0.02)
        if truth() != before:
            before, since = truth(), time.monotonic()
