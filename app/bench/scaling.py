"""How seconds and memory grow with views, pixels, Gaussians and directions: points, fitted exponents, a table."""

import contextlib
import hashlib
import json
import math
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app import places
from app.bench import record
from app.bench.front import exponent
from app.bench.markdown import markdown
from app.bench.point import AXES
from app.bench.record import BenchError, Metric
from app.bench.sets import Set, job
from engine.pipeline.stages import canonical

SHARES = (0.25, 0.5, 1.0)
FEWEST_VIEWS, FEWEST_PIXELS = 10, 100


@dataclass(frozen=True, slots=True)
class Point:
    """Ours at its defaults on a part of a set."""

    axis: str
    value: int
    seconds: float
    peak_bytes: int  # of the whole process
    solve_bytes: int  # above what the process held before it solved
    run: str


def values(on: Set, directions: Sequence[int]) -> dict[str, list[int]]:
    """What is tried along every axis; the whole set is tried with the defaults along each."""
    views, pixels = len(on.stored.frames.names), int(on.stored.masks.object.sum())
    gaussians = len(on.stored.gaussians.means)

    def shares(of: int, fewest: int) -> list[int]:
        return sorted({min(of, max(fewest, round(share * of))) for share in SHARES})

    axes = (
        shares(views, FEWEST_VIEWS),
        shares(pixels, FEWEST_PIXELS),
        shares(gaussians, 100),
        list(directions),
    )
    return dict(zip(AXES, axes, strict=True))


def measure(
    on: Set, folder: Path, axis: str, value: int, device: str, seed: int, run: str, fresh: bool
) -> Point:
    """One point, in a process of its own; kept for the next call.

    Raises:
        BenchError: the process failed, with its last line.
    """
    facts = [on.stored.fingerprint, axis, value, device, seed, record.engine_digest()]
    path = folder / "points" / f"{hashlib.sha256(canonical(facts).encode()).hexdigest()[:16]}.json"
    if path.exists() and not fresh:
        with contextlib.suppress(ValueError, TypeError):  # damaged: measured again
            return Point(**json.loads(path.read_text()))
    # Another folder is the child's own: a path that is relative here is another one there.
    session = str(on.session.absolute())
    words = [sys.executable, "-m", "app.bench.point", session, axis, str(value), device, str(seed)]
    with job(f"{on.name} {value} {axis}") as progress:
        done = subprocess.run(words, capture_output=True, text=True, cwd=_root())
        progress.step(1.0)  # Ctrl-C reached the process as well: that is a stop and no fault
    if done.returncode:
        said = done.stderr.strip().splitlines()
        why = said[-1] if said else f"exit code {done.returncode}"
        raise BenchError(f"{on.name} with {value} {axis} failed: {why}")
    answer = json.loads(done.stdout.splitlines()[-1])
    point = Point(axis, value, answer["seconds"], answer["peak_bytes"], answer["solve_bytes"], run)
    places.keep(path, json.dumps({name: getattr(point, name) for name in Point.__slots__}))
    return point


def table(points: Sequence[Point], run: str) -> str:
    """The points, and under them the exponents of each axis."""
    lines = [["axis", "value", "seconds", "peak MB", "of it the solve's MB"]]
    for p in points:
        mark = "" if p.run == run else "*"
        lines.append(
            [
                p.axis,
                str(p.value),
                f"{p.seconds:.2f}{mark}",
                f"{p.peak_bytes / 1e6:.0f}",
                f"{p.solve_bytes / 1e6:.0f}",
            ]
        )
    fits = [["axis", "seconds ~ value^p", "solve's memory ~ value^p"]]
    for axis in dict.fromkeys(p.axis for p in points):
        here = [p for p in points if p.axis == axis]
        fits.append([axis, _told(here, "seconds"), _told(here, "solve_bytes")])
    return markdown(lines) + "\n\n" + markdown(fits)


def as_metrics(points: Sequence[Point], name: str) -> list[Metric]:
    """The points, and exponents of points of one run; none is gated: they are the machine's."""
    found = []
    for p in points:
        at = f"{name}/{p.axis}={p.value}"
        found.append(Metric(f"{at}/seconds", p.seconds, "s", "lower"))
        found.append(Metric(f"{at}/peak_bytes", p.peak_bytes, "B", "lower"))
    for axis in dict.fromkeys(p.axis for p in points):
        here = [p for p in points if p.axis == axis]
        for what in ("seconds", "solve_bytes"):
            power, _ = fit(here, what)
            if not math.isnan(power):
                found.append(Metric(f"{name}/{axis}/{what}_exponent", power, "1", "lower"))
    return found


def fit(points: Sequence[Point], what: str) -> tuple[float, float]:
    """(exponent, its standard error); NaN unless one run measured two values or more."""
    if len({p.value for p in points}) < 2 or len({p.run for p in points}) > 1:
        return math.nan, math.nan
    return exponent([p.value for p in points], [getattr(p, what) for p in points])


def _told(points: Sequence[Point], what: str) -> str:
    power, spread = fit(points, what)
    if math.isnan(power):
        return "-"
    return f"{power:.2f}" if math.isnan(spread) else f"{power:.2f} ± {spread:.2f}"


def _root() -> Path:
    return Path(__file__).parents[2]
