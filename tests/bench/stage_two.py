"""Prints how far our colour solve and the paper's Adam bring Eq. (6), and what each takes, from one start.

    python -m tests.bench.stage_two SESSION [--iterations N] [--most N] [--width N] [--seconds S] [--json FILE]

The start is the paper's stage 1 (N iterations, cut short in proportion), with its bright Gaussians. Both work on the
same rows, with the photographs as the paper takes them. "Eq. (6)" is the loss; "frozen" is the loss with sg(m) held
at our final rendering, which is what the two may be compared by: the gradient of Eq. (6) is that of a loss frozen
where it is. Adam stops at 30 000 iterations or after S seconds.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from app.bench.markdown import markdown
from engine.errors import RoomlightError
from engine.light.fitting.color_solve import epsilon_of, linear_renders, render_rows, solve_colours
from engine.light.fitting.fit import split_views
from engine.light.fitting.params import LightParams
from engine.light.fitting.plane_sweep import knee_of
from engine.light.fitting.training_views import resample
from engine.light.gaussians.gaussians import Y00
from engine.light.gaussians.rasterize import shapes, thread_pool
from engine.reference.emitter.two_stage import (
    descend,
    high_luminance,
    relative_l1,
    scaled,
    stage_one,
    supervision,
)
from tests.bench.inputs import Clock, Inputs, inputs, machine, told, warm

STOPS = (300, 3000, 30_000)
SAME = 0.02
"""Two answers are called the same minimum if their frozen losses differ by so much of the fall from the start."""


@dataclass(frozen=True, slots=True)
class Row:
    """One way to solve stage 2."""

    way: str
    eq6: float
    frozen: float
    seconds: float
    core_seconds: float


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    try:
        given = inputs(args.session)
    except RoomlightError as error:
        print(error, file=sys.stderr)
        return 2
    where = machine()
    warm(given)
    rows = compare(given, args.iterations, args.most, args.width, args.seconds)
    print(f"{args.session.name}: stage 1 of {args.iterations} iterations, {args.width} px, {where}\n")
    print(table(rows))
    print("\n" + verdict(rows))
    if args.json:
        content = {"session": args.session.name, "machine": where, "rows": [asdict(row) for row in rows]}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def compare(given: Inputs, iterations: int, most: int, width: int, seconds: float) -> list[Row]:
    """Start, ours as the fit asks and to the very minimum, and Adam at every stop."""
    frames, masks, poses = given
    used, _ = split_views(poses, LightParams().validation_every)
    photographs = supervision(resample(frames, masks, poses, used, width))
    params = replace(scaled(iterations / 30_000), most=most, degree=0)
    rng = np.random.default_rng(0)
    with thread_pool() as run:
        gaussians = stage_one(photographs, poses.points, params, rng, told("stage 1"), run)
        rows, free = linear_renders(shapes(gaussians), photographs, run), high_luminance(gaussians)
        start, epsilon = np.maximum(gaussians.radiance[:, 0] * Y00, 0), epsilon_of(rows)
        found = [("start", start, (0.0, 0.0))]
        for way, reweightings, hold in (("ours, as in a fit", 3, 0.02), ("ours, to the end", 30, 1e-4)):
            clock = Clock()
            colours = solve_colours(rows, start, free, "relative", run, reweightings=reweightings, hold=hold)
            found.append((way, colours, clock.read()))
        clock, at = Clock(), clock.read()
        for step, radiance in enumerate(
            descend(gaussians, rows, photographs, free, knee_of(photographs), rng, run), 1
        ):
            at = clock.read()
            if step in STOPS or at[0] > seconds:
                found.append((f"Adam, {step} iterations", np.maximum(radiance[:, 0] * Y00, 0), at))
            if step == STOPS[-1] or at[0] > seconds:
                break

        def rendered(colours: np.ndarray) -> np.ndarray:
            out = np.empty((len(rows.begins), 3))
            render_rows(rows, colours, out, run)
            return out

        best, seen = rendered(found[2][1]), rows.photographed
        return [
            Row(way, relative_l1(seen, m, epsilon), relative_l1(seen, m, epsilon, best), *cost)
            for way, colours, cost in found
            for m in [rendered(colours)]
        ]


def table(rows: Sequence[Row]) -> str:
    """A Markdown table; times are also told in units of ours to the end."""
    lines = [["way", "Eq. (6)", "frozen", "of ours' fall", "s", "core-s", "core-s / ours"]]
    for row in rows:
        times = row.core_seconds / rows[2].core_seconds
        cells = [f"{row.eq6:.5f}", f"{row.frozen:.5f}", f"{fall(rows, row):.3f}"]
        lines.append([row.way, *cells, f"{row.seconds:.2f}", f"{row.core_seconds:.2f}", f"{times:.2f}"])
    return markdown(lines)


def fall(rows: Sequence[Row], row: Row) -> float:
    """How far the frozen loss fell, in units of the fall of ours to the end; NaN where there was none."""
    whole = rows[0].frozen - rows[2].frozen
    return (rows[0].frozen - row.frozen) / whole if whole else float("nan")


def verdict(rows: Sequence[Row]) -> str:
    """Whether the last row reached what ours did."""
    share = fall(rows, rows[-1])
    word = "the same minimum" if abs(share - 1) <= SAME else "not the same minimum"
    return f"{rows[-1].way}: {share:.4f} of the fall of ours, {word} (tolerance {SAME:g})"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="stage_two", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--iterations", type=int, default=1500, help="of stage 1, which gives the start")
    parser.add_argument("--most", type=int, default=50_000, help="Gaussians")
    parser.add_argument(
        "--width", type=int, default=LightParams().max_image_width, help="of the pictures, pixels"
    )
    parser.add_argument("--seconds", type=float, default=float("inf"), help="after which Adam stops")
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
