"""The GRBL driver on the emulator, through a real pseudo-terminal: opening, homing, moving, stopping."""

import time
from dataclasses import replace

import pytest

from hardware.errors import (
    BusyError,
    LimitError,
    PositionLostError,
    RefusedError,
    SettingsError,
    StoppedError,
    WrongDeviceError,
)
from hardware.grbl.opening import GrblConfig, open_grbl
from hardware.interfaces import Angles, State
from hardware.line import Line
from hardware.virtual.grbl.dialects import FLUIDNC, GRBL
from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.wire import Wire
from tests.hardware.contracts.grbl_rigs import QUICK, SWITCHED
from tests.hardware.contracts.orders import Order, wait
from tests.hardware.grbl.bench import BARE, bare, bench, fast, let_greet, powered, switched


class Says:
    """A device that answers everything with the same bytes."""

    def __init__(self, answer: bytes):
        self._answer, self._due = answer, b""

    def receive(self, data: bytes, now: float) -> None:
        self._due = self._answer

    def advance(self, now: float) -> bytes:
        due, self._due = self._due, b""
        return due


# -- opening


def test_it_tells_its_firmware_and_port():
    with bare() as b:
        assert b.rig.name == f"GRBL 1.1h on {b.wire.port}"
        assert b.rig.status().state is State.UNHOMED
    with bare(dialect=FLUIDNC) as b:
        assert b.rig.name.startswith("FluidNC v3.7.8 on ")


def test_opening_resets_nothing_that_answers():
    with powered(GrblFirmware(QUICK)) as (wire, heard, _):
        let_greet(wire)
        rig = open_grbl(GrblConfig(wire.port))
        assert rig.name.startswith("GRBL 1.1h")
        rig.close()
        assert b"\x18" not in heard.bytes


def test_opening_waits_for_a_controller_that_boots():
    firmware = GrblFirmware(QUICK)
    with powered(firmware, hurry=2) as (wire, _, _):
        wait(lambda: firmware.advance(2 * time.monotonic()) == b"", "no power")
        firmware.brown_out()
        rig = open_grbl(GrblConfig(wire.port))
        assert rig.name.startswith("GRBL 1.1h")
        rig.close()


def test_opening_stops_what_moves():
    firmware = GrblFirmware(QUICK)
    with powered(firmware, hurry=1) as (wire, _, _):
        line = Line(wire.port, 115200)
        line.write(b"G1X400F3600\n")
        wait(lambda: firmware.angles().pan_deg > 1, "it never moved")
        line.close()
        rig = open_grbl(GrblConfig(wire.port))
        stands = firmware.angles()
        time.sleep(0.1)
        assert firmware.angles() == stands
        rig.close()


@pytest.mark.parametrize("said", [b"@01 0 RJ IDLE WR BADCOMMAND\r\n", b"\xfe\x0c\xf0\x80\x1e" * 3])
def test_another_device_is_told_by_what_was_heard(said: bytes):
    wire = Wire(Says(said))
    with pytest.raises(WrongDeviceError, match="heard '") as told:
        open_grbl(GrblConfig(wire.port), fast)
    assert ("BADCOMMAND" in str(told.value)) == said.startswith(b"@")
    wire.close()


def test_silence_is_told():
    wire = Wire(Says(b""))
    with pytest.raises(WrongDeviceError, match="nothing answers"):
        open_grbl(GrblConfig(wire.port), fast)
    wire.close()


def test_an_old_grbl_is_told_by_its_version():
    old = replace(GRBL, greeting="Grbl 0.9j ['$' for help]", build=("[VER:0.9j.20160316:{}]",))
    with (
        powered(GrblFirmware(dialect=old)) as (wire, _, _),
        pytest.raises(WrongDeviceError, match=r"0\.9j"),
    ):
        open_grbl(GrblConfig(wire.port))


def test_other_steps_than_configured_are_told_and_the_port_is_free_again():
    with powered(GrblFirmware(QUICK)) as (wire, _, _):
        with pytest.raises(SettingsError, match=r"\$100"):
            open_grbl(GrblConfig(wire.port, steps_per_deg=(88.889, 88.889)))
        open_grbl(GrblConfig(wire.port, steps_per_deg=(200.0, 200.0))).close()


def test_a_port_in_use_is_told():
    with bare() as b, pytest.raises(BusyError):
        open_grbl(GrblConfig(b.wire.port))


def test_a_feed_that_the_controller_does_not_reach_is_told():
    with bare(feed_deg_min=9000.0) as b:
        b.rig.home()
        assert "$110" in b.rig.status().message
        assert b.rig.features.axes[0].fastest_deg_s == pytest.approx(60.0)


# -- homing


def test_homing_finds_the_switch_wherever_it_starts():
    for start in (-182.0, 40.0):
        with bench(SWITCHED, switched(start), home_deg=(-184.0, 0.0)) as b:
            assert b.rig.home() == Angles(-184.0)
            assert b.truth().pan_deg == pytest.approx(-184.0, abs=0.01)
            b.rig.move(Angles(-150.0))
            assert b.truth().pan_deg == pytest.approx(-150.0, abs=0.01)


def test_without_switches_the_present_place_becomes_zero():
    with bare() as b:
        assert not b.rig.features.homes
        assert b.rig.home() == Angles(0.0)
        b.rig.move(Angles(20.0))
        assert b.rig.home() == Angles(0.0)
        b.rig.move(Angles(5.0))
        assert b.truth().pan_deg == pytest.approx(25.0)


def test_homing_that_is_switched_off_is_told_with_its_remedy():
    with bench(QUICK) as b:
        with pytest.raises(RefusedError, match=r"error:5, .*\$22=1.*homing=none"):
            b.rig.home()
        assert b.rig.status().state is State.UNHOMED


def test_a_missing_switch_is_told_and_leaves_it_lost():
    with bench({**SWITCHED, 130: 20.0}) as b:
        with pytest.raises(PositionLostError, match="ALARM:9"):
            b.rig.home()
        assert b.rig.status().state is State.FAULT
        with pytest.raises(PositionLostError):
            b.rig.move(Angles(0.0))


def test_homing_stops_at_once_and_can_be_done_again():
    with bench({**SWITCHED, 25: 1200.0}, switched(100.0), hurry=5, home_deg=(-184.0, 0.0)) as b:
        order = Order(b.rig.home)
        wait(lambda: b.truth().pan_deg < 99.0, "it never began to home")
        assert b.rig.status().state is State.HOMING
        b.rig.stop()
        assert isinstance(order.finished(), StoppedError)
        stands = b.truth()
        time.sleep(0.1)
        assert b.truth() == stands
        assert stands.pan_deg > -100
        with pytest.raises(PositionLostError):
            b.rig.move(Angles(0.0))
        b.firmware.memory.settings[25] = 36000.0
        assert b.rig.home() == Angles(-184.0)


# -- moving


def test_the_controllers_own_travel_limits_too():
    with bench({**SWITCHED, 130: 200.0}, switched(), home_deg=(-184.0, 0.0)) as b:
        assert "$130" in b.rig.status().message or b.rig.status().state is State.UNHOMED
        b.rig.home()
        assert "$130" in b.rig.status().message
        before = b.heard.orders()
        with pytest.raises(LimitError):
            b.rig.move(Angles(16.0))  # the switch sits at -185, so the controller's travel ends at 15
        assert b.heard.orders() == before
        assert b.rig.move(Angles(14.9)).pan_deg == pytest.approx(14.9)


@pytest.mark.parametrize("settings", [{10: 0}, {10: 3}, {13: 1}, {10: 2, 13: 1}])
def test_every_way_of_reporting_is_understood(settings: dict[int, float]):
    with bench({**SWITCHED, **settings}, switched(), home_deg=(-184.0, 0.0)) as b:
        assert b.rig.home().pan_deg == pytest.approx(-184.0, abs=0.003)
        assert b.rig.move(Angles(-100.25)).pan_deg == pytest.approx(-100.25, abs=0.003)
        assert b.truth().pan_deg == pytest.approx(-100.25, abs=0.01)


def test_backlash_is_taken_up_from_below_whatever_comes_before():
    play = 0.6
    with bench(SWITCHED, switched(play=play), home_deg=(-184.0 - play, 0.0), backlash_deg=(0.8, 0.0)) as b:
        b.rig.home()
        assert b.rig.features.axes[0].lowest_deg == pytest.approx(-179.2)
        for target in (-170.0, -175.0, -175.0, -160.0, -160.3, -179.2):
            b.rig.move(Angles(target))
            assert b.truth().pan_deg == pytest.approx(target, abs=0.01)


def test_going_on_upwards_takes_no_detour():
    with bench(SWITCHED, switched(play=0.6), home_deg=(-184.6, 0.0), backlash_deg=(0.8, 0.0)) as b:
        b.rig.home()
        b.rig.move(Angles(-170.0))
        for target, lines in ((-160.0, 1), (-160.0, 1), (-159.9, 1), (-165.0, 2), (-164.0, 1)):
            before = b.heard.bytes.count(b"G1X")
            b.rig.move(Angles(target))
            assert b.heard.bytes.count(b"G1X") - before == lines
            assert b.truth().pan_deg == pytest.approx(target, abs=0.01)


def test_without_taking_it_up_backlash_would_show():
    with bench(SWITCHED, switched(play=0.6), home_deg=(-184.6, 0.0)) as b:
        b.rig.home()
        b.rig.move(Angles(-170.0))
        b.rig.move(Angles(-175.0))
        assert b.truth().pan_deg == pytest.approx(-174.4, abs=0.01)


def test_an_endless_table_goes_on_over_a_turn_and_back():
    with bare() as b:
        b.rig.home()
        for target in (350.0, 725.5, -3.0):
            assert b.rig.move(Angles(target)).pan_deg == pytest.approx(target)
            assert b.truth().pan_deg == pytest.approx(target)
        with pytest.raises(LimitError):
            b.rig.move(Angles(36_001.0))


class Wrapped(GrblFirmware):
    """A controller that tells pan modulo 360, as some rotary axes do."""

    def advance(self, now: float) -> bytes:
        said = super().advance(now)
        if b"MPos:" not in said:
            return said
        lines = []
        for line in said.split(b"\r\n"):
            if line.startswith(b"<"):
                head, _, rest = line.partition(b"MPos:")
                pan, _, rest = rest.partition(b",")
                line = head + b"MPos:" + f"{float(pan) % 360:.3f}".encode() + b"," + rest
            lines.append(line)
        return b"\r\n".join(lines)


def test_a_controller_that_counts_to_360_is_unwrapped():
    with powered(Wrapped(QUICK)) as (wire, _, faults):
        rig = open_grbl(GrblConfig(wire.port, feed_deg_min=3600.0, wrap=True, **BARE))
        rig.home()
        for target in (300.0, 500.0, -30.0):
            assert rig.move(Angles(target)).pan_deg == pytest.approx(target)
            assert faults.firmware.angles().pan_deg == pytest.approx(target)
            assert rig.status().angles == Angles(target)
        rig.close()


def test_more_lines_than_its_buffer_holds_are_streamed_without_loss():
    with bare() as b:
        b.rig.home()
        link = b.rig._link  # the streaming itself, of which a move needs little
        link.exchange(
            [f"G91G1X0.1F3600(line {number} of forty)" for number in range(40)], 30.0, lambda _: None
        )
        link.exchange(["G90", "G4P0.01"], 30.0, lambda _: None)
        assert b.truth().pan_deg == pytest.approx(4.0)


# -- stopping, holding


def test_a_stop_keeps_the_position():
    with bare(hurry=2) as b:
        b.rig.home()
        order = b.under_way(Angles(200.0))
        b.rig.stop()
        assert isinstance(order.finished(), StoppedError)
        status = b.rig.status()
        assert status.state is State.IDLE
        assert status.angles is not None
        assert status.angles.pan_deg == pytest.approx(b.truth().pan_deg, abs=0.01)
        assert b.rig.move(Angles(10.0)) == Angles(10.0)
        assert b.truth().pan_deg == pytest.approx(10.0)


def test_stops_in_quick_succession_keep_the_position():
    with bare(hurry=2) as b:
        b.rig.home()
        for _ in range(3):
            order = b.under_way(Angles(200.0))
            while order.is_alive():  # some come while it is being halted, some while it starts again
                b.rig.stop()
                time.sleep(0.03)
            assert isinstance(order.finished(), StoppedError)
            assert b.rig.move(Angles(0.0)) == Angles(0.0)
            assert b.truth().pan_deg == pytest.approx(0.0, abs=0.01)


def test_after_a_stop_resume_moves_nothing():
    with bare(hurry=2) as b:
        b.rig.home()
        order = b.under_way(Angles(200.0))
        b.rig.stop()
        b.rig.resume()
        assert isinstance(order.finished(), StoppedError)
        stands = b.truth()
        b.rig.resume()
        time.sleep(0.1)
        assert b.truth() == stands


def test_a_resume_right_after_hold_is_not_lost():
    with bare({**QUICK, 120: 30.0}, hurry=4) as b:  # takes 2 s to slow down: GRBL ignores `~` meanwhile
        b.rig.home()
        order = b.under_way(Angles(90.0))
        wait(lambda: b.truth().pan_deg > 20.0, "it never came so far")
        b.rig.hold()
        b.rig.resume()
        assert order.finished() == Angles(90.0)


def test_a_long_hold_costs_no_deadline():
    skipped_s = 0.0
    with bare(clock=lambda: time.monotonic() + skipped_s, hurry=4) as b:
        b.rig.home()
        order = b.under_way(Angles(300.0))
        b.rig.hold()
        wait(lambda: b.rig.status().state is State.HELD, "it was never held")
        skipped_s = 3600.0
        time.sleep(0.3)
        assert order.is_alive()
        b.rig.resume()
        assert order.finished() == Angles(300.0)


def test_a_hold_at_the_machine_is_told_and_ended_by_resume():
    with bare() as b:
        b.rig.home()
        b.faults.receive(b"!", 20 * time.monotonic())
        wait(lambda: b.rig.status().state is State.HELD, "it was never held")
        with pytest.raises(RefusedError, match="Hold"):
            b.rig.move(Angles(1.0))
        b.rig.resume()
        assert b.rig.move(Angles(1.0)) == Angles(1.0)


def test_two_threads_may_ask_for_the_state():
    with bare() as b:
        b.rig.home()
        seen = set()
        orders = [Order(lambda: seen.update(b.rig.status().state for _ in range(20))) for _ in range(2)]
        for order in orders:
            order.finished()
        assert seen == {State.IDLE}
