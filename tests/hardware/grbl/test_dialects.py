"""The GRBL driver on the emulator as grblHAL and FluidNC speak: what neither says as GRBL itself does."""

import time
from dataclasses import replace

import pytest

from hardware.errors import PositionLostError, RefusedError, SettingsError
from hardware.grbl.opening import GrblConfig, open_grbl
from hardware.interfaces import Angles, State
from hardware.virtual.grbl.dialects import FLUIDNC, GRBL, GRBLHAL, Dialect
from hardware.virtual.grbl.firmware import GrblFirmware
from tests.hardware.contracts.grbl_rigs import QUICK, SWITCHED
from tests.hardware.contracts.orders import wait
from tests.hardware.grbl.bench import BARE, SWITCHES, bare, fast, let_greet, powered, switched, with_switches

TALKATIVE = replace(GRBLHAL, axes=8, fields="|SP1:0,,|FW:grblHAL|AR")
GREETINGS = [
    replace(FLUIDNC, greeting=text, boot=("ets Jul 29 2019 12:21:46",)) for text in ("My rig is ready", "")
]


@pytest.mark.parametrize("dialect", [TALKATIVE, *GREETINGS], ids=["grblHAL", "own greeting", "no greeting"])
def test_it_homes_moves_and_stops_whatever_it_says_besides(dialect: Dialect):
    with with_switches(dialect=dialect, hurry=5) as b:
        assert b.rig.name.startswith("grblHAL 1.1f" if dialect is TALKATIVE else "FluidNC v3.7.8")
        assert b.rig.home() == Angles(-184.0)
        order = b.under_way(Angles(150.0))
        b.rig.stop()
        with pytest.raises(Exception, match="stopped on request"):
            raise order.finished()
        assert b.rig.move(Angles(-150.0)) == Angles(-150.0)
        assert b.truth().pan_deg == pytest.approx(-150.0, abs=0.01)


def test_an_unasked_start_is_heard_whatever_the_greeting():
    rig_file = ("[MSG:INFO: FluidNC v3.7.8 https://github.com/bdring/FluidNC]",)
    with bare(dialect=replace(FLUIDNC, greeting="My rig is ready", boot=rig_file)) as b:
        b.rig.home()
        b.firmware.brown_out()
        wait(lambda: b.rig.status().state is State.FAULT, "it was never told")
        assert "reset or lost power" in b.rig.status().message


@pytest.mark.parametrize("dialect", [GRBL, GRBLHAL, FLUIDNC])
def test_opening_wakes_every_firmware_that_a_limit_locked(dialect: Dialect):
    firmware = GrblFirmware(QUICK, dialect=dialect)
    with powered(firmware) as (wire, _, _):
        let_greet(wire)
        firmware.hit_limit()
        rig = open_grbl(GrblConfig(wire.port, **BARE))
        assert rig.home() == Angles(0.0)
        rig.close()


def test_a_lock_that_only_homing_ends_is_told_to_a_rig_without_switches():
    with (
        bare({**QUICK, 22: 1}, dialect=GRBLHAL) as b,
        pytest.raises(PositionLostError, match=r"error:46, homing required .*\$22=0"),
    ):
        b.rig.home()


def test_an_alarm_that_a_report_tells_by_number_is_told_by_name():
    with with_switches(dialect=GRBLHAL) as b:
        b.rig.home()
        b.firmware.hit_limit()
        with pytest.raises(PositionLostError, match="ALARM:1, hard limit"):
            b.rig.move(Angles(0.0))
        assert b.rig.home() == Angles(-184.0)


class Booting(GrblFirmware):
    """Looks for its network for so long, and tells only of that."""

    until_s = 0.0

    def receive(self, data: bytes, now: float) -> None:
        if now > self.until_s:
            super().receive(data, now)

    def advance(self, now: float) -> bytes:
        return super().advance(now) if now > self.until_s else b"[MSG:INFO: Connecting to WiFi]\r\n"


def test_opening_waits_for_a_controller_that_tells_of_its_start():
    firmware = Booting(QUICK, dialect=FLUIDNC)
    firmware.until_s = fast() + 12.0
    with powered(firmware) as (wire, heard, _):
        rig = open_grbl(GrblConfig(wire.port, **BARE), fast)
        assert rig.name.startswith("FluidNC v3.7.8")
        assert b"\x18" not in heard.bytes
        rig.close()


class Unasked(GrblFirmware):
    """A controller that tells its state all the time, as grblHAL does with $481, and messages between."""

    def advance(self, now: float) -> bytes:
        self.receive(b"?", now)
        said = super().advance(now)
        return said.replace(b"\r\n<", b"\r\n[MSG:INFO: between]\r\n[GC:G0 G54]\r\n[echo: G1]\r\n<")


def test_reports_and_messages_that_nobody_asked_for_do_no_harm():
    with powered(Unasked(SWITCHED, switched(), dialect=GRBLHAL, homes=(0,)), hurry=5) as (wire, _, faults):
        rig = open_grbl(GrblConfig(wire.port, feed_deg_min=3600.0, **SWITCHES))
        rig.home()
        for target in (-150.0, -170.0):
            assert rig.move(Angles(target)) == Angles(target)
            assert faults.firmware.angles().pan_deg == pytest.approx(target, abs=0.01)
        rig.close()


def test_an_axis_that_the_controller_lacks_is_told():
    with (
        powered(GrblFirmware(QUICK, dialect=replace(FLUIDNC, axes=1))) as (wire, _, _),
        pytest.raises(SettingsError, match="has 1 axis, axes= in the device URL names more"),
    ):
        open_grbl(GrblConfig(wire.port, axes="xy"))


class Changing(GrblFirmware):
    """Waits for a tool, whatever happens, until it is reset."""

    waits = True

    def receive(self, data: bytes, now: float) -> None:
        self.waits = self.waits and b"\x18" not in data
        super().receive(data, now)

    def advance(self, now: float) -> bytes:
        said = super().advance(now)
        return said.replace(b"<Idle|", b"<Tool|") if self.waits else said


def test_opening_ends_a_tool_change_and_a_move_names_one():
    firmware = Changing(QUICK, dialect=GRBLHAL)
    with powered(firmware) as (wire, _, _):
        began = time.monotonic()
        rig = open_grbl(GrblConfig(wire.port, **BARE))
        assert not firmware.waits
        assert time.monotonic() - began < 5.0
        rig.home()
        firmware.waits = True
        with pytest.raises(RefusedError, match="state Tool; end the hold, door, check mode or tool change"):
            rig.move(Angles(5.0))
        rig.close()
