"""The GRBL driver when cable, controller or mechanics fail: the right error, no double motion, never a wrong place."""

import time

import pytest

from hardware.errors import (
    DisconnectedError,
    HardwareError,
    PositionLostError,
    RefusedError,
    ReplyError,
)
from hardware.grbl.opening import GrblConfig, open_grbl
from hardware.grbl.rig import SETTLE
from hardware.interfaces import Angles, State
from hardware.virtual.grbl.firmware import GrblFirmware
from tests.hardware.contracts.grbl_rigs import QUICK
from tests.hardware.contracts.orders import wait
from tests.hardware.contracts.pace import Pace
from tests.hardware.grbl.bench import HURRY, Bench, bare, powered, with_switches


def moves(b: Bench) -> int:
    """How many motion lines the controller was sent."""
    return b.heard.bytes.count(b"G1X")


def try_until_there(b: Bench, target: Angles, times: int) -> list[HardwareError]:
    """Ask again after each transient error, as a capture does; returns those errors."""
    errors = []
    for _ in range(times):
        try:
            assert b.rig.move(target) == target
            return errors
        except ReplyError as error:
            errors.append(error)
    raise AssertionError(f"not there after {times} tries: {errors}")


def test_garbage_between_replies_is_overcome_without_a_wrong_place():
    with bare(clock=Pace(4.0)) as b:
        b.rig.home()
        for number, junk in enumerate(
            (b"\x00\xff\xfe", b"ok\r\n", b"<Idle|MP", b"\r\n\r\n", b"error:", b"[MSG:x]\r\n")
        ):
            b.faults.garbage(junk)
            target = Angles(3.0 * (number + 1))
            try_until_there(b, target, 3)
            assert b.truth() == target


def test_noise_on_the_line_never_makes_a_wrong_place():
    clock = Pace(1.0)
    with bare(clock=clock) as b:
        b.rig.home()
        clock.set(5)
        b.faults.noise(0.02)
        for number in range(12):
            target = Angles(2.0 * (number % 5))
            try:
                b.rig.move(target)
                assert b.truth() == target
            except PositionLostError:
                clock.set(1)
                b.faults.heal()  # noise may look like an alarm: homing is asked for, and nothing else moves
                stood = b.truth().pan_deg
                b.rig.home()
                assert b.truth().pan_deg == stood
                break
            except ReplyError:
                pass
        b.faults.heal()
        clock.set(1)
        zero = b.truth().pan_deg - b.rig.status().angles.pan_deg  # type: ignore[union-attr]
        try_until_there(b, Angles(7.0), 2)
        assert b.truth().pan_deg - zero == pytest.approx(7.0, abs=0.01)


def test_single_bytes_and_merged_lines_are_read_alike():
    with bare() as b:
        b.faults.split()
        b.rig.home()
        assert b.rig.move(Angles(3.0)) == Angles(3.0)
        b.faults.heal()
        b.faults.merge(1.0)
        assert b.rig.move(Angles(5.0)) == Angles(5.0)


@pytest.mark.parametrize("number", [1, 2])
def test_a_lost_ok_is_told_and_tried_again_without_moving_twice(number: int):
    with bare(clock=Pace(4.0)) as b:
        b.rig.home()
        b.rig.move(Angles(2.0))
        b.faults.lose_line(number, b"ok")
        with pytest.raises(ReplyError, match="answer was lost") as told:
            b.rig.move(Angles(5.0))
        assert type(told.value) is ReplyError
        assert b.truth() == Angles(5.0)
        assert b.rig.status().angles == Angles(5.0)
        before = moves(b)
        assert b.rig.move(Angles(5.0)) == Angles(5.0)
        assert moves(b) == before + 1
        assert b.truth() == Angles(5.0)


def test_a_lost_start_up_message_after_a_stop_is_overcome():
    clock = Pace(1.0)
    with bare(clock=clock, hurry=4) as b:
        b.rig.home()
        b.faults.lose_line(1, b"Grbl")
        order = b.under_way(Angles(100.0))
        b.rig.stop()
        clock.set(5)
        assert isinstance(order.finished(), HardwareError)
        clock.set(1)
        try_until_there(b, Angles(10.0), 3)
        assert b.truth() == Angles(10.0)


def test_answers_that_come_late_answer_nothing_asked_afterwards():
    clock = Pace(1.0)
    with bare(clock=clock) as b:
        b.rig.home()
        clock.set(5)
        b.faults.delay(2.0 * HURRY)  # 10 s of the driver's
        with pytest.raises(ReplyError):
            b.rig.move(Angles(4.0))
        b.faults.heal()  # what was said meanwhile is on its way still, and answers come behind it
        errors = try_until_there(b, Angles(8.0), 30)
        assert b.truth() == Angles(8.0)
        assert all(isinstance(error, ReplyError) for error in errors)
        clock.set(1)
        assert b.rig.move(Angles(1.0)) == Angles(1.0)
        assert b.truth() == Angles(1.0)


def test_silence_in_motion_is_told_and_overcome():
    clock = Pace(1.0)
    with bare(clock=clock, hurry=4) as b:
        b.rig.home()
        order = b.under_way(Angles(40.0))
        b.faults.silence()
        clock.set(10)
        assert isinstance(order.finished(), ReplyError)
        wait(lambda: b.rig.status().state is State.OFFLINE, "silence was not told")
        clock.set(1)
        b.faults.heal()
        try_until_there(b, Angles(20.0), 2)
        assert b.truth() == Angles(20.0)


def test_what_does_not_reach_the_controller_moves_nothing():
    clock = Pace(1.0)
    with bare(clock=clock) as b:
        b.rig.home()
        b.faults.deafen()
        stood = b.truth()
        clock.set(5)
        with pytest.raises(ReplyError):
            b.rig.move(Angles(40.0))
        clock.set(1)
        assert b.truth() == stood
        b.faults.heal()
        try_until_there(b, Angles(20.0), 2)
        assert b.truth() == Angles(20.0)


class Mishearing(GrblFirmware):
    """Hears 50 as 30 once."""

    times = 1

    def receive(self, data: bytes, now: float) -> None:
        if self.times and b"X50." in data:
            data, self.times = data.replace(b"X50.", b"X30."), 0
        super().receive(data, now)


def test_an_order_that_was_misheard_is_told_and_given_again():
    with powered(Mishearing(QUICK)) as (wire, _, faults):
        rig = open_grbl(GrblConfig(wire.port, pan=None, homing="none", feed_deg_min=3600.0))
        rig.home()
        with pytest.raises(ReplyError, match=r"sent to .*50.* stands at .*30"):
            rig.move(Angles(50.0))
        assert rig.move(Angles(50.0)) == Angles(50.0)
        assert faults.firmware.angles() == Angles(50.0)
        rig.close()


def test_a_refused_line_is_told_by_name_and_the_rig_can_go_on():
    with bare() as b:
        b.rig.home()
        b.firmware.refuse_next(33)
        with pytest.raises(RefusedError, match="error:33, invalid target"):
            b.rig.move(Angles(5.0))
        assert b.rig.move(Angles(5.0)) == Angles(5.0)
        assert b.truth() == Angles(5.0)


def test_a_lock_that_nobody_told_of_loses_the_position():
    with bare() as b:
        b.rig.home()
        b.firmware.refuse_next(9)
        with pytest.raises(PositionLostError, match="error:9"):
            b.rig.move(Angles(5.0))
        assert b.rig.status().state is State.FAULT


def lost_until_homed(b: Bench, reason: str) -> None:
    """It says why, moves nothing, sends nothing, and works again once homed."""
    status = b.rig.status()
    assert status.state is State.FAULT
    assert reason in status.message
    assert status.angles is None
    before, stood = b.heard.orders(), b.truth()
    with pytest.raises(PositionLostError):
        b.rig.move(Angles(-170.0))
    assert b.heard.orders() == before
    assert b.truth() == stood
    b.rig.home()
    assert b.rig.move(Angles(-170.0)) == Angles(-170.0)
    assert b.truth().pan_deg == pytest.approx(-170.0, abs=0.01)


def test_a_limit_hit_in_motion():
    with with_switches(hurry=4) as b:
        b.rig.home()
        order = b.under_way(Angles(0.0))
        b.firmware.hit_limit()
        error = order.finished()
        assert isinstance(error, PositionLostError)
        assert "ALARM:1, hard limit" in str(error)
        lost_until_homed(b, "ALARM:1")


def test_homing_right_after_a_limit_hit_works_though_grbl_overhears_a_reset_then():
    with with_switches(hurry=1) as b:
        b.rig.home()
        order = b.under_way(Angles(0.0))
        b.firmware.hit_limit()
        assert isinstance(order.finished(), PositionLostError)
        assert b.rig.home() == Angles(-184.0)


def test_an_emergency_stop_in_motion():
    with with_switches(hurry=4) as b:
        b.rig.home()
        order = b.under_way(Angles(0.0))
        b.firmware.emergency_stop()
        assert isinstance(order.finished(), PositionLostError)
        lost_until_homed(b, "ALARM:3")


def test_a_brown_out_in_motion():
    with with_switches(hurry=4) as b:
        b.rig.home()
        order = b.under_way(Angles(0.0))
        # On a busy machine the axis turns before the last line of the move is sent.
        wait(lambda: b.heard.orders().endswith(f"{SETTLE}\n".encode()), "the move was never sent whole")
        before = b.heard.orders()
        b.firmware.brown_out(slip_deg=3.0)
        error = order.finished()
        assert isinstance(error, PositionLostError)
        assert "lost power" in str(error)
        assert b.heard.orders() == before
        lost_until_homed(b, "lost power")


def test_a_brown_out_at_rest():
    with with_switches(hurry=40) as b:
        b.rig.home()
        b.rig.move(Angles(-100.0))
        b.firmware.brown_out(slip_deg=-5.0)
        wait(lambda: b.rig.status().state is State.FAULT, "it was never noticed")
        lost_until_homed(b, "lost power")


def test_a_brown_out_whose_start_up_message_was_lost():
    with bare(hurry=40) as b:  # without homing the controller is not locked after it
        b.rig.home()
        b.rig.move(Angles(60.0))
        b.faults.lose_line(1, b"Grbl")
        b.firmware.brown_out(slip_deg=-5.0)
        wait(lambda: b.rig.status().state is State.IDLE, "it never came back")
        with pytest.raises(PositionLostError, match="where it was not sent"):
            b.rig.move(Angles(61.0))
        assert b.truth().pan_deg == pytest.approx(55.0)


def test_a_brown_out_in_motion_whose_start_up_message_was_lost():
    with bare(hurry=10) as b:
        b.rig.home()
        b.rig.move(Angles(5.0))
        order = b.under_way(Angles(60.0))
        wait(lambda: b.truth().pan_deg > 20.0, "it never came so far")
        b.faults.lose_line(1, b"Grbl")
        b.firmware.brown_out()
        assert isinstance(order.finished(), HardwareError)
        stood = b.truth()
        with pytest.raises(PositionLostError):
            b.rig.move(Angles(61.0))
        assert b.truth() == stood


def test_a_stalled_motor_is_set_right_by_homing():
    with with_switches() as b:
        b.rig.home()
        b.firmware.stall(0)
        assert b.rig.move(Angles(-170.0)) == Angles(-170.0)  # GRBL counts steps and cannot know
        assert b.truth().pan_deg == pytest.approx(-184.0, abs=0.01)
        b.firmware.stall(0, False)
        b.rig.home()
        b.rig.move(Angles(-170.0))
        assert b.truth().pan_deg == pytest.approx(-170.0, abs=0.01)


def test_a_soft_limit_of_the_controller_is_told_by_name():
    with with_switches() as b:
        b.rig.home()
        b.firmware.memory.settings[130] = 100.0  # changed behind our back
        with pytest.raises(PositionLostError, match="ALARM:2, soft limit"):
            b.rig.move(Angles(-100.0))
        b.firmware.memory.settings[130] = 371.0
        lost_until_homed(b, "ALARM:2")


def test_sleep_and_check_mode_set_at_the_machine_are_told():
    with bare() as b:
        b.rig.home()
        b.faults.receive(b"$C\n", HURRY * time.monotonic())
        with pytest.raises(RefusedError, match="Check"):
            b.rig.move(Angles(1.0))
        b.faults.receive(b"$C\n", HURRY * time.monotonic())
        wait(lambda: b.rig.status().state is State.FAULT, "leaving check mode resets it")
        b.rig.home()
        b.faults.receive(b"$SLP\n", HURRY * time.monotonic())
        with pytest.raises(PositionLostError, match="Sleep"):
            b.rig.move(Angles(1.0))


def test_a_cable_pulled_at_any_moment_ends_every_order():
    with bare(hurry=4) as b:
        b.rig.home()
        order = b.under_way(Angles(300.0))
        b.wire.pull()
        assert isinstance(order.finished(), DisconnectedError)
        for attempt in (b.rig.home, lambda: b.rig.move(Angles(0.0)), b.rig.stop):
            with pytest.raises(HardwareError):
                attempt()
        assert b.rig.status().state is State.OFFLINE


def test_startup_lines_answer_nothing_of_ours():
    with bare({**QUICK}) as b:
        b.firmware.memory.startup = ["G20G91G93", "G55"]
        b.rig.home()
        assert b.rig.move(Angles(12.0)) == Angles(12.0)
        order = b.under_way(Angles(30.0))
        b.rig.stop()
        order.finished()
        assert b.rig.move(Angles(12.0)) == Angles(12.0)
        assert b.truth() == Angles(12.0)
