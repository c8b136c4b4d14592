"""What each stage of `process` takes, from RAW files of several sizes to the export; beside it another roomlight and COLMAP's own
routes to poses.

Each stage runs in a process of its own, so that its seconds include starting the program, loading its libraries and reading
what earlier stages left; how many of them these are is told apart. Core-seconds are those of the process and its children,
memory is its highest resident set, photographs that are mapped from disk included. Kernels that this machine has not
compiled yet are compiled by the stage that needs them: the second measurement tells.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.bench import sets
from app.bench.choices import Choice
from app.bench.markdown import markdown, shown
from app.bench.record import BenchError, Metric
from app.bench.sizes import SIZES, Size
from engine.errors import TruthError
from engine.io import session as sessions
from engine.io.ground_truth import read_truth
from engine.pipeline import artifacts
from engine.results.metrics import evaluate_poses
from engine.types import Camera, Frames, Poses

PHOTOGRAPHS = {
    "small": replace(SIZES["small"], given=False),
    "standard": SIZES["standard"],
    "large": replace(SIZES["standard"], name="large", views=150, width=616, height=462),
    "real": replace(SIZES["standard"], name="real", views=100, width=600, height=400, enlarged=10),
}
"""By name; the real size is that of a camera of 24 megapixels, of the radiance of a picture a tenth as wide."""
ROUTES = ("exhaustive", "sequential")
"""COLMAP's, with its default options."""
OURS = "process"
THIS = (sys.executable, "-m", "app.cli")
LEAST_PLACED = 0.9
"""Share of the views that a route of COLMAP's places, to be compared with."""
GATED_SHARE = 0.3
"""By how much a ratio to another way may grow before the gate calls it worse."""


@dataclass(frozen=True, slots=True)
class Part:
    """One stage, or one step of another program."""

    name: str
    seconds: float
    core_seconds: float
    peak_bytes: int
    starting: float = 0.0  # of the seconds: the program, its libraries


@dataclass(frozen=True, slots=True)
class Way:
    """One way from photographs to results, on one size."""

    size: str
    name: str
    parts: tuple[Part, ...]
    registered_share: float | None = None  # these three of its poses, None where the truth cannot tell
    rotation_deg: float | None = None
    position_percent: float | None = None

    @property
    def seconds(self) -> float:
        return sum(part.seconds for part in self.parts)


def photographs(
    size: Size, room: Choice, thing: Choice, folder: Path, seed: int, device: str
) -> tuple[Path, Path]:
    """A session of which no stage has run, and its truth.

    Raises:
        RoomlightError: what the studio has to say, or the disk.
    """
    place = sets.photographed(folder, room, thing, size, size.views, seed, device)
    session = place / "pipeline.session"
    with sessions.told(session):
        shutil.rmtree(session, ignore_errors=True)
        original = place / "session"
        # The stages of other benchmarks stay behind; photographs need not be there twice.
        shutil.copytree(
            original, session, copy_function=os.link, ignore=shutil.ignore_patterns("stages", "exports")
        )
    return session, place / "truth"


def ours(
    size: str, session: Path, truth: Path, stages: Sequence[str], options: Sequence[str],
    program: Sequence[str] = THIS, name: str = OURS,
) -> Way:  # fmt: skip
    """Run every stage anew, by this `process` or by that of another `program`.

    Raises:
        BenchError: one of them failed, with its last line.
    """
    shutil.rmtree(session / "stages", ignore_errors=True)
    parts = []
    for stage in stages:
        words = [*program, "process", str(session), "--until", stage, *options]
        seconds, core_seconds, _ = _child(words, f"{size} {stage}, {name}")
        (record,) = (session / "stages" / stage).glob("*/record.json")
        told = json.loads(record.read_bytes())
        parts.append(Part(stage, seconds, core_seconds, told["peak_memory_bytes"], seconds - told["seconds"]))
    (folder,) = (session / "stages" / "poses").glob("*/")
    return _judged(Way(size, name, tuple(parts)), artifacts.load(folder, "poses", Poses), truth)


def colmap(size: str, route: str, session: Path, truth: Path) -> Way:
    """COLMAP's `route` on the photographs as stage hdr left them, shown as a screen would.

    Raises:
        BenchError: it failed, with its last line.
    """
    name = f"colmap {route}"
    scratch = session.parent / "colmap"
    shutil.rmtree(scratch, ignore_errors=True)
    (folder,) = (session / "stages" / "hdr").glob("*/")
    _, _, said = _child([*THIS[:2], "app.bench.colmap", str(folder), route, str(scratch)], f"{size} {name}")
    told = json.loads(said.splitlines()[-1])
    shutil.rmtree(scratch, ignore_errors=True)
    height, width = artifacts.load(folder, "frames", Frames).dark.shape[1:]
    found = np.array(told["cam_from_world"], dtype=np.float64)
    lens = Camera(width, height, 1.0, 1.0, width / 2, height / 2)
    poses = Poses(
        lens, found, np.asarray(np.isfinite(found).all((1, 2))), np.zeros((0, 3)), "unknown", float("nan")
    )
    return _judged(Way(size, name, tuple(Part(**part) for part in told["parts"])), poses, truth)


def _judged(way: Way, poses: Poses, truth: Path) -> Way:
    """With the errors of its poses."""
    known = read_truth(truth).cam_from_world
    share = float(poses.registered.mean())
    if known is None:
        return replace(way, registered_share=share)
    try:
        told: dict[str, Any] = evaluate_poses(poses, known).as_dict()
    except TruthError:  # too few views placed
        return replace(way, registered_share=share)
    return replace(
        way, registered_share=share, rotation_deg=told["rotation_median_deg"],
        position_percent=told["position_median_percent"],
    )  # fmt: skip


def _child(words: Sequence[str], name: str) -> tuple[float, float, str]:
    """Seconds, core-seconds and output of a program."""
    with sets.job(name) as progress:
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(words, capture_output=True, text=True, cwd=_root())
        seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        progress.step(1.0)  # Ctrl-C reached the process as well: that is a stop and no fault
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        raise BenchError(f"{name} failed: {said[-1] if said else f'exit code {done.returncode}'}")
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, used, done.stdout


def _root() -> Path:
    return Path(__file__).parents[2]


def table(ways: Sequence[Way]) -> str:
    """Stages as rows, way by way, and what each way's poses are worth."""
    lines = [["photographs", "way", "part", "seconds", "of it starting", "core-seconds", "peak MB"]]
    for way in ways:
        for part in way.parts:
            cost = [f"{part.seconds:.1f}", f"{part.starting:.1f}", f"{part.core_seconds:.1f}"]
            lines.append([way.size, way.name, part.name, *cost, f"{part.peak_bytes / 1e6:.0f}"])
        cores = sum(part.core_seconds for part in way.parts)
        starting, peak = sum(part.starting for part in way.parts), max(part.peak_bytes for part in way.parts)
        total = [f"{way.seconds:.1f}", f"{starting:.1f}", f"{cores:.1f}", f"{peak / 1e6:.0f}"]
        lines.append([way.size, way.name, "**all**", *total])
    placed = [["photographs", "way", "registered %", "rotation deg", "position % of the path"]]
    for way in ways:
        share = None if way.registered_share is None else 100 * way.registered_share
        errors = [shown(way.rotation_deg, 3), shown(way.position_percent, 3)]
        placed.append([way.size, way.name, shown(share, 0), *errors])
    return markdown(lines) + "\n\n" + markdown(placed)


def as_metrics(ways: Sequence[Way]) -> list[Metric]:
    """Seconds, core-seconds and memory of each part; gated are core-seconds in another way's: of the same stage, or of the poses."""
    metrics = []
    for way in ways:
        for part in way.parts:
            key = f"{way.size}/{_key(way)}/{part.name}"
            metrics += [
                Metric(f"{key}/seconds", part.seconds, "s", "lower"),
                Metric(f"{key}/core-seconds", part.core_seconds, "s", "lower"),
                Metric(f"{key}/peak", float(part.peak_bytes), "bytes", "lower"),
            ]
    for mine in (way for way in ways if way.name == OURS):
        # What placed few views is quick, and no measure.
        others = (way for way in ways if way.size == mine.size and way.name != OURS)
        for other in (way for way in others if (way.registered_share or 0) >= LEAST_PLACED):
            took = {part.name: part.core_seconds for part in other.parts}
            whole = sum(took.values())
            for part in mine.parts:
                against = took.get(part.name, whole if part.name == "poses" else None)
                if against is not None:
                    key, ratio = f"{mine.size}/{part.name}-in-{_key(other)}", part.core_seconds / against
                    metrics.append(Metric(key, ratio, "1", "lower", GATED_SHARE * ratio))
    return metrics


def _key(way: Way) -> str:
    return way.name.replace(" ", "-")
