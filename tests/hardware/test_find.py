import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import rawpy

from hardware import find
from hardware.errors import (
    AbsentError,
    HardwareError,
    LimitError,
    PositionLostError,
    SettingsError,
    StoppedError,
    WrongDeviceError,
)
from hardware.interfaces import Angles, Bracket, Exposure, Geometry, Motion, State
from hardware.manual import Handheld, Manual
from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.studio import motion
from hardware.virtual.wire import Firmware, Wire
from hardware.virtual.zaber.firmware import ZaberFirmware
from tests.hardware.contracts.orders import PATIENCE_S, Order, wait

BRACKET = Bracket(Exposure(None), (-1.0, 0.0, 1.0))


def test_importing_it_loads_no_driver_and_no_array_library():
    code = "import sys; import hardware.find; print([n for n in ('numpy', 'serial', 'gphoto2', 'hardware.grbl.opening') if n in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


# ---- ports


@dataclass
class Listed:
    device: str
    description: str | None = "n/a"
    hwid: str | None = "n/a"
    vid: int | None = None


def test_ports_are_those_with_something_behind_them_likely_rigs_first():
    found = find.ports(
        lambda: [
            Listed("/dev/ttyS0"),
            Listed("/dev/ttyUSB3", "Modem", "USB VID:PID=1234:5678", 0x1234),
            Listed("/dev/ttyUSB1", "USB Serial", "USB VID:PID=1A86:7523", 0x1A86),
            Listed("/dev/ttyACM0", None, "USB VID:PID=2939:495B", 0x2939),
        ]
    )
    assert found == (
        find.Port("/dev/ttyACM0", "USB VID:PID=2939:495B", "zaber"),
        find.Port("/dev/ttyUSB1", "USB Serial", "grbl"),
        find.Port("/dev/ttyUSB3", "Modem", ""),
    )


def test_this_machines_ports_can_be_listed():
    assert isinstance(find.ports(), tuple)


# ---- rigs by URL


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("grbl", "is no device URL of a rig"),
        ("/dev/ttyUSB0", r"possible are grbl:///dev/ttyUSB0\?axes=xy, zaber:///.*, manual:, none:, virtual:"),
        ("lego:///dev/x", "no rig of the kind 'lego'; possible are grbl:"),
        ("gphoto2:", "no rig of the kind 'gphoto2'"),
        ("grbl:", "which port"),
        ("grbl://dev/ttyUSB0", "three slashes, as in grbl:///dev/ttyUSB0"),
        (
            "grbl:///dev/x?speed=3",
            "unknown setting 'speed'.* axes, .*, and of every rig settle, file, pan_axis",
        ),
        ("zaber:///dev/x?speed=3", "unknown setting 'speed'.* axes, .*, and of every rig settle"),
        ("zaber:///dev/x?baud=fast", "baud=fast cannot be meant; write it like baud=115200"),
        ("manual:x", "write manual:"),
        ("manual:?tilt=perhaps", "tilt=perhaps.*tilt=no"),
        ("none:?speed=3", "unknown setting 'speed'.* none, and of every rig"),
        ("virtual:lego", "possible are virtual:grbl, virtual:zaber, virtual:hands"),
        ("virtual:?speed=0", "speed=0 cannot be meant"),
        ("virtual:?kind=crane", "kind=turntable or kind=gimbal"),
        ("virtual:?speed", "'speed' is no setting"),
        ("virtual:?seed=1&seed=2", "seed= is said twice"),
        ("virtual:?settle=-1", "settle=-1 cannot be meant"),
    ],
)
def test_a_url_that_cannot_be_meant_is_told_with_what_is_possible(url: str, reason: str):
    with pytest.raises(SettingsError, match=reason):
        find.open_motion(url)


@pytest.fixture
def wired() -> Iterator[list[Wire]]:
    wires: list[Wire] = []
    yield wires
    for wire in wires:
        wire.close()


def port(wired: list[Wire], firmware: Firmware) -> str:
    wired.append(Wire(firmware))
    return wired[-1].port


def test_a_grbl_and_a_zaber_url_open_their_drivers(wired: list[Wire]):
    grbl = find.open_motion(f"grbl://{port(wired, GrblFirmware())}?axes=xy&homing=none&pan=endless")
    zaber = find.open_motion(f"zaber://{port(wired, ZaberFirmware())}?axes=1.1,1.2&tilt=-20..20")
    assert "GRBL" in grbl.name
    assert "Zaber" in zaber.name
    assert zaber.features.axes[1].highest_deg == 20.0
    grbl.close()
    zaber.close()


def test_a_device_that_is_not_the_one_named_is_told(wired: list[Wire]):
    with pytest.raises(WrongDeviceError, match="not another kind of device"):
        find.open_motion(f"zaber://{port(wired, GrblFirmware())}")


def test_a_port_that_is_not_there_is_told():
    with pytest.raises(AbsentError, match="no such port"):
        find.open_motion("grbl:///dev/ttyNOPE")
    with pytest.raises(AbsentError, match="no such port"):
        find.open_motion("zaber:///dev/tty%4EOPE")


def test_manual_and_none_open_rigs_without_a_motor():
    rig = find.open_motion("manual:?tilt=no", ask=lambda request: request.confirm())
    assert isinstance(rig, Manual)
    assert len(rig.features.axes) == 1
    assert rig.move(Angles(10.0)) == Angles(10.0)
    assert len(find.open_motion("manual:").features.axes) == 2
    assert isinstance(find.open_motion("none:"), Handheld)


# ---- cameras by URL


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("nikon:", "no camera of the kind 'nikon'; possible are gphoto2: .*folder:.*virtual:"),
        ("gphoto2:?speed=3", "unknown setting 'speed' in the device URL; there are to, wait"),
        ("gphoto2:?to=disk", "to=disk cannot be meant; write it like to=card"),
        ("folder:", "which one"),
        ("folder:/tmp?bracket=0", "bracket=0 cannot be meant"),
        ("virtual:x", "nothing stands after the colon"),
        ("virtual:?room=cellar", "no room called 'cellar'; choose one of study"),
        ("virtual:?room=study&object=cube", "no object called 'cube'; choose one of sphere"),
        ("virtual:?object=blob", "an object stands in a room"),
        ("virtual:?size=big", "size=big cannot be meant; write it like size=320x240"),
        ("virtual:?size=15x15", "Bayer"),
    ],
)
def test_a_camera_url_that_cannot_be_meant_is_told(url: str, reason: str):
    with pytest.raises(SettingsError, match=reason):
        find.open_camera(url)


def test_a_folder_url_opens_a_watched_folder(tmp_path: Path):
    folder = tmp_path / "with space"
    folder.mkdir()
    camera = find.open_camera(f"folder:{tmp_path}/with%20space?suffix=.cr3&bracket=3&wait=5")
    assert camera.features.suffix == ".cr3"
    assert not camera.features.sets_exposure
    camera.close()
    with pytest.raises(AbsentError):
        find.open_camera(f"folder:{tmp_path}/missing")


def test_a_virtual_camera_stands_where_it_is_told(tmp_path: Path):
    asked = []

    def where() -> Angles:
        asked.append(True)
        return Angles(40.0)

    camera = find.open_camera("virtual:?size=32x32", where)
    (taken,) = camera.expose(Bracket(Exposure(None), (0.0,)))
    assert asked
    assert camera.download(taken, tmp_path / "a.dng").bytes > 2 * 32 * 32
    camera.close()


# ---- whole rigs


@pytest.mark.parametrize("controller", ["grbl", "zaber"])
def test_a_virtual_rig_needs_nothing_and_its_camera_sees_where_it_truly_stands(
    controller: str, tmp_path: Path
):
    rig = find.open_rig(f"virtual:{controller}?speed=200", "virtual:?size=64x48")
    try:
        rig.home()
        files = []
        for number, pan in enumerate((0.0, 90.0, 0.0)):
            folder = tmp_path / str(number)
            folder.mkdir()
            shot = rig.take(Angles(pan, 10.0), BRACKET, folder)
            assert shot.angles is not None
            assert shot.angles.pan_deg == pytest.approx(pan, abs=0.02)
            files.append(shot.frames[1].path)
        assert _unlike(files[0], files[1]) > 3 * _unlike(files[0], files[2])
        assert rig.geometry == motion.geometry_of("gimbal")
    finally:
        rig.close()


def _unlike(a: Path, b: Path) -> float:
    one, other = counts(a), counts(b)
    return float(np.abs(one - other).mean())


def counts(file: Path) -> np.ndarray:
    with rawpy.imread(str(file)) as raw:
        return raw.raw_image.astype(float)


def test_a_virtual_turntable_does_not_tilt():
    rig = find.open_rig("virtual:?kind=turntable&speed=200", "virtual:?size=16x16")
    rig.home()
    with pytest.raises(LimitError, match="tilt"):
        rig.go(Angles(10.0, 5.0))
    assert rig.geometry == motion.geometry_of("turntable")
    rig.close()


def test_virtual_hands_hold_it_another_way_each_time(tmp_path: Path):
    rig = find.open_rig("virtual:hands", "virtual:?size=16x16")
    places = set()
    for _ in range(5):
        assert rig.go(None) is None
        places.add(rig.motion.angles())
    assert len(places) == 5
    assert rig.geometry is None
    rig.close()


def test_settle_time_and_geometry_come_from_the_url():
    rig = find.open_rig("none:?settle=2.5&pan_axis=0,-1,0&pan_point=0.1,0.2,0.3", "virtual:?size=16x16")
    assert rig.settle_s == 2.5
    assert rig.geometry == Geometry((0, -1, 0), (0.1, 0.2, 0.3), (1, 0, 0), (0.1, 0.2, 0.3))
    assert find.open_rig("none:", "virtual:?size=16x16").geometry is None
    assert find.open_rig("manual:", "virtual:?size=16x16").settle_s == find.SETTLE_S["manual"]


def test_settings_come_from_a_file_and_the_url_counts_more(tmp_path: Path, wired: list[Wire]):
    path = tmp_path / "rig.toml"
    path.write_text(
        "axes = '1.1,1.2'\nsettle = 1.5\ntilt = '-20..20'\nzero = [0, 5]\n"
        "pan_axis = [0, -1, 0]\npan_point = [0.03, 0.06, 0.25]\ntilt_axis = [1, 0, 0]\ntilt_point = [0, 0, 0.3]\n"
    )
    url = f"zaber://{port(wired, ZaberFirmware())}?file={path}&tilt=-10..10"
    rig = find.open_rig(url, "virtual:?size=16x16")
    assert rig.settle_s == 1.5
    assert rig.motion.features.axes[1].highest_deg == 10.0
    assert rig.geometry == Geometry((0, -1, 0), (0.03, 0.06, 0.25), (1, 0, 0), (0, 0, 0.3))
    rig.close()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("settle = ", "no TOML"),
        ("settle = 'long'", "settle=long cannot be meant"),
        ("speling = 1", "unknown setting 'speling'"),
        ("[table]\nx = 1", "table is neither number"),
        ("pan_axis = [0, 1, 0]", "pan_axis was said but not pan_point"),
        ("pan_axis = [0, 1, 0]\npan_point = [0, 0, 1]\ntilt_axis = [1, 0, 0]", "but not tilt_point"),
        ("pan_axis = [0, 0, 0]\npan_point = [0, 0, 1]", "is no direction"),
        ("pan_axis = [0, 1]\npan_point = [0, 0, 1]", "pan_axis=0,1 cannot be meant"),
    ],
)
def test_a_file_that_cannot_be_meant_is_told(content: str, reason: str, tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_text(content)
    with pytest.raises(SettingsError, match=reason):
        find.open_rig(f"none:?file={path}", "virtual:?size=16x16")


def test_a_file_that_is_not_there_is_told(tmp_path: Path):
    with pytest.raises(SettingsError, match="cannot be read"):
        find.open_rig(f"none:?file={tmp_path}/missing.toml", "virtual:?size=16x16")


def test_a_camera_that_fails_lets_go_of_the_rig(wired: list[Wire], tmp_path: Path):
    url = f"zaber://{port(wired, ZaberFirmware())}"
    for _ in range(2):
        with pytest.raises(AbsentError):
            find.open_rig(url, f"folder:{tmp_path}/missing")
    before = threading.active_count()
    with pytest.raises(AbsentError):
        find.open_rig("virtual:", f"folder:{tmp_path}/missing")
    assert threading.active_count() == before  # the emulator's own ended too
    with pytest.raises(SettingsError):
        find.open_rig("zaber:///dev/ttyNOPE", "nikon:")  # told before the port is looked for
    find.open_rig(url, "virtual:?size=16x16").close()


def test_a_rig_without_its_own_eyes_is_seen_where_it_says_it_stands(wired: list[Wire], tmp_path: Path):
    wired.append(Wire(ZaberFirmware(), lambda: 100 * time.monotonic()))
    rig = find.open_rig(f"zaber://{wired[-1].port}?settle=0", "virtual:?size=16x16")
    rig.home()
    rig.take(Angles(12.0), BRACKET, tmp_path)
    assert rig.camera._where().pan_deg == pytest.approx(12.0, abs=1e-3)
    rig.close()


@pytest.mark.parametrize("controller", ["grbl", "zaber"])
def test_a_stop_in_motion_leaves_the_rig_ready_for_the_next_order(controller: str):
    rig = find.open_rig(f"virtual:{controller}?speed=10", "virtual:?size=16x16")
    try:
        rig.home()
        for _ in range(3):
            rig.go(Angles(0.0, 0.0))
            order = Order(lambda: rig.go(Angles(360.0, 0.0)))
            wait(lambda: rig.motion.angles().pan_deg > 20, "it never began to move")
            rig.stop()
            assert isinstance(order.finished(), StoppedError)
            assert rig.motion.angles().pan_deg < 350
        reached = rig.go(Angles(30.0, 0.0))
        assert reached is not None
        assert rig.motion.angles().pan_deg == pytest.approx(30.0, abs=0.02)
    finally:
        rig.close()


# ---- faults of the virtual rig

MANY_MOVES = 40  # enough of both kinds come long before


@pytest.mark.parametrize("controller", ["grbl", "zaber"])
def test_whatever_goes_wrong_a_move_that_succeeds_truly_went_there(controller: str):
    """A fault in every second move; whoever homes when told to always ends where the rig says it is."""
    rig = find.open_motion(f"virtual:{controller}?speed=200&faults=2&seed=3")
    went = failed = 0
    try:
        rig.home()
        for number in range(MANY_MOVES):
            if went >= 3 and failed >= 2:
                break
            target = Angles(15.0 * (number % 20), 10.0 * (number % 3))
            try:
                reached = rig.move(target)
            except HardwareError as error:
                failed += 1
                recover(rig, error)
                continue
            went += 1
            assert reached.pan_deg == pytest.approx(target.pan_deg, abs=0.02)
            truth = rig.angles()
            assert truth.pan_deg == pytest.approx(reached.pan_deg, abs=0.02)
            assert truth.tilt_deg == pytest.approx(reached.tilt_deg, abs=0.02)
    finally:
        rig.close()
    assert went >= 3
    assert failed >= 2


def recover(rig: Motion, error: HardwareError) -> None:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        state = rig.status().state
        if not isinstance(error, PositionLostError) and state is State.IDLE:
            return
        try:
            rig.home()
            return
        except HardwareError as again:
            error = again
    raise AssertionError(f"it could not be homed again: {error}")
