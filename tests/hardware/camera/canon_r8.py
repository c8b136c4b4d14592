"""A Canon EOS R8 as far as a driver can tell: libgphoto2's names, its own bracket, its silence about being ready.

Files are small DNGs under a CR3's name: their header says how they were exposed, as a CR3's does.
"""

import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from hardware.camera import body as gphoto
from hardware.camera.body import Event, Kind, Refused, Setting
from hardware.camera.values import bracket_ev, seconds
from tests.hardware.camera import photographs

SHUTTERS = tuple(
    choice
    for line in (
        "bulb 30 25 20 15 13 10.3 8 6.3 5 4 3.2 2.5 2 1.6 1.3 1 0.8 0.6 0.5 0.4 0.3 1/4 1/5 1/6 1/8 1/10 1/13 1/15",
        "1/20 1/25 1/30 1/40 1/50 1/60 1/80 1/100 1/125 1/160 1/200 1/250 1/320 1/400 1/500 1/640 1/800 1/1000",
        "1/1250 1/1600 1/2000 1/2500 1/3200 1/4000",
    )
    for choice in line.split()
)
FORMATS = (
    "Large Fine JPEG",
    "Small Fine JPEG",
    "RAW + Large Fine JPEG",
    "cRAW + Large Fine JPEG",
    "RAW",
    "cRAW",
)
AEB = (
    "off",
    "+/- 1/3",
    "+/- 2/3",
    "+/- 1",
    "+/- 1 1/3",
    "+/- 1 2/3",
    "+/- 2",
    "+/- 2 1/3",
    "+/- 2 2/3",
    "+/- 3",
)
DRIVES = (
    "Single",
    "Super high speed continuous shooting",
    "Continuous high speed",
    "Continuous low speed",
    "Timer 2 sec",
)


class R8:
    """A body on a cable, with what may go wrong on command."""

    model, port = "Canon EOS R8", "usb:001,005"

    def __init__(self, sleep: Callable[[float], None] = time.sleep) -> None:
        self._sleep = sleep
        self._settings = {
            "shutterspeed": Setting("1/60", SHUTTERS),
            "iso": Setting("Auto", ("Auto", "100", "125", "160", "200", "400", "800")),
            "aperture": Setting("8", ("5.6", "6.3", "7.1", "8", "9", "10", "11")),
            "imageformat": Setting("Large Fine JPEG", FORMATS),
            "capturetarget": Setting("Internal RAM", ("Internal RAM", "Memory card")),
            "aeb": Setting("off", AEB),
            "drivemode": Setting("Timer 2 sec", DRIVES),
            "batterylevel": Setting("75%", readonly=True),
        }
        self.files: dict[str, bytes] = {}
        self.asked: list[str] = []  # every order, as it came
        self.sequence = (0.0, -1.0, 1.0)  # of its own brackets, in steps
        self.stuck: set[str] = set()  # settings that keep their value, as the mode dial makes them
        self.busy = 0  # orders refused until it is ready
        self.busy_after_release = 0
        self.short = 0  # downloads that bring half of the file
        self.refuses: int | None = None  # code of every refusal from now on
        self.full = self.silent = self.chatty = self.second_file = False
        self.closed = False
        self._events: deque[Event] = deque()
        self._step = 0
        self._number = 411
        self._folder = tempfile.TemporaryDirectory()

    def settings(self) -> Mapping[str, Setting]:
        self._check()
        return dict(self._settings)

    def setting(self, name: str) -> Setting:
        self._check()
        if name not in self._settings:
            raise Refused(gphoto.BAD_NAME, "Bad parameters")
        return self._settings[name]

    def set(self, name: str, choice: str) -> None:
        self._check()
        self.asked.append(f"{name}={choice}")
        self._wait()
        assert choice in self._settings[name].choices
        if name not in self.stuck:
            self._settings[name] = replace(self._settings[name], value=choice)
        if name in ("aeb", "drivemode"):
            self._step = 0

    def charge(self, text: str) -> None:
        self._settings["batterylevel"] = Setting(text, readonly=True)

    def jpeg_only(self) -> bool:
        return False

    def free_shots(self) -> int | None:
        self._check()
        return 0 if self.full else 1234

    def trigger(self) -> None:
        self._check()
        self.asked.append("trigger")
        self._wait()
        if self.full:
            raise Refused(gphoto.NO_MEMORY, "Out of memory")
        self.busy = self.busy_after_release
        width = bracket_ev(self._settings["aeb"].value)
        if width is None:
            self._store(0.0)
        elif self._settings["drivemode"].value.startswith("Continuous"):
            for step in self.sequence:
                self._store(step * width)
        else:  # one release, one photograph, and the next one is the next of the bracket
            self._store(self.sequence[self._step] * width)
            self._step = (self._step + 1) % 3

    def event(self, wait_s: float) -> Event:
        self._check()
        if self.chatty:
            return Event(Kind.OTHER)
        if not self._events or self.silent:
            self._sleep(wait_s)
            return Event(Kind.NOTHING)
        return self._events.popleft()

    def size(self, path: str) -> int | None:
        self._check()
        self._wait()
        if path not in self.files:
            raise Refused(gphoto.NO_FILE, "File not found")
        return len(self.files[path])

    def read(self, path: str, cancelled: Callable[[], bool]) -> bytes:
        self._check()
        self.asked.append(f"read {path}")
        while self.silent:
            time.sleep(0.002)
            if cancelled():
                raise Refused(gphoto.CANCELLED, "Operation cancelled")
        content = self.files[path]
        if self.short > 0:
            self.short -= 1
            return content[: len(content) // 2]
        return content

    def delete(self, path: str) -> None:
        self._check()
        del self.files[path]

    def close(self) -> None:
        self._check()
        self.closed = True

    def _check(self) -> None:
        assert not self.closed, "libgphoto2 was asked after it was told to let go"
        if self.refuses is not None:
            raise Refused(self.refuses, "no")

    def _wait(self) -> None:
        if self.busy > 0:
            self.busy -= 1
            raise Refused(gphoto.CAMERA_BUSY, "I/O in progress")

    def _store(self, ev: float) -> None:
        self._number += 1
        shutter_s = (seconds(self._settings["shutterspeed"].value) or 1.0) * 2.0**ev
        iso = self._settings["iso"].value
        made = photographs.write(
            Path(self._folder.name) / "made.dng",
            shutter_s,
            int(iso) if iso.isdigit() else 400,
            seed=self._number,
        )
        quality = self._settings["imageformat"].value
        suffixes = [".CR3"] * ("RAW" in quality) + [".JPG"] * ("JPEG" in quality)
        self._events.append(Event(Kind.OTHER))
        for suffix in reversed(suffixes):
            path = f"/store_00020001/DCIM/100CANON/IMG_{self._number:04d}{suffix}"
            self.files[path] = made.read_bytes()
            self._events.append(Event(Kind.FILE, path))
        if self.second_file:
            self._events.append(
                Event(Kind.FILE, f"/store_00020001/DCIM/100CANON/IMG_{self._number + 500:04d}.CR3")
            )
        self._events.append(Event(Kind.OTHER))
