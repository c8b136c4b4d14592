"""`roomlight rig` on emulated controllers: a rig that cannot find its zero is moved once a person says it stands there."""

import time
from collections.abc import Iterator

import pytest

from app.cli import main
from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.grbl.motion import Mechanics
from hardware.virtual.wire import Wire
from hardware.virtual.zaber.axis import Stage
from hardware.virtual.zaber.firmware import ZaberFirmware
from tests.hardware.contracts.grbl_rigs import QUICK, SWITCHED


def powered(device: GrblFirmware | ZaberFirmware) -> Iterator[tuple[GrblFirmware | ZaberFirmware, str]]:
    wire = Wire(device, lambda: 20 * time.monotonic())
    yield device, wire.port
    wire.close()


@pytest.fixture
def bare() -> Iterator[tuple[GrblFirmware, str]]:
    """A turntable without limit switches, opened as each command opens it: in a program of its own."""
    for device, port in powered(GrblFirmware(QUICK)):
        yield device, f"grbl://{port}?homing=none&pan=endless"


def test_a_rig_without_switches_moves_once_it_is_said_to_stand_at_zero(bare, capsys: pytest.CaptureFixture):
    device, url = bare
    assert main(["rig", "move", url, "--pan", "30"]) == 2
    told = capsys.readouterr().err
    assert "cannot find its zero by itself; turn it there by hand, then move with --at-zero" in told
    assert device.angles().pan_deg == 0.0
    assert main(["rig", "move", url, "--pan", "30", "--at-zero"]) == 0
    assert "stands at pan 30.000" in capsys.readouterr().out
    assert device.angles().pan_deg == pytest.approx(30.0)
    # The controller still counts, but it counts the same after its power was cut and its table turned: not believed.
    assert main(["rig", "move", url, "--pan", "40"]) == 2
    device.brown_out(slip_deg=-30.0)
    assert main(["rig", "move", url, "--pan", "-5", "--at-zero"]) == 0
    assert device.angles().pan_deg == pytest.approx(-5.0)


def test_home_says_that_it_found_no_zero_but_took_one(bare, capsys: pytest.CaptureFixture):
    assert main(["rig", "home", bare[1]]) == 0
    assert "takes where it stands for pan 0.000" in capsys.readouterr().out


def test_a_rig_with_switches_homes_whatever_is_said(capsys: pytest.CaptureFixture):
    ends = Mechanics((-185.0, None, None), (185.0, None, None), start=(-182.0, 0.0, 0.0))
    for device, port in powered(GrblFirmware(SWITCHED, ends, homes=(0,))):
        assert main(["rig", "move", f"grbl://{port}?home=-184,0", "--pan", "-150", "--at-zero"]) == 0
        assert "homing first" in capsys.readouterr().out
        assert device.angles().pan_deg == pytest.approx(-150.0, abs=0.01)


def test_stages_without_a_sensor_move_too_and_keep_their_zero(capsys: pytest.CaptureFixture):
    for device, port in powered(
        ZaberFirmware([Stage(fastest_deg_s=60.0, accel_deg_s2=200.0, stands_deg=3.0)])
    ):
        url = f"zaber://{port}?homing=none"
        assert main(["rig", "move", url, "--pan", "30"]) == 2
        assert "then move with --at-zero" in capsys.readouterr().err
        assert main(["rig", "move", url, "--pan", "30", "--at-zero"]) == 0
        assert main(["rig", "move", url, "--pan", "40"]) == 0
        assert device.angles().pan_deg == pytest.approx(43.0, abs=0.01)
