import math
import sys
import threading
import time
import types
from pathlib import Path

import pytest

from hardware.camera import body as gphoto_body
from hardware.camera import gphoto as camera_gphoto
from hardware.camera import usb_holder
from hardware.camera.body import Event, Refused, Setting
from hardware.camera.gphoto import GphotoCamera, GphotoConfig, open_camera
from hardware.errors import (
    AbsentError,
    AccessError,
    BatteryError,
    BusyError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    SettingsError,
    StoppedError,
    StoreFullError,
)
from hardware.interfaces import Bracket, Exposure
from tests.hardware.camera import ptp
from tests.hardware.camera.canon_r8 import R8

THREE = Bracket(Exposure(1 / 60, 100, 8.0))
ONE = Bracket(Exposure(1 / 60), (0.0,))
CARD = "/store_00020001/DCIM/100CANON"


class Clock:
    """Time that passes when somebody sleeps, or looks at it."""

    def __init__(self) -> None:
        self.now, self.slept = 0.0, []

    def __call__(self) -> float:
        self.now += 0.001
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept.append(seconds)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def body(clock: Clock) -> R8:
    return R8(clock.sleep)


def made(body: R8, clock: Clock, **facts) -> GphotoCamera:
    return GphotoCamera(lambda: body, GphotoConfig(**facts), clock, clock.sleep)


def test_it_is_set_to_raw_on_the_card_and_tells_what_it_offers(body: R8, clock: Clock):
    features = made(body, clock).features
    assert body.setting("imageformat").value == "RAW"
    assert body.setting("capturetarget").value == "Memory card"
    assert features.suffix == ".cr3"
    assert features.shutters_s[0] == 1 / 4000
    assert features.shutters_s[-1] == 30
    assert len(features.shutters_s) == 52  # bulb is no time
    assert features.isos == (100, 125, 160, 200, 400, 800)
    assert features.apertures[0] == 5.6


def test_an_r8_takes_its_bracket_at_one_release_and_every_file_is_what_it_is_called(
    body: R8, clock: Clock, tmp_path: Path
):
    camera = made(body, clock)
    taken = camera.expose(THREE)
    assert body.asked.count("trigger") == 1
    assert [item.exposure.shutter_s for item in taken] == [1 / 500, 1 / 60, 1 / 8]
    assert taken[0].exposure.iso == 100
    for index, item in enumerate(taken):
        camera.download(item, tmp_path / f"{index}.cr3")  # compares the file's own account


def test_another_sequence_in_the_cameras_menu_is_noticed_and_told(body: R8, clock: Clock, tmp_path: Path):
    body.sequence = (-1.0, 0.0, 1.0)
    camera = made(body, clock)
    taken = camera.expose(THREE)
    with pytest.raises(ExposureError, match=r"1/60 s, but 1/500 s were set.*bracketing sequence to 0, -, \+"):
        camera.download(taken[0], tmp_path / "a.cr3")
    assert not list(tmp_path.iterdir())
    assert (
        sum("read" in order for order in body.asked) == 1
    )  # the file was whole: once more would help nobody


def test_stops_it_has_no_bracket_for_are_set_one_by_one(body: R8, clock: Clock, tmp_path: Path):
    camera = made(body, clock)
    camera.expose(THREE)
    body.asked.clear()
    taken = camera.expose(Bracket(Exposure(1 / 60), (-4.0, -2.0, 0.0, 2.0)))
    assert body.setting("aeb").value == "off"
    assert body.setting("drivemode").value == "Single"
    assert body.asked.count("trigger") == 4
    for index, item in enumerate(taken):
        camera.download(item, tmp_path / f"{index}.cr3")


def test_a_bracket_left_on_by_somebody_is_switched_off_for_single_photographs(body: R8, clock: Clock):
    body.set("aeb", "+/- 2")
    camera = made(body, clock)
    assert len(camera.expose(ONE)) == 1
    assert body.setting("aeb").value == "off"


def test_what_nobody_expects_to_have_changed_is_put_back(body: R8, clock: Clock):
    body.set("aeb", "+/- 1")
    camera = made(body, clock)
    camera.expose(THREE)
    camera.expose(ONE)
    camera.close()
    assert body._settings["aeb"].value == "+/- 1"
    assert body._settings["drivemode"].value == "Timer 2 sec"
    assert body.closed


def test_without_a_shutter_time_it_is_the_cameras_own(body: R8, clock: Clock):
    body.set("shutterspeed", "1/30")
    taken = made(body, clock).expose(Bracket(Exposure(None)))
    assert [item.exposure.shutter_s for item in taken] == [1 / 250, 1 / 30, 1 / 4]


def test_brackets_about_the_cameras_own_shutter_do_not_drift(body: R8, clock: Clock):
    camera = made(body, clock)
    body.set("shutterspeed", "1/60")
    uneven = Bracket(Exposure(None), (-2.0, 0.0, 1.0))  # no `aeb` has these stops: shutters one by one
    times = [[one.exposure.shutter_s for one in camera.expose(uneven)] for _ in range(3)]
    assert times[0] == times[1] == times[2]
    body.set("shutterspeed", "1/125")  # the person changed their mind
    assert camera.expose(uneven)[1].exposure.shutter_s == 1 / 125


def test_a_shutter_at_bulb_is_no_time(body: R8, clock: Clock):
    body.set("shutterspeed", "bulb")
    with pytest.raises(SettingsError, match="mode dial to M"):
        made(body, clock).expose(Bracket(Exposure(None)))
    assert not body.files


def test_the_nearest_offered_exposure_is_told(body: R8, clock: Clock):
    (item,) = made(body, clock).expose(Bracket(Exposure(1 / 57, 110, 8.3), (0.0,)))
    assert item.exposure == Exposure(1 / 60, 100, 8.0)


@pytest.mark.parametrize(
    "bracket",
    [
        Bracket(Exposure(10.0)),
        Bracket(Exposure(1 / 1000)),
        Bracket(Exposure(1 / 60, 25600)),
        Bracket(Exposure(1 / 60, 100, 1.4)),
        Bracket(Exposure(1 / 60), (0.0, 0.05)),
        Bracket(Exposure(-1.0), (0.0,)),
        Bracket(Exposure(0.0)),
        Bracket(Exposure(math.nan)),
        Bracket(Exposure(1 / 60, -5), (0.0,)),
    ],
)
def test_what_is_not_offered_is_refused_and_nothing_is_taken(body: R8, clock: Clock, bracket):
    camera = made(body, clock)
    with pytest.raises(SettingsError):
        camera.expose(bracket)
    assert "trigger" not in body.asked


def test_a_mode_dial_that_keeps_a_setting_is_told_and_nothing_is_taken(body: R8, clock: Clock):
    body.stuck = {"shutterspeed"}
    with pytest.raises(SettingsError, match=r"keeps shutterspeed at '1/60' though '1/30'.*mode dial to M"):
        made(body, clock).expose(Bracket(Exposure(1 / 30), (0.0,)))
    assert "trigger" not in body.asked


def test_busy_is_asked_again_ever_more_slowly(body: R8, clock: Clock):
    camera = made(body, clock)
    body.busy = 6
    clock.slept.clear()
    assert len(camera.expose(THREE)) == 3
    pauses = [pause for pause in clock.slept if pause >= camera_gphoto.FIRST_PAUSE_S]
    assert pauses == [0.05, 0.1, 0.2, 0.4, 0.8, 1.0]


def test_busy_without_end_is_given_up(body: R8, clock: Clock):
    camera = made(body, clock)
    body.busy = 10**9
    begin = clock.now
    with pytest.raises(ExposureError, match="still busy"):
        camera.expose(THREE)
    assert 5 < clock.now - begin < 15
    assert not body.files


def test_a_camera_that_is_busy_after_each_release_misses_nothing(body: R8, clock: Clock):
    body.busy_after_release = 5
    camera = made(body, clock)
    for _ in range(4):
        camera.expose(THREE)
        camera.expose(ONE)
    assert len(body.files) == 16


def test_endless_chatter_puts_no_deadline_off(body: R8, clock: Clock):
    camera = made(body, clock, arrive_s=5.0)
    body.chatty = True
    with pytest.raises(ExposureError, match="0 of 3 files arrived in 5 s"):
        camera.expose(THREE)


def test_a_file_too_many_is_told_by_name(body: R8, clock: Clock):
    camera = made(body, clock)
    body.second_file = True
    with pytest.raises(ExposureError, match="more files than exposures"):
        camera.expose(Bracket(Exposure(1 / 60)))


def test_a_file_that_comes_late_is_none_of_the_next_bracket(body: R8, clock: Clock):
    camera = made(body, clock, arrive_s=5.0)
    body.silent = True
    with pytest.raises(ExposureError):
        camera.expose(ONE)
    body.silent = False  # it comes after all, when the next one begins
    (item,) = camera.expose(ONE)
    assert item.handle == f"{CARD}/IMG_0413.CR3"


def test_even_one_that_comes_while_the_next_is_prepared(body: R8, clock: Clock):
    camera = made(body, clock, arrive_s=5.0)
    body.silent = True
    with pytest.raises(ExposureError):
        camera.expose(ONE)
    late, body._events = list(body._events), type(body._events)()
    looks = iter(range(1000))
    event = body.event

    def slow(wait_s: float) -> Event:
        if next(looks) == 5:
            body.silent = False
            body._events.extendleft(reversed(late))
        return event(wait_s)

    body.event = slow
    (item,) = camera.expose(ONE)
    assert item.handle == f"{CARD}/IMG_0413.CR3"


def test_where_it_stores_raw_and_jpeg_the_raw_counts(body: R8, clock: Clock):
    body._settings["imageformat"] = Setting(
        "RAW + Large Fine JPEG", ("Large Fine JPEG", "RAW + Large Fine JPEG")
    )
    camera = made(body, clock)
    taken = camera.expose(THREE)
    assert [Path(item.handle).suffix for item in taken] == [".CR3"] * 3
    assert len(body.files) == 6
    assert camera.features.suffix == ".cr3"


def test_a_camera_without_raw_is_told_by_its_suffix(body: R8, clock: Clock):
    body._settings["imageformat"] = Setting("Large Fine JPEG", ("Large Fine JPEG",))
    camera = made(body, clock)
    assert camera.features.suffix == ".jpg"
    assert camera.expose(ONE)[0].handle.endswith(".JPG")


def test_what_lies_in_memory_is_deleted_when_it_is_safe_and_what_lies_on_a_card_never(body: R8, clock: Clock):
    camera = made(body, clock, to_card=False)
    assert body.setting("capturetarget").value == "Internal RAM"
    taken = camera.expose(THREE)
    camera.forget(taken[:2])
    assert list(body.files) == [taken[2].handle]
    other = R8(clock.sleep)
    camera = made(other, clock)
    camera.forget(camera.expose(THREE))
    assert len(other.files) == 3


def test_a_full_card_is_told_at_the_release_and_after(body: R8, clock: Clock):
    camera = made(body, clock)
    body.full = True
    with pytest.raises(StoreFullError):
        camera.expose(THREE)
    body.full = False
    body.refuses = gphoto_body.GENERAL  # once full, some give no reason any more
    with pytest.raises(HardwareError):
        camera.expose(THREE)
    body.refuses = None
    assert camera.status().free_shots == 0
    camera.expose(THREE)  # another card was put in
    assert camera.status().free_shots == 1234


def test_battery_is_told_and_low_is_too_low(body: R8, clock: Clock):
    camera = made(body, clock)
    assert camera.status().battery == 0.75
    body.charge("Low")
    with pytest.raises(BatteryError, match="5 %"):
        camera.expose(THREE)
    body.charge("Unknown value 0006")
    camera.expose(THREE)


@pytest.mark.parametrize(
    "code", [gphoto_body.IO, gphoto_body.IO_READ, gphoto_body.USB_FIND, gphoto_body.UNKNOWN_MODEL]
)
def test_a_connection_gone_is_told(body: R8, clock: Clock, code):
    camera = made(body, clock)
    body.refuses = code
    with pytest.raises(DisconnectedError, match="auto power off"):
        camera.expose(THREE)
    assert not camera.status().ready
    body.refuses = None


def test_any_other_refusal_may_be_tried_again(body: R8, clock: Clock):
    camera = made(body, clock)
    body.refuses = gphoto_body.GENERAL
    with pytest.raises(ExposureError, match="manual focus"):
        camera.expose(THREE)


def test_a_body_that_refuses_while_it_is_opened_is_let_go(clock: Clock):
    class Sulking(R8):
        def jpeg_only(self) -> bool:
            raise Refused(gphoto_body.IO, "I/O problem")

    body = Sulking(clock.sleep)
    with pytest.raises(DisconnectedError):
        made(body, clock)
    assert body.closed


def test_status_does_not_wait_for_a_body_that_does_not_answer():
    body = R8()
    camera = GphotoCamera(lambda: body, GphotoConfig())
    released = threading.Event()
    setting = body.setting

    def silent(name: str) -> Setting:
        released.wait(20)
        return setting(name)

    body.setting = silent
    begin = time.monotonic()
    status = camera.status()
    assert time.monotonic() - begin < 3.0
    assert not status.ready
    assert status.message == "does not answer"
    released.set()
    camera.close()


def test_a_stopped_download_leaves_nothing_and_opens_the_body_anew(body: R8, clock: Clock, tmp_path: Path):
    second = R8(clock.sleep)
    bodies = iter([body, second])
    camera = GphotoCamera(lambda: next(bodies), GphotoConfig(), clock, clock.sleep)
    (item,) = camera.expose(ONE)
    second.files = dict(body.files)
    body.silent = True
    outcome: list[BaseException] = []

    def download() -> None:
        try:
            camera.download(item, tmp_path / "a.cr3")
        except HardwareError as error:
            outcome.append(error)

    thread = threading.Thread(target=download)
    thread.start()
    while thread.is_alive():
        camera.stop()
        thread.join(0.05)
    assert isinstance(outcome[0], StoppedError)
    assert body.closed
    assert not list(tmp_path.iterdir())
    assert camera.download(item, tmp_path / "a.cr3").path.exists()


# -- through libgphoto2, to a camera nobody here wrote


def test_the_ptp_camera_is_found_and_named():
    with ptp.plugged_in():
        (found,) = gphoto_body.detect()
        assert (found.model, found.port) == ("Nikon DSC D750", "usb:001,001")
        camera = open_camera(GphotoConfig("usb:001,001"))
        assert camera.name == "Nikon DSC D750 (usb:001,001)"
        assert camera.features.suffix == ".jpg"
        assert camera.features.shutters_s == (0.0001, 0.0012, 0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 1.0)
        assert camera.status().battery == 0.5
        camera.close()


def test_the_ptp_camera_is_set_to_what_is_told():
    with ptp.plugged_in():
        camera = open_camera(GphotoConfig())
        (item,) = camera.expose(Bracket(Exposure(0.019, None, 7.9), (0.0,)))
        assert item.exposure == Exposure(0.02, None, 8.0)
        camera.close()
        body = gphoto_body.open_body()
        body.close()


def test_the_ptp_cameras_store_is_full_after_its_last_photograph():
    with ptp.plugged_in():
        camera = open_camera(GphotoConfig())
        single = Bracket(Exposure(0.01), (0.0,))
        handles = {camera.expose(single)[0].handle for _ in range(ptp.PHOTOGRAPHS)}
        assert len(handles) == ptp.PHOTOGRAPHS
        for _ in range(3):  # it gives the reason once and then none
            with pytest.raises(StoreFullError, match="full"):
                camera.expose(single)
        camera.close()


def test_a_download_that_is_cancelled_in_libgphoto2_lets_the_next_one_through(tmp_path: Path):
    with ptp.plugged_in((1600, 1200)) as content:
        assert len(content) > 1_000_000
        camera = open_camera(GphotoConfig())
        assert isinstance(camera, GphotoCamera)
        (item,) = camera.expose(Bracket(Exposure(0.01), (0.0,)))
        stopped = camera._stopped
        asked = iter(range(1000))

        class Soon(threading.Event):
            def is_set(self) -> bool:
                return next(asked) > 3  # libgphoto2 asks again and again during the transfer

        camera._stopped = Soon()
        with pytest.raises(StoppedError):
            camera.download(item, tmp_path / "a.jpg")
        camera._stopped = stopped
        assert not list(tmp_path.iterdir())
        (item,) = camera.expose(Bracket(Exposure(0.01), (0.0,)))
        assert camera.download(item, tmp_path / "a.jpg").path.read_bytes() == content
        camera.close()


def test_a_port_without_a_camera_is_told_with_those_that_have_one():
    with ptp.plugged_in(), pytest.raises(AbsentError, match=r"usb:001,009.*usb:001,001 \(Nikon DSC D750\)"):
        gphoto_body.open_body("usb:001,009")


# -- what libgphoto2 says when a camera cannot be opened


class Gphoto(types.ModuleType):
    """libgphoto2 with so many cameras, which refuse to be opened."""

    class GPhoto2Error(Exception):
        def __init__(self, code: int):
            super().__init__(code)
            self.code, self.string = code, "no"

    def __init__(self, cameras: int, code: int):
        super().__init__("gphoto2")
        library = self

        class Cameras:
            count = staticmethod(lambda: cameras)
            get_name = staticmethod(lambda index: "Canon EOS R8")
            get_value = staticmethod(lambda index: f"usb:001,{index + 5:03d}")

        class Camera:
            autodetect = staticmethod(Cameras)

            def set_port_info(self, info: object) -> None: ...

            def init(self) -> None:
                raise library.GPhoto2Error(code)

        class PortInfoList(list):
            def load(self) -> None:
                self.append("a port")

            def lookup_path(self, path: str) -> int:
                return 0

        self.Camera, self.PortInfoList = Camera, PortInfoList


@pytest.mark.parametrize(
    ("cameras", "code", "error", "told"),
    [
        (0, 0, AbsentError, "switch it on"),
        (2, 0, SettingsError, r"gphoto2:usb:001,005 \(Canon EOS R8\), gphoto2:usb:001,006"),
        (1, gphoto_body.USB_CLAIM, BusyError, "usb:001,005: in use by gvfsd-gphoto2"),
        (1, gphoto_body.UNKNOWN_MODEL, AbsentError, "no camera answers there"),
        (1, gphoto_body.IO, HardwareError, "off and on again"),
    ],
)
def test_a_camera_that_cannot_be_opened_says_why(monkeypatch, tmp_path: Path, cameras, code, error, told):
    (tmp_path / "005").touch()
    monkeypatch.setitem(sys.modules, "gphoto2", Gphoto(cameras, code))
    monkeypatch.setattr(usb_holder, "in_use", lambda port: "in use by gvfsd-gphoto2 (process 9): eject")
    monkeypatch.setattr(usb_holder, "device", lambda port: tmp_path / "005")
    with pytest.raises(error, match=told):
        gphoto_body.open_body()


def test_a_device_file_that_may_not_be_written_says_who_may(monkeypatch, tmp_path: Path):
    (tmp_path / "005").touch()
    monkeypatch.setitem(sys.modules, "gphoto2", Gphoto(1, gphoto_body.IO))
    monkeypatch.setattr(usb_holder, "device", lambda port: tmp_path / "005")
    monkeypatch.setattr(gphoto_body.os, "access", lambda path, mode: False)
    with pytest.raises(AccessError, match="udev"):
        gphoto_body.open_body()


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "gphoto2", None)
    for order in (gphoto_body.detect, gphoto_body.open_body):
        with pytest.raises(AbsentError, match=r"pip install 'roomlight\[camera\]'"):
            order()


def test_refusals_have_libgphoto2s_own_numbers():
    names = {
        "": gphoto_body.GENERAL, "_NO_MEMORY": gphoto_body.NO_MEMORY, "_BAD_PARAMETERS": gphoto_body.BAD_NAME,
        "_IO": gphoto_body.IO, "_IO_INIT": gphoto_body.IO_INIT, "_IO_READ": gphoto_body.IO_READ,
        "_IO_WRITE": gphoto_body.IO_WRITE, "_IO_USB_FIND": gphoto_body.USB_FIND, "_IO_USB_CLAIM": gphoto_body.USB_CLAIM,
        "_IO_LOCK": gphoto_body.IO_LOCK, "_MODEL_NOT_FOUND": gphoto_body.UNKNOWN_MODEL,
        "_UNKNOWN_PORT": gphoto_body.UNKNOWN_PORT, "_FILE_NOT_FOUND": gphoto_body.NO_FILE,
        "_CAMERA_BUSY": gphoto_body.CAMERA_BUSY, "_CANCEL": gphoto_body.CANCELLED, "_NO_SPACE": gphoto_body.NO_SPACE,
    }  # fmt: skip
    with ptp.plugged_in():
        import gphoto2

        assert names == {name: getattr(gphoto2, f"GP_ERROR{name}") for name in names}
