"""Cameras for the promises of `Camera`: the virtual one, a folder somebody fills, and the cable driver on two bodies."""

import contextlib
import itertools
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from hardware.camera import body as gphoto_body
from hardware.camera.folder import FolderCamera, FolderConfig
from hardware.camera.gphoto import GphotoCamera, GphotoConfig, open_camera
from hardware.interfaces import Angles, Bracket, Exposure
from hardware.virtual.camera import VirtualCamera, VirtualCameraConfig
from hardware.virtual.scenes import Card
from tests.hardware.camera import photographs, ptp
from tests.hardware.camera.canon_r8 import R8
from tests.hardware.contracts.camera import Made

SIZE = (48, 32)
HURRY = 20  # times faster than real
THREE = Bracket(Exposure(1 / 60))
ONE = Bracket(Exposure(1 / 60), (0.0,))
TOO_LONG = Bracket(Exposure(20.0))


@contextlib.contextmanager
def virtual() -> Iterator[Made]:
    """A card of patterns, seen from a gimbal."""
    camera = VirtualCamera(
        VirtualCameraConfig(SIZE), lambda: Card("gimbal", SIZE), lambda: Angles(30.0, 10.0)
    )
    faults, card = camera.faults, camera.card

    def hang(hangs: bool) -> None:
        faults.hangs = hangs

    def damage(count: int) -> None:
        faults.garbled = count

    def fill() -> None:
        faults.room = 1

    def drain() -> None:
        faults.battery = 0.03

    def pull() -> None:
        faults.unplugged = True

    try:
        yield Made(
            camera,
            Bracket(Exposure(None)),
            Bracket(Exposure(None), (0.0,)),
            stored=lambda item: (card / item.handle).read_bytes(),
            count=lambda: len(list(card.rglob("*.DNG"))),
            impossible=TOO_LONG,
            hang=lambda: hang(True),
            heal=lambda: hang(False),
            damage=damage,
            lose=lambda item: (card / item.handle).unlink(),
            fill=fill,
            drain=drain,
            pull=pull,
        )
    finally:
        camera.close()


class Person:
    """Takes the bracket they are asked for, with another program that stores it bit by bit."""

    def __init__(self, folder: Path, stops: tuple[float, ...]):
        self.folder, self.stops = folder, stops
        self.away = False
        self._numbers = itertools.count(1)
        self._scratch = tempfile.TemporaryDirectory()

    def ask(self, text: str) -> None:
        if not self.away:
            threading.Thread(target=self._take, args=["bracket" in text], daemon=True).start()

    def _take(self, bracket: bool) -> None:
        for stop in self.stops if bracket else (0.0,):
            number = next(self._numbers)
            made = photographs.write(
                Path(self._scratch.name) / "a", 2.0**stop / 60, seconds=number, seed=number
            )
            content = made.read_bytes()
            with (self.folder / f"IMG_{number:04d}.DNG").open("wb", buffering=0) as file:
                for begin in range(0, len(content), 700):
                    file.write(content[begin : begin + 700])
                    time.sleep(0.001)


@contextlib.contextmanager
def folder() -> Iterator[Made]:
    """Somebody fills it, in the order in which cameras bracket."""
    with tempfile.TemporaryDirectory() as scratch:
        watched = Path(scratch) / "tethered"
        watched.mkdir()
        person = Person(watched, (0.0, -3.0, 3.0))
        camera = FolderCamera(FolderConfig(watched, poll_s=0.04), person.ask)

        def hang(away: bool) -> None:
            person.away = away

        yield Made(
            camera,
            Bracket(Exposure(None)),
            Bracket(Exposure(None), (0.0,)),
            stored=lambda item: (watched / item.handle).read_bytes(),
            count=lambda: len(list(watched.iterdir())),
            hang=lambda: hang(True),
            heal=lambda: hang(False),
            lose=lambda item: (watched / item.handle).unlink(),
            pull=lambda: shutil.rmtree(watched),
        )
        camera.close()


@contextlib.contextmanager
def canon() -> Iterator[Made]:
    """The cable driver on a body that brackets by itself and is busy after each release."""

    def sleep(seconds: float) -> None:
        time.sleep(seconds / HURRY)

    body = R8(sleep)
    body.busy_after_release = 2
    camera = GphotoCamera(
        lambda: body,
        GphotoConfig(arrive_s=HURRY * 20.0),
        clock=lambda: HURRY * time.monotonic(),
        sleep=sleep,
    )

    def hang(silent: bool) -> None:
        body.silent = silent

    def damage(count: int) -> None:
        body.short = count

    def fill() -> None:
        body.full = True

    def pull() -> None:
        body.refuses = gphoto_body.IO_WRITE

    yield Made(
        camera,
        THREE,
        ONE,
        stored=lambda item: body.files[item.handle],
        count=lambda: len(body.files),
        impossible=TOO_LONG,
        hang=lambda: hang(True),
        heal=lambda: hang(False),
        damage=damage,
        lose=lambda item: body.files.pop(item.handle),
        fill=fill,
        drain=lambda: body.charge("Low"),
        pull=pull,
    )
    body.refuses = None
    camera.close()


@contextlib.contextmanager
def ptp_camera() -> Iterator[Made]:
    """The cable driver through libgphoto2 to the camera that its package brings along."""
    with ptp.plugged_in() as content:
        camera = open_camera(GphotoConfig())
        handles: set[str] = set()
        expose = camera.expose

        def counted(bracket: Bracket):
            taken = expose(bracket)
            handles.update(item.handle for item in taken)
            return taken

        camera.expose = counted  # nothing else can count what lies in another's camera

        def fill() -> None:
            for _ in range(ptp.PHOTOGRAPHS - 1):
                camera.expose(Bracket(Exposure(0.01), (0.0,)))

        yield Made(
            camera,
            Bracket(Exposure(0.01)),
            Bracket(Exposure(0.01), (0.0,)),
            stored=lambda item: content,
            count=lambda: len(handles),
            told=False,
            impossible=Bracket(Exposure(1.0)),
            fill=fill,
        )
        camera.close()
