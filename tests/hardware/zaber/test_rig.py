import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from hardware.errors import (
    HardwareError,
    LimitError,
    PositionLostError,
    RefusedError,
    ReplyError,
    StoppedError,
)
from hardware.interfaces import Angles, State
from hardware.virtual.wire import Wire
from hardware.virtual.zaber.firmware import ZaberFirmware
from hardware.zaber.opening import ZaberAxis, ZaberConfig, open_zaber
from tests.hardware.contracts.orders import Order, wait
from tests.hardware.contracts.pace import Pace
from tests.hardware.zaber.bench import FAR, HURRY, NEAR, PAN, Bench, far


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


# ---- what it says of itself


def test_the_name_tells_model_firmware_serial_number_and_port(bench: Bench):
    name = bench.open().name
    for part in ("30222", "7.38", "81234", bench.wire.port):
        assert part in name


def test_scale_and_travel_come_from_the_device(bench: Bench):
    pan, tilt = bench.open().features.axes
    assert (pan.lowest_deg, pan.highest_deg) == (None, None)
    assert (tilt.lowest_deg, tilt.highest_deg) == (pytest.approx(-60, abs=1e-3), pytest.approx(80, abs=1e-3))
    assert tilt.resolution_deg == pytest.approx(360 / 1_536_000)
    assert tilt.fastest_deg_s == pytest.approx(60.0, rel=1e-3)


def test_travel_of_the_rig_stays_within_that_of_the_device(bench: Bench):
    (pan,) = bench.open(pan=ZaberAxis(1, 2, lowest_deg=-200.0, highest_deg=45.0), tilt=None).features.axes
    assert pan.lowest_deg == pytest.approx(-60, abs=1e-3)
    assert pan.highest_deg == 45.0


def test_zero_and_direction_are_the_rigs(bench: Bench):
    rig = bench.open(tilt=ZaberAxis(1, 2, steps_per_deg=-PAN.steps_per_deg, zero_deg=20.0))
    tilt = rig.features.axes[1]
    assert (tilt.lowest_deg, tilt.highest_deg) == (pytest.approx(-100, abs=1e-3), pytest.approx(40, abs=1e-3))
    rig.home()
    assert rig.move(Angles(0.0, 10.0)).tilt_deg == pytest.approx(10.0, abs=1e-3)
    assert bench.device.angles().tilt_deg == pytest.approx(-30.0, abs=1e-3)


# ---- orders and faults


def test_limits_and_reasons_are_told_and_nothing_is_sent(bench: Bench):
    rig = bench.homed()
    before = bench.heard.bytes
    with pytest.raises(LimitError, match=r"tilt 81 degrees is beyond -60 to 80"):
        rig.move(Angles(0.0, 81.0))
    assert bench.heard.bytes == before


def test_a_move_is_over_when_the_stage_says_idle_and_not_by_waiting(bench: Bench):
    rig = bench.homed()
    rig.move(NEAR)
    start = time.monotonic()
    rig.move(replace(NEAR, pan_deg=NEAR.pan_deg + 0.1))
    assert time.monotonic() - start < 0.1 + 0.5  # generous: other programs run here


def test_a_stall_loses_the_position_until_homed(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    bench.device.stall(1)
    outcome = order.finished()
    assert isinstance(outcome, PositionLostError)
    assert "stalled and stopped (FS)" in str(outcome)
    assert rig.status().state is State.FAULT
    before = bench.heard.orders()
    with pytest.raises(PositionLostError):
        rig.move(NEAR)
    assert bench.heard.orders() == before
    rig.home()
    rig.move(NEAR)
    assert bench.device.angles().pan_deg == pytest.approx(10.0, abs=1e-3)


def test_a_stall_while_homing_is_told(bench: Bench):
    rig = bench.open()
    bench.device.stall(1)
    with pytest.raises(PositionLostError, match="FS"):
        rig.home()
    with pytest.raises(PositionLostError):
        rig.move(NEAR)
    rig.home()


def test_a_brown_out_in_motion_loses_the_position(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    bench.device.brown_out()
    outcome = order.finished()
    assert isinstance(outcome, PositionLostError)
    assert rig.status().state is State.UNHOMED
    rig.home()
    rig.move(NEAR)
    assert bench.device.angles().pan_deg == pytest.approx(10.0, abs=1e-3)


def test_a_brown_out_at_rest_is_noticed_before_the_next_move(bench: Bench):
    rig = bench.homed()
    rig.move(NEAR)
    bench.device.brown_out()
    time.sleep(1.0 / HURRY)
    before = bench.heard.orders()
    with pytest.raises(PositionLostError, match="no reference position"):
        rig.move(FAR)
    assert bench.heard.orders() == before


def test_the_emergency_stop_is_told_and_homing_needs_it_released(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    bench.device.press_estop()
    outcome = order.finished()
    assert isinstance(outcome, PositionLostError)
    assert "emergency stop" in str(outcome)
    with pytest.raises(PositionLostError, match="release the emergency stop"):
        rig.home()
    bench.device.release_estop()
    rig.home()
    rig.move(NEAR)


def test_an_encoder_error_is_told_with_its_remedy(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    bench.device.encoder_error(1)
    assert "check the encoder's cable" in str(order.finished())


def test_a_knob_turned_in_motion_ends_it_but_not_the_position(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    bench.device.turn_knob(1)
    outcome = order.finished()
    assert isinstance(outcome, StoppedError)
    assert "knob" in str(outcome)
    rig.move(NEAR)


def test_a_lost_answer_to_a_question_is_asked_for_again(bench: Bench):
    rig = bench.homed()
    for _ in range(3):
        bench.faults.lose_line()
        rig.move(NEAR)
    assert bench.device.angles().pan_deg == pytest.approx(10.0, abs=1e-3)


def test_a_lost_answer_to_an_order_stops_the_rig_and_may_be_tried_again(bench: Bench):
    rig = bench.homed()
    bench.faults.lose_line(3, b"@01 1 ")  # after those about its warnings and where it stands
    with pytest.raises(ReplyError) as caught:
        rig.move(FAR)
    assert caught.value.transient
    wait(lambda: rig.status().state is State.IDLE, "it never came to rest")
    assert bench.device.angles().pan_deg < FAR.pan_deg - 1
    rig.move(NEAR)


def test_damaged_answers_are_never_believed(bench: Bench):
    """Orders on a noisy line succeed or fail with a reason, and what is reported is the truth."""
    rig = bench.homed()
    bench.faults.noise(0.002)
    reached = 0
    for i in range(12):
        target = Angles(3.0 * i, 1.0 * i)
        try:
            angles = rig.move(target)
        except ReplyError:
            continue
        reached += 1
        assert angles.pan_deg == pytest.approx(target.pan_deg, abs=1e-3)
        assert bench.device.angles().pan_deg == pytest.approx(target.pan_deg, abs=1e-3)
    bench.faults.heal()
    assert reached > 0
    rig.move(NEAR)


def test_an_answer_ten_seconds_late_does_not_answer_the_next_question(bench: Bench):
    rig = bench.homed()
    rig.move(NEAR)
    bench.faults.delay(10.0)  # half a second here: both tries of a question pass
    with pytest.raises(ReplyError):
        rig.move(Angles(20.0, 0.0))
    bench.faults.heal()
    for pan in (30.0, 40.0, 50.0):
        assert rig.move(Angles(pan, 0.0)).pan_deg == pytest.approx(pan, abs=1e-3)
    assert rig.status().angles.pan_deg == pytest.approx(50.0, abs=1e-3)


def test_answers_in_single_bytes_or_all_in_one_piece_are_read(bench: Bench):
    rig = bench.open(reply_s=5.0)  # a byte every tick of the wire is slow
    rig.home()
    bench.faults.split()
    rig.move(NEAR)
    bench.faults.heal()
    bench.faults.merge(0.5)
    rig.move(Angles(12.0, 0.0))
    assert bench.device.angles().pan_deg == pytest.approx(12.0, abs=1e-3)


def test_a_device_that_falls_silent_is_told_within_its_deadline(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    bench.faults.silence()
    assert isinstance(order.finished(), ReplyError)
    start = time.monotonic()
    assert rig.status().state is State.OFFLINE
    assert time.monotonic() - start < 2.0
    bench.faults.heal()
    wait(lambda: rig.status().state is State.IDLE, "it never came back")
    assert bench.device.angles().pan_deg < FAR.pan_deg  # the stop was heard


def test_a_rejection_names_the_reason_and_stops_what_had_begun(bench: Bench):
    rig = bench.homed()
    bench.device.axes[1].settings["limit.max"] = 1000  # somebody else changed it meanwhile
    with pytest.raises(RefusedError, match="BADDATA"):
        rig.move(Angles(500.0, 5.0))
    wait(lambda: rig.status().state is State.IDLE, "it never came to rest")
    assert bench.device.angles().pan_deg < 499


def test_a_stage_that_does_not_arrive_in_time_is_stopped():
    clock = _Leaping()
    device = ZaberFirmware([PAN])
    wire = Wire(device)
    rig = open_zaber(ZaberConfig(wire.port), clock, clock.sleep)
    try:
        rig.home()
        device.axes[0].settings["maxspeed"] = 2
        clock.step_s = 5.0
        with pytest.raises(ReplyError, match="still moving"):
            rig.move(Angles(10.0))
    finally:
        rig.close()
        wire.close()


class _Leaping:
    """A clock whose sleeps take as long as one likes."""

    def __init__(self) -> None:
        self.step_s, self._slept = 0.0, 0.0

    def __call__(self) -> float:
        return time.monotonic() + self._slept

    def sleep(self, seconds: float) -> None:
        self._slept += self.step_s
        time.sleep(seconds)


# ---- stop


def test_stop_goes_out_while_an_answer_is_awaited(bench: Bench):
    clock = Pace(1.0)
    rig = bench.open(clock, reply_s=3600.0)
    rig.home()
    order = far(bench, rig)
    bench.faults.silence()
    asked = len(bench.heard.bytes)
    wait(lambda: len(bench.heard.bytes) > asked, "it asks no more")
    sent = len(bench.heard.bytes)
    rig.stop()
    wait(lambda: b"stop" in bench.heard.bytes[sent:], "the stop never arrived")
    assert order.is_alive()  # it waits for its answer still
    clock.set(1e6)
    assert isinstance(order.finished(), HardwareError)


def test_after_stop_the_order_returns_when_everything_stands(bench: Bench):
    rig = bench.homed()
    order = far(bench, rig)
    rig.stop()
    assert isinstance(order.finished(), StoppedError)
    stands = bench.device.angles()
    time.sleep(0.05)
    assert bench.device.angles() == stands
    assert rig.status().angles.pan_deg == pytest.approx(stands.pan_deg, abs=1e-3)


def test_stop_while_homing_leaves_it_unhomed(bench: Bench):
    rig = bench.homed()
    rig.move(Angles(500.0, 0.0))
    order = Order(rig.home)
    wait(lambda: rig.status().state is State.HOMING, "it never began")
    time.sleep(0.1)
    rig.stop()
    assert isinstance(order.finished(), StoppedError)
    assert rig.status().state is State.UNHOMED
    with pytest.raises(PositionLostError):
        rig.move(NEAR)


def test_a_stop_between_the_check_and_the_order_still_ends_it(bench: Bench):
    """The stop goes out just before `move abs` does: the driver must send it again."""
    rig = bench.homed()
    ask, stopped = rig._link.ask, threading.Event()

    def slow(address: int, axis: int, text: str, tries: int = 3):
        if text.startswith("move abs") and not stopped.is_set():
            stopped.set()
            rig.stop()
        return ask(address, axis, text, tries)

    rig._link.ask = slow
    with pytest.raises(StoppedError):
        rig.move(FAR)
    assert bench.device.angles().pan_deg < FAR.pan_deg - 100


# ---- without a home sensor


def test_without_a_sensor_the_present_place_becomes_zero_and_is_kept_until_power_is_lost(bench: Bench):
    rig = bench.open(homing="none", pan=ZaberAxis(1, 1, zero_deg=10.0))
    assert not rig.features.homes
    assert rig.status().state is State.UNHOMED
    stood = bench.device.angles()
    assert rig.home().pan_deg == pytest.approx(0.0, abs=1e-3)
    assert bench.device.angles() == stood
    assert b" home" not in bench.heard.orders()
    rig.move(Angles(30.0))
    assert bench.device.angles().pan_deg == pytest.approx(stood.pan_deg + 30.0, abs=0.01)
    rig.close()
    again = bench.open(homing="none", pan=ZaberAxis(1, 1, zero_deg=10.0))
    angles = again.status().angles
    assert angles is not None
    assert angles.pan_deg == pytest.approx(30.0, abs=1e-3)
    bench.device.brown_out()
    with pytest.raises(PositionLostError):
        again.move(Angles(0.0))
