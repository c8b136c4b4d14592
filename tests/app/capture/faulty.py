"""Captures whose devices fail at random, or whose process is killed; the test suite runs few, the bench many."""

import multiprocessing
import random
import signal
import time
from collections import Counter
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path

from app.capture import journal as capture_journal
from app.capture.order import Order, read
from app.capture.run import Capture
from app.capture.status import Outcome
from engine.errors import RoomlightError
from engine.io import session as sessions
from hardware import find
from hardware.errors import (
    BatteryError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    PositionLostError,
    RefusedError,
    ReplyError,
    StoreFullError,
)
from hardware.interfaces import Angles, Bracket, Frame, Taken
from hardware.rig import Rig
from tests.app.capture import quick_devices
from tests.app.capture.captures import HASTY, order

# order that fails -> how; None stands for a photograph that arrives damaged
TRANSIENT: list[tuple[str, type[HardwareError] | None]] = [
    ("move", ReplyError), ("move", PositionLostError), ("move", DisconnectedError), ("home", ReplyError),
    ("expose", ExposureError), ("expose", DisconnectedError), ("download", ExposureError),
    ("download", DisconnectedError), ("forget", ExposureError), ("download", None),
]  # fmt: skip
FINAL: list[tuple[str, type[HardwareError] | None]] = [
    ("expose", StoreFullError), ("expose", BatteryError), ("move", RefusedError),
]  # fmt: skip


class RandomFaults:
    """Calls itself at every order; fails one of them once in every `every` poses, at random."""

    def __init__(self, seed: int, every: int = 10, homed: Callable[[], None] = lambda: None):
        self._random, self._every = random.Random(seed), every
        self._poses = 0
        self._spoil_next = False
        self.happened: Counter[str] = Counter()
        self._next()

    def _next(self) -> None:
        self._at = self._poses + self._random.randrange(1, self._every + 1)
        self._order, self._error = self._random.choice(TRANSIENT + FINAL)

    def __call__(self, name: str) -> None:
        self._poses += name == "move"
        if self._order == "home" and self._poses >= self._at and name == "move":
            self.happened["move then home"] += 1
            raise PositionLostError("lost on purpose, and homing will fail as well")
        if name != self._order or self._poses < self._at:
            return
        error = self._error
        self.happened[f"{name}: {error.__name__ if error else 'damaged'}"] += 1
        block = self._poses
        self._next()
        self._at = max(self._at, block + 1)
        if error is None:
            self._spoil_next = True
        else:
            raise error(f"{error.__name__} on purpose")

    def spoil(self, path: Path) -> None:
        """What arrives damaged lost its end."""
        if self._spoil_next:
            self._spoil_next = False
            path.write_bytes(path.read_bytes()[:-100])


def open_again(faults: RandomFaults, number: Callable[[], int]) -> Callable[[], Rig]:
    """Opens quick devices, unhomed as after a reset; the camera counts on."""

    def opened() -> Rig:
        table = quick_devices.Table(faults)
        camera = quick_devices.Body(table, faults, number=number)
        camera.spoil = faults.spoil
        return Rig(table, camera)

    return opened


def capture_among_faults(
    folder: Path, wanted: Order, seed: int, every: int = 10
) -> tuple[Outcome, Counter[str], int]:
    """(outcome, faults that happened, stops) of a capture that is resumed whenever it stops with its message."""
    faults = RandomFaults(seed, every)
    opened = open_again(faults, quick_devices.counter())
    for stops in range(100):
        try:
            outcome = Capture(folder, wanted, opened, resumed=stops > 0, patience=HASTY).run()
        except HardwareError as error:
            if "on purpose" not in str(error) or error.transient:
                raise
            continue
        if not outcome.missing:
            return outcome, faults.happened, stops
    raise AssertionError("the capture never came to its end")


def capture_on_emulators(
    folder: Path, wanted: Order, rig: str, camera: str
) -> tuple[dict[str, Angles], list[str], int]:
    """(where the mechanics truly stood, by the hash of each photograph; messages; stops) of a capture on `virtual:`.

    It is resumed whenever it stops.
    """
    stood: dict[str, Angles] = {}

    def opened() -> Rig:
        made = find.open_rig(rig, camera)
        exposing, downloading = made.camera.expose, made.camera.download
        places: dict[str, Angles] = {}

        def expose(bracket: Bracket) -> tuple[Taken, ...]:
            angles = made.motion.angles()
            taken = exposing(bracket)
            places.update((one.handle, angles) for one in taken)
            return taken

        def download(taken: Taken, to: Path) -> Frame:
            frame = downloading(taken, to)
            stood[frame.sha256] = places[taken.handle]
            return frame

        made.camera.expose, made.camera.download = expose, download
        return made

    messages: list[str] = []
    for stops in range(100):
        try:
            outcome = Capture(folder, wanted, opened, resumed=stops > 0).run()
        except (HardwareError, RoomlightError) as error:
            messages.append(f"stopped: {error}")
            continue
        if not outcome.missing:
            journal = capture_journal.read(folder / "capture" / "journal.jsonl")
            return (
                stood,
                messages + [event["reason"] for event in journal if event["event"] == "failed"],
                stops,
            )
    raise AssertionError("the capture never came to its end")


def _child(folder: str, poses: int) -> None:
    """Begin a capture, or go on with it; what a killed process was doing."""
    place, wanted = Path(folder), order(poses)
    resumed = (place / "session.json").exists()
    if resumed:
        assert read(place) == wanted
    Capture(place, wanted, quick_devices.rig, resumed).run()


def begin(folder: Path, poses: int) -> BaseProcess:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.app.capture.faulty"])
    process = context.Process(target=_child, args=(str(folder), poses))
    process.start()
    return process


def finished(folder: Path) -> dict[str, tuple[str, ...]]:
    """Hashes of every finished shot by its name, each verified; empty before there is a session."""
    try:
        session = sessions.open_session(folder)
    except RoomlightError:
        return {}
    shots = sessions.shots(session)
    for shot in shots:
        sessions.verify(shot)
    return {shot.name: shot.sha256 for shot in shots}


def some_time(moments: random.Random, longest_s: float) -> Callable[[BaseProcess, Path], None]:
    """Lets a process run for a random time."""
    return lambda process, folder: process.join(moments.uniform(0, longest_s))


def some_shots(moments: random.Random, most: int) -> Callable[[BaseProcess, Path], None]:
    """Lets a process finish a few shots, and then some of the next one, however fast the machine is."""

    def wait(process: BaseProcess, folder: Path) -> None:
        before = len(list(folder.glob("shots/*/shot.json")))
        wanted = before + moments.randint(1, most)
        while process.is_alive() and len(list(folder.glob("shots/*/shot.json"))) < wanted:
            time.sleep(0.001)
        process.join(moments.uniform(0, 0.02))

    return wait


def kill_until_done(folder: Path, poses: int, kills: int, wait: Callable[[BaseProcess, Path], None]) -> int:
    """Kill a capture up to `kills` times and let it resume; how often it was killed.

    Raises:
        AssertionError: a finished shot was lost or changed, or a run failed.
    """
    before: dict[str, tuple[str, ...]] = {}
    for killed in range(kills + 1):
        process = begin(folder, poses)
        if killed < kills:
            wait(process, folder)
            process.kill()
        process.join()
        now = finished(folder)
        lost = {name for name in before if now.get(name) != before[name]}
        assert not lost, f"after {killed + 1} kills {sorted(lost)} were lost or changed"
        before = now
        if process.exitcode == 0:
            return killed
        assert process.exitcode == -signal.SIGKILL, f"a run ended with {process.exitcode}"
    raise AssertionError("the last run was not killed and did not finish")


def seconds_per_pose(folder: Path, wanted: Order, size: int) -> float:
    """What a pose takes apart from moving, exposing and downloading photographs of size x size pixels."""
    devices_s = 0.0
    rig = quick_devices.rig(size=size)

    def timed(order: Callable) -> Callable:
        def call(*words):
            nonlocal devices_s
            start = time.perf_counter()
            try:
                return order(*words)
            finally:
                devices_s += time.perf_counter() - start

        return call

    rig.motion.move = timed(rig.motion.move)
    rig.camera.expose, rig.camera.download = timed(rig.camera.expose), timed(rig.camera.download)
    start = time.perf_counter()
    Capture(folder, wanted, lambda: rig).run()
    return (time.perf_counter() - start - devices_s) / len(wanted.poses)
