"""Prints the paper's training of the emitter beside ours, on the same photographs in one run.

    python -m tests.bench.two_stage SESSION [--iterations N] [--most N] [--width N] [--json FILE]

SESSION has its stages hdr, segment and poses done (`roomlight process SESSION --until poses`); it is only read.
The paper's stages take 30 000 iterations each; with fewer all its counts are cut short in proportion, and the rows
say so. The same views are held out of every fit, and the same measure judges all: error and energy of background
pixels at one size, that of the pictures all were trained on; and where SESSION lies in a set with its truth, the mean error
of the irradiance at the object.
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
from engine.light.fitting.fit import evaluate, fit, split_views
from engine.light.fitting.params import LightParams
from engine.light.fitting.training_views import resample
from engine.light.gaussians.rasterize import thread_pool
from engine.reference.emitter.two_stage import EmitterParams, scaled, stage_one, stage_two, supervision
from engine.types import Gaussians, Lamps
from hardware.errors import StudioError
from tests.bench import irradiance
from tests.bench.inputs import Clock, Inputs, inputs, machine, told, warm


@dataclass(frozen=True, slots=True)
class Row:
    """One method: what it cost, and how well it predicts the views that were held out."""

    method: str
    iterations: str
    seconds: float
    core_seconds: float
    gaussians: int
    heldout_log_l1: float
    irradiance: float | None  # error at the object, percent; None: no truth beside the session
    heldout_energy: float
    heldout_energy_bright: float


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    try:
        given = inputs(args.session)
        known = (args.session.resolve().parent / "truth").is_dir()
        lit = irradiance.beside(args.session) if known else None
    except (RoomlightError, StudioError) as error:
        print(error, file=sys.stderr)
        return 2
    where = machine()
    warm(given)
    rows = compare(given, lit, args.iterations, args.most, args.width, args.seed)
    print(f"{args.session.name}: {len(given[0].names)} views, {args.width} px, {where}\n")
    print(table(rows))
    if args.json:
        content = {"session": args.session.name, "machine": where, "rows": [asdict(row) for row in rows]}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def compare(
    given: Inputs, lit: irradiance.Lit | None, iterations: int, most: int, width: int, seed: int
) -> list[Row]:
    """The paper's one stage, both its stages, and ours."""
    frames, masks, poses = given
    ours = replace(LightParams(), max_image_width=width)
    share = iterations / EmitterParams().iterations
    params = replace(scaled(share), width=width, most=most, holdout=ours.validation_every)
    cut = "" if share == 1 else f" (scaled, 1/{1 / share:.3g})"
    used, held = split_views(poses, ours.validation_every)

    clock = Clock()
    gaussians, lamps, report = fit(frames, masks, poses, ours, seed, told("ours"))
    fitted = ("ours", f"{ours.epochs} passes", *clock.read(), gaussians)

    rng = np.random.default_rng(seed)
    with thread_pool() as run:
        clock = Clock()
        photographs = supervision(resample(frames, masks, poses, used, width))
        first = stage_one(photographs, poses.points, params, rng, told("the paper's stage 1"), run)
        count = f"{params.iterations}{cut}"
        one = ("the paper's, stage 1 alone", count, *clock.read(), first)
        both = stage_two(first, photographs, params, rng, told("the paper's stage 2"), run)
        two = (
            "the paper's, two stages",
            f"{params.iterations} + {params.refinements}{cut}",
            *clock.read(),
            both,
        )
        judged = resample(frames, masks, poses, held if len(held) else used, width)

        none = Lamps(lamps.centres[:0], lamps.radii[:0], lamps.radiance[:0], lamps.clipped[:0])

        def row(
            method: str, iterations: str, wall: float, cores: float, found: Gaussians, apart: Lamps = none
        ) -> Row:
            scores = evaluate(found, judged, report.knee, run)
            kept = {name: scores[name] for name in Row.__slots__ if name in scores}
            off = None if lit is None else irradiance.off(lit, found, apart).mean
            return Row(method, iterations, wall, cores, len(found.means), irradiance=off, **kept)

        return [row(*one), row(*two), row(*fitted, lamps)]


def table(rows: Sequence[Row]) -> str:
    """A Markdown table; times are also told in units of the last row's."""
    lines = [
        ["method", "iterations", "Gaussians", "s", "core-s", "core-s / ours", "held-out log-L1",
         "irradiance off %", "energy, all", "energy, brightest 1 %"],
    ]  # fmt: skip
    for row in rows:
        lines.append(
            [row.method, row.iterations, str(row.gaussians), f"{row.seconds:.1f}", f"{row.core_seconds:.1f}",
             f"{row.core_seconds / rows[-1].core_seconds:.1f}", f"{row.heldout_log_l1:.4f}",
             "-" if row.irradiance is None else f"{row.irradiance:.2f}", f"{row.heldout_energy:.3f}", f"{row.heldout_energy_bright:.3f}"]
        )  # fmt: skip
    return markdown(lines)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="two_stage", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--iterations", type=int, default=EmitterParams().iterations, help="of each stage")
    parser.add_argument("--most", type=int, default=EmitterParams().most, help="Gaussians of the paper's")
    parser.add_argument(
        "--width", type=int, default=LightParams().max_image_width, help="of the pictures, pixels"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
