"""What a batch would do: sessions found below folders, and of each what its plan says, why, how long and how much memory.

Reads only. State is what sessions on disk say; nothing is written down besides.
"""

import enum
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.batch.orders import Order
from app.changes import Changes, open_changed
from app.costs import Cost, cost_of, megapixels_of, together
from app.state import called
from engine.errors import RoomlightError
from engine.pipeline import stages
from engine.pipeline.stages import Step

PLAN_SCHEMA = 1


class Standing(enum.Enum):
    """Where a session stands under the settings asked for."""

    NEW = "new"  # no stage has run
    UNFINISHED = "unfinished"  # what has run is up to date, and stages are left
    STALE = "stale"  # a stage has run with other settings, inputs or versions
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Entry:
    """One session of a batch."""

    folder: Path
    name: str  # tells it from the others: what it is called, or its path where two are called alike
    standing: Standing
    steps: tuple[Step, ...]
    costs: Mapping[str, Cost]  # of the stages that wait

    @property
    def called(self) -> str:
        return called(self.folder)

    @property
    def waiting(self) -> tuple[Step, ...]:
        return tuple(step for step in self.steps if not step.done)

    @property
    def cost(self) -> Cost:
        return together(list(self.costs.values()))

    @property
    def reason(self) -> str:
        """Why the first stage that waits does."""
        step = next(iter(self.waiting), None)
        if step is None or self.standing is Standing.NEW:
            return ""
        return f"{step.stage.name} {step.tell()}"

    def content(self) -> dict[str, Any]:
        """As `plan --json` prints it; docs/automation.md."""
        return {
            "schema": PLAN_SCHEMA,
            "session": str(self.folder),
            "standing": self.standing.value,
            "seconds": _known(self.cost.seconds),
            "memory_bytes": self.cost.memory_bytes,
            "stages": [
                {
                    "name": step.stage.name, "fingerprint": step.fingerprint, "done": step.done, "given": step.given,
                    "reasons": list(step.reasons), "folder": str(step.folder),
                    "seconds": _known(self.costs[step.stage.name].seconds) if not step.done else 0.0,
                }
                for step in self.steps
            ],
        }  # fmt: skip


def _known(seconds: float) -> float | None:
    return None if math.isnan(seconds) else round(seconds, 1)


def find_sessions(places: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """The sessions among and below `places`, each once, and a complaint about every place that holds none.

    Links and hidden folders below a place are not followed.
    """
    found: dict[Path, Path] = {}
    complaints = []
    for place in places:
        here = list(_below(place))
        if not here:
            what = "holds no session" if place.is_dir() else "is no folder"
            complaints.append(
                f"{place}: {what}; name sessions, or folders that hold them (`roomlight import`)"
            )
        for folder in here:
            found.setdefault(folder.resolve(), folder)
    return list(found.values()), complaints


def _below(place: Path) -> "list[Path]":
    found = []
    for folder, below, files in os.walk(place):
        if "session.json" in files:
            found.append(Path(folder))
            below.clear()
        below[:] = sorted(name for name in below if not name.startswith("."))
    return found


def told_apart(folders: Sequence[Path]) -> dict[Path, str]:
    """What tells each session from the others."""
    count = Counter(called(folder) for folder in folders)
    return {folder: called(folder) if count[called(folder)] == 1 else str(folder) for folder in folders}


def agenda(
    folders: Sequence[Path], changes: Changes, until: str | None, cores: int
) -> tuple[list[Entry], list[str]]:
    """The plan of each session, on so many cores; and a complaint about each that has none."""
    entries, complaints = [], []
    for folder, name in told_apart(folders).items():
        try:
            entries.append(entry(folder, name, changes, until, cores))
        except RoomlightError as error:
            complaints.append(" ".join(str(error).split()))
    return entries, complaints


def entry(folder: Path, name: str, changes: Changes, until: str | None = None, cores: int = 1) -> Entry:
    """
    Raises:
        SessionError: the session is damaged or of a newer schema, or the settings are unknown.
    """
    asked = open_changed(folder, changes)
    steps = stages.until(stages.plan(asked.session, asked.rows, asked.settings), until)
    waiting = [step for step in steps if not step.done]
    megapixels = megapixels_of(asked.session, steps[0].params.long_edge_px) if waiting else 0.0
    costs = {
        step.stage.name: cost_of(asked.session, step, megapixels, asked.settings.preset, cores) for step in waiting
    }  # fmt: skip
    return Entry(folder, name, _standing(steps), steps, costs)


def order_of(entry: Entry, device: str, until: str | None, changes: Changes) -> Order:
    """To process what waits of it."""
    request = {
        "session": str(entry.folder.resolve()),
        "device": device,
        "until": until,
        "changes": asdict(changes),
    }
    stages = {stage: cost.seconds for stage, cost in entry.costs.items()}
    return Order(entry.name, "process", request, entry.cost.seconds, entry.cost.memory_bytes, stages)


def _standing(steps: Sequence[Step]) -> Standing:
    if all(step.done for step in steps):
        return Standing.DONE
    if any(step.reasons not in ((), ("never ran",)) for step in steps):
        return Standing.STALE
    return Standing.UNFINISHED if any(step.done for step in steps) else Standing.NEW
