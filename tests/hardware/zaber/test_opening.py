import grp
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from hardware.errors import (
    AbsentError,
    AccessError,
    BusyError,
    SettingsError,
    WrongDeviceError,
)
from hardware.interfaces import State
from hardware.virtual.wire import Wire
from hardware.virtual.zaber.firmware import ZaberFirmware
from hardware.zaber.opening import ZaberAxis, ZaberConfig, open_zaber
from tests.hardware.zaber.bench import NEAR, PAN, Bench


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


# ---- what is plugged in


def test_answers_carry_checksums_from_the_beginning_and_are_not_believed_without(bench: Bench):
    rig = bench.open()
    assert b"set comm.checksum 1" in bench.heard.bytes
    bench.device._device["comm.checksum"] = 0
    assert rig.status().state is State.OFFLINE


def test_a_device_that_knows_no_checksums_is_believed_without(bench: Bench):
    bench.device._device.pop("comm.checksum")
    bench.device._device["comm.checksum"] = 0
    original = bench.device._set

    def refuse(number, axes, words):
        from hardware.virtual.zaber.axis import Refused

        if "comm.checksum" in words:
            raise Refused("BADCOMMAND")
        return original(number, axes, words)

    bench.device._set = refuse
    rig = bench.homed()
    rig.move(NEAR)


def test_another_serial_number_is_not_the_device_named(bench: Bench):
    with pytest.raises(WrongDeviceError, match="has serial number 81234, not 5"):
        bench.open(serial=5)
    bench.open(serial=81234)


def test_silence_is_no_zaber_device(bench: Bench):
    bench.faults.silence()
    with pytest.raises(WrongDeviceError, match="nothing there answers as a Zaber device with address 1"):
        bench.open(reply_s=0.05)


def test_another_kind_of_device_is_not_taken_for_one():
    class Grbl:
        def __init__(self) -> None:
            self._out = b"\r\nGrbl 1.1h ['$' for help]\r\n"

        def receive(self, data: bytes, now: float) -> None:
            self._out += b"error:20\r\n" * data.count(b"\n")

        def advance(self, now: float) -> bytes:
            out, self._out = self._out, b""
            return out

    wire = Wire(Grbl())
    try:
        with pytest.raises(WrongDeviceError, match="not another kind of device"):
            open_zaber(ZaberConfig(wire.port, reply_s=0.05))
    finally:
        wire.close()


def test_a_wrong_baud_rate_is_told(bench: Bench):
    """At another rate the bytes arrive as others; the message names the rate."""
    bench.faults.noise(0.8)
    with pytest.raises(WrongDeviceError, match="115200 baud"):
        bench.open(reply_s=0.05)


def test_too_old_a_firmware_is_told():
    wire = Wire(ZaberFirmware([PAN], version="5.33"))
    try:
        with pytest.raises(WrongDeviceError, match=r"5\.33.*6\.06"):
            open_zaber(ZaberConfig(wire.port))
    finally:
        wire.close()


def test_an_axis_it_lacks_is_told(bench: Bench):
    with pytest.raises(SettingsError, match="has 2 of them"):
        bench.open(tilt=ZaberAxis(1, 3))


def test_a_stage_that_tells_no_scale_needs_one(bench: Bench):
    bench.device.axes[0].settings.pop("limit.cycle.dist")
    with pytest.raises(SettingsError, match="say steps="):
        bench.open()
    bench.open(pan=ZaberAxis(steps_per_deg=1000.0))


def test_a_port_that_is_not_there_is_told():
    with pytest.raises(AbsentError, match="no such port"):
        open_zaber(ZaberConfig("/dev/ttyNOPE"))


def test_a_port_in_use_is_told_with_the_program_that_holds_it(bench: Bench):
    code = f"import serial, time; s = serial.Serial({bench.wire.port!r}, exclusive=True); print('open', flush=True); time.sleep(60)"
    holder = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None
        holder.stdout.readline()
        with pytest.raises(BusyError, match=rf"process {holder.pid}"):
            bench.open()
    finally:
        holder.kill()
        holder.wait()


def test_a_port_without_permission_is_told_with_its_group(bench: Bench):
    group = grp.getgrgid(os.stat(bench.wire.port).st_gid).gr_name
    os.chmod(bench.wire.port, 0)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)  # nobody: root may open everything
    try:
        with pytest.raises(AccessError, match=f"usermod -aG {group} "):
            bench.open()
    finally:
        if root:
            os.seteuid(0)


def test_an_opening_that_fails_lets_go_of_the_port(bench: Bench):
    for _ in range(2):
        with pytest.raises(WrongDeviceError):
            bench.open(serial=5)
    bench.open()


# ---- device URLs


def test_a_query_is_read():
    config = ZaberConfig.from_query(
        "/dev/x",
        {
            "axes": "1.1,2.1",
            "tilt": "-40..60",
            "zero": "0,90",
            "steps": "1000,-2000",
            "serial": "7",
            "baud": "9600",
        },
    )
    assert config == ZaberConfig(
        "/dev/x", 9600, ZaberAxis(1, 1, 1000.0), ZaberAxis(2, 1, -2000.0, 90.0, -40.0, 60.0), 7
    )
    assert ZaberConfig.from_query("/dev/x", {}) == ZaberConfig("/dev/x")
    assert ZaberConfig.from_query("/dev/x", {"steps": "5"}).pan.steps_per_deg == 5.0


@pytest.mark.parametrize(
    "query",
    [{"axes": "1"}, {"axes": "1.1,1.1"}, {"axes": "1.1,1.2,1.3"}, {"baud": "fast"}, {"baud": "0"}, {"pan": "5"},
     {"pan": "5..-5"}, {"pan": "nan..5"}, {"steps": "0"}, {"steps": "inf"}, {"zero": "1,2,3"}, {"serial": "-1"},
     {"tilt": "-5..5"}],
)  # fmt: skip
def test_a_word_that_cannot_be_meant_is_told_with_an_example(query: dict[str, str]):
    with pytest.raises(SettingsError, match=f"{next(iter(query))}=.*like"):
        ZaberConfig.from_query("/dev/x", query)


def test_an_unknown_word_lists_those_there_are():
    with pytest.raises(SettingsError, match=r"'speed'.*axes, baud, homing, pan, serial, steps, tilt, zero"):
        ZaberConfig.from_query("/dev/x", {"speed": "5"})
