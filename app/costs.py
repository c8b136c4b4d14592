"""What a stage will take: as its last run in the session did, else by the number of pixels that the photographs have.

The table's seconds are from `roomlight bench pipeline` (48 views of 320 x 240, 96 of 512 x 384, 150 of 616 x 462, 100 of 6000 x 4000) on two
cores of an AMD EPYC; poses 10, light 12, surface 48. An object that fills the picture, or one of few pixels, takes up to twice as much or half.
"""

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from engine.errors import SessionError
from engine.io.session import Session, shots
from engine.pipeline import differences
from engine.pipeline.stages import Step

# Stage -> seconds of one core, and of them per million pixels of all views; megabytes at the peak, and of them per million.
PER_MEGAPIXEL = {
    "hdr": (1.7, 0.2, 350, 25),
    "segment": (2.0, 0.12, 350, 30),
    "poses": (29.0, 1.0, 400, 40),
    "light": (13.6, 0.85, 1000, 40),
    "surface": (46.0, 1.2, 1300, 35),
    "export": (4.6, 0.085, 1200, 35),
}
READ_S = 0.12
"""More of hdr, per million pixels of the files: it reads them before it averages them down."""
PRESETS = {"draft": 0.6, "standard": 1.0, "fine": 3.0}
"""How much of standard's time the surface takes."""
SECOND_CORE = 1.7
"""How much sooner a stage ends on two cores and more."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Of one stage, or of several after one another."""

    seconds: float  # NaN: nobody knows, as of the paper's solver
    memory_bytes: int


def told_gigabytes(count: float) -> str:
    return f"{count / 1e9:.1f} GB"


def latest_run(stage: Path) -> tuple[Path, Mapping[str, Any]] | None:
    """A stage's latest finished run in a session, whatever its settings were, and its record; `stage` holds all runs."""
    found = []
    for path in stage.glob("*/record.json"):
        try:
            record = json.loads(path.read_bytes())
            found.append((float(record["finished"]), float(record["seconds"]), path.parent, record))
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return max(found, key=lambda run: run[:3])[2:] if found else None


def cost_of(session: Session, step: Step, megapixels: float, preset: str, cores: int) -> Cost:
    """What a step that waits will take on so many cores; another preset of the surface than it ran with takes its share more or less."""
    _, record = latest_run(step.folder.parent) or (None, {})
    if record.get("version") == step.stage.version and "cpu_seconds" in record:
        seconds = max(record["seconds"], record["cpu_seconds"] / cores)
        if step.stage.name == "surface":
            seconds *= PRESETS[preset] / PRESETS[differences.preset_of(step.stage, record["params"], preset)]
        return Cost(seconds, record["peak_memory_bytes"])
    if step.stage.name == "surface" and not hasattr(step.params, "probe_grid_xy"):
        return Cost(math.nan, 2_000_000_000)
    base_s, more_s, base_mb, more_mb = PER_MEGAPIXEL[step.stage.name]
    seconds = base_s + more_s * megapixels
    seconds += READ_S * megapixels_of(session, sys.maxsize) if step.stage.name == "hdr" else 0.0
    seconds *= PRESETS[preset] if step.stage.name == "surface" else 1.0
    return Cost(
        seconds / (1.0 if cores == 1 else SECOND_CORE), int(1e6 * (base_mb + more_mb * megapixels))
    )  # fmt: skip


def megapixels_of(session: Session, long_edge_px: int) -> float:
    """Of all views, as `hdr` averages them down.

    Raises:
        SessionError: the session does not say how large its photographs are.
    """
    camera = session.facts["camera"]
    try:
        width, height = int(camera["width"]), int(camera["height"])
    except (KeyError, TypeError, ValueError):
        raise SessionError(
            f"{session.folder / 'session.json'}: damaged (camera {camera!r}); restore it from a copy or import the photographs"
            " again"
        ) from None
    by = max(1, math.ceil(max(width, height) / long_edge_px))
    return len(shots(session)) * (width // by) * (height // by) / 1e6


def together(costs: "list[Cost]") -> Cost:
    """One after the other in one process."""
    return Cost(sum(cost.seconds for cost in costs), max((cost.memory_bytes for cost in costs), default=0))
