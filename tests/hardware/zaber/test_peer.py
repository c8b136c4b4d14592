"""The manufacturer's own host software drives our emulated controller: what it believes of it is what we meant.

`zaber-motion` looks products up in an online database; where it cannot, units and names are not known, and everything
that is shown here works without them, in microsteps.
"""

import time
from collections.abc import Iterator

import pytest

from hardware.virtual.wire import Wire
from hardware.virtual.zaber.axis import Stage
from hardware.virtual.zaber.firmware import Chain, ZaberFirmware
from tests.hardware.contracts.orders import Order, wait

pytest.importorskip("zaber_motion", reason="the manufacturer's host software is not installed")

from zaber_motion import (
    BadCommandException,
    BadDataException,
    DriverDisabledException,
    MovementFailedException,
    MovementInterruptedException,
)
from zaber_motion.ascii import Connection, MessageType, WarningFlags

HURRY = 20
STAGE = Stage(fastest_deg_s=60.0, accel_deg_s2=400.0, stands_deg=12.0)


@pytest.fixture
def device() -> ZaberFirmware:
    return ZaberFirmware([STAGE, STAGE])


@pytest.fixture
def host(device: ZaberFirmware) -> Iterator[Connection]:
    second = ZaberFirmware([STAGE], address=2, serial=81235)
    wire = Wire(Chain([device, second]), lambda: HURRY * time.monotonic())
    with Connection.open_serial_port(wire.port) as connection:
        yield connection
    wire.close()


def test_it_finds_the_devices_on_the_cable(host: Connection):
    found = host.detect_devices(identify_devices=False)
    assert [one.device_address for one in found] == [1, 2]


def test_it_reads_what_identifies_a_device(host: Connection):
    settings = host.get_device(1).settings
    assert settings.get("system.serial") == 81234
    assert settings.get("deviceid") == 30222
    assert settings.get("system.axiscount") == 2
    assert host.get_device(2).settings.get("system.serial") == 81235


def test_it_sees_the_reference_missing_homes_and_sees_it_there(host: Connection, device: ZaberFirmware):
    axis = host.get_device(1).get_axis(1)
    assert axis.warnings.get_flags() == {WarningFlags.NO_REFERENCE_POSITION, WarningFlags.DEVICE_NOT_HOMED}
    axis.home()
    assert axis.warnings.get_flags() == set()
    assert axis.is_homed()
    assert axis.get_position() == 0
    assert device.angles().pan_deg == 0.0


def test_it_moves_and_reads_where_it_stands(host: Connection, device: ZaberFirmware):
    axis = host.get_device(1).get_axis(2)
    axis.home()
    axis.move_absolute(90000)
    assert axis.get_position() == 90000
    assert device.angles().tilt_deg == pytest.approx(90000 / STAGE.steps_per_deg)
    axis.move_relative(-1000)
    assert axis.get_position() == 89000
    axis.move_max(wait_until_idle=False)
    assert axis.is_busy()
    axis.stop()
    assert not axis.is_busy()


def test_it_raises_its_own_error_for_a_stall(host: Connection, device: ZaberFirmware):
    axis = host.get_device(1).get_axis(1)
    axis.home()
    device.stall(1)
    with pytest.raises(MovementFailedException) as caught:
        axis.move_absolute(500000)
    assert WarningFlags.STALLED_AND_STOPPED in caught.value.details.warnings


def test_it_raises_its_own_error_for_a_move_that_somebody_stopped(host: Connection):
    axis = host.get_device(1).get_axis(1)
    axis.home()

    def move() -> object:
        try:
            return axis.move_absolute(50_000_000)
        except MovementInterruptedException as error:
            return error

    order = Order(move)
    wait(axis.is_busy, "it never began to move")
    host.stop_all()
    assert isinstance(order.finished(), MovementInterruptedException)


def test_it_knows_our_rejections_as_its_own(host: Connection, device: ZaberFirmware):
    axis = host.get_device(1).get_axis(1)
    with pytest.raises(BadDataException):
        axis.move_absolute(2_000_000_000)
    with pytest.raises(BadCommandException):
        host.get_device(1).generic_command("no such thing")
    device.press_estop()
    with pytest.raises(DriverDisabledException):
        axis.move_absolute(5)


def test_it_reads_answers_that_come_in_several_packets(host: Connection):
    text = "abcdefghijklmnopqrstuvwxyz abcdefghijklmnopqrstuvwxyz 1234"
    assert host.get_device(1).generic_command(f"tools echo {text}").data == text
    replies = host.get_device(1).generic_command_multi_response("help")
    assert {reply.message_type for reply in replies} == {MessageType.REPLY, MessageType.INFO}


def test_it_reads_answers_with_checksums(host: Connection):
    host.generic_command("set comm.checksum 1", device=1)
    assert host.generic_command("tools echo checked", device=1).data == "checked"


def test_it_renumbers_the_devices(host: Connection):
    assert host.renumber_devices(first_address=5) == 2
    assert [one.device_address for one in host.detect_devices(identify_devices=False)] == [5, 6]
