"""Sets of photographs with a known truth: made by the studio on first use, kept in a folder, taken to their light.

A set's folder is named by all that decides it (`choices`). It appears by one rename: a making that was killed leaves nothing
that counts as a set, and the next one sweeps up what it left.
"""

import os
import shutil
import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from app import places, studio, terminal
from app.bench.choices import Choice
from app.bench.given import give_truth
from app.bench.information import Bound
from app.bench.sizes import Size
from app.bench.stored import Stored, evenly, load
from engine.io import session as sessions
from engine.io.ground_truth import Truth, read_truth
from engine.pipeline import run, stage_table
from engine.pipeline.settings import Settings
from engine.progress import Progress
from hardware.virtual.studio.order import RENDER_NOISE, Order


@dataclass(frozen=True, slots=True, eq=False)
class Set:
    """One room and object, processed up to its light."""

    room: str  # as tables show it
    thing: str
    session: Path
    stored: Stored
    truth: Truth
    bound: Bound | None = None  # the least error that its photographs allow; None: not known

    @property
    def name(self) -> str:
        return f"{self.room}-{self.thing}"


def default_folder() -> Path:
    return places.cache() / "bench"


def key(room: Choice, thing: Choice, size: Size, views: int, seed: int) -> str:
    """The folder's name: room, object, motion, views, pixels, seed, the studio's version, and files other than RAW."""
    from hardware.virtual.studio import shoot

    pixels = f"{views}x{size.width}x{size.height}"
    files = "" if size.files == "raw" else f"-{size.files}"
    files += "" if size.enlarged == 1 else f"-x{size.enlarged}"
    files += "" if size.noise == RENDER_NOISE else f"-noise{size.noise:g}"
    return f"{room.key}-{thing.key}-{size.motion}-{pixels}-seed{seed}-studio{shoot.VERSION}{files}"


def order_of(room: Choice, thing: Choice, size: Size, views: int, seed: int, device: str) -> Order:
    """What the studio is asked for."""
    return Order(
        room.asked,
        thing.asked,
        views,
        size.width,
        size.height,
        size.motion,
        seed,
        device,
        thing.size_m,
        room.place,
        thing.material,
        thing.turn_deg or 0.0,
        size.noise,
    )


def photographed(
    folder: Path, room: Choice, thing: Choice, size: Size, views: int, seed: int, device: str
) -> Path:
    """The set's folder, with `session` and `truth`; made if it is not there."""
    place = folder / key(room, thing, size, views, seed)
    if place.is_dir():
        return place
    with sessions.told(folder):
        folder.mkdir(parents=True, exist_ok=True)
        _sweep(folder, place.name)
    partial = folder / f".{place.name}.{os.getpid()}.making"
    order = order_of(room, thing, size, views, seed, device)
    try:
        with job(f"making {room.name}-{thing.name}") as progress:
            notes = studio.simulate(partial, order, 0.0, progress, size.files, size.enlarged, size.panoramas)
        print("\n".join(notes or ()), file=sys.stderr)
        with sessions.told(place):
            partial.rename(place)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return place


def ready(
    folder: Path,
    room: Choice,
    thing: Choice,
    size: Size,
    views: int,
    seed: int,
    device: str,
    count: int | None = None,
) -> Set:
    """The set of `views` photographs with its light; with `count`, only so many of them and the truth's poses and mask.

    Raises:
        RoomlightError: what the studio, the import or a stage has to say.
    """
    place = photographed(folder, room, thing, size, views, seed, device)
    session, truth = place / "session", place / "truth"
    if size.given or count is not None:
        session = place / (f"given-{count}.session" if count is not None else "given.session")
        if not session.exists():
            chosen = None if count is None else evenly(count, views)
            give_truth(place / "session", truth, session, chosen)
    enlighten(session, f"{room.name}-{thing.name}", size.settings, seed, device)
    return Set(room.name, thing.name, session, load(session), read_truth(truth))


def enlighten(
    session: Path, name: str, overrides: Mapping[str, Mapping[str, Any]], seed: int, device: str
) -> None:
    """Run what is not done of the stages up to the light."""
    with terminal.stoppable() as cancelled, terminal.Display(Console(stderr=True)) as display:
        watcher = run.Watcher(
            lambda step: display.begin(f"{name} {step.stage.name}"),
            lambda step, fraction, note: display.move(fraction, note),
            lambda step, seconds: display.end(seconds),
            cancelled,
        )
        settings = Settings("standard", seed, overrides)
        run.process(sessions.open_session(session), stage_table.stages(), settings, device, "light", watcher)


def job(name: str) -> AbstractContextManager[Progress]:
    """Progress on stderr: tables alone go to stdout."""
    return terminal.job(name, Console(stderr=True))


def _sweep(folder: Path, name: str) -> None:
    """Remove what killed makings of a set left."""
    for left in folder.glob(f".{name}.*.making"):
        process = left.name.split(".")[-2]
        if not Path("/proc", process).exists():
            shutil.rmtree(left, ignore_errors=True)
