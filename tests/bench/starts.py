"""Prints how far the surface depends on where its solve starts.

    python -m tests.bench.starts SESSION [--starts N] [--preset NAME] [--json FILE]

SESSION has its light done (`roomlight process SESSION --until light`); it is only read. Beside the solver's own
start, a search over the sphere of normals, it is started from N draws of random normals towards the camera and random
roughness, everything else alike. A pixel agrees where its normal is within half a degree of the usual answer; target:
99 % of the pixels from each of 20 starts.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from unittest import mock

import numpy as np
from jaxtyping import Float

from app import cores
from app.bench.markdown import markdown
from app.bench.rows import params_of
from app.bench.stored import Stored, load
from engine.errors import RoomlightError
from engine.geometry import angle_between
from engine.surface import passes
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels
from engine.surface.solve import solve
from engine.types import Surface
from tests.bench.inputs import machine, told

AGREE_DEG = (0.5, 1.0, 3.0)


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    cores.prepare()
    try:
        given = load(args.session)
    except RoomlightError as error:
        print(error, file=sys.stderr)
        return 2
    where, params = machine(), params_of(args.preset)
    usual = solve(given.captured, params, "cpu", 0, told("usual start")).surface
    others = [from_random(given, params, seed) for seed in range(args.starts)]
    off = np.stack([apart(usual, other) for other in others])
    lines = [["start", *(f"within {limit:g} deg %" for limit in AGREE_DEG), "median deg"]]
    for k, one in enumerate(off):
        lines.append([str(k), *(f"{100 * share:.2f}" for share in within(one)), f"{np.median(one):.4f}"])
    lines.append(["all of them", *(f"{100 * share:.2f}" for share in within(off.max(0))), ""])
    print(f"{args.session.name}: {off.shape[1]} pixels, preset {args.preset}, {where}\n")
    print(markdown(lines))
    if args.json:
        content = {"session": args.session.name, "machine": where, "within": [within(one) for one in off]}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def from_random(given: Stored, params: SurfaceParams, seed: int) -> Surface:
    """The answer from a random start."""

    def start(object_pixels: ObjectPixels, *_: object) -> gauss_newton.PixelEstimate:
        return drawn(object_pixels.rays, np.random.default_rng(seed))

    with mock.patch.object(passes, "search_initial_normals", start):
        return solve(given.captured, params, "cpu", 0, told(f"start {seed}")).surface


def drawn(rays: Float[np.ndarray, "p 3"], rng: np.random.Generator) -> gauss_newton.PixelEstimate:
    """Normals evenly over the half of the sphere that faces the camera; grey."""
    count = len(rays)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= -np.sign((normals * rays).sum(1, keepdims=True))
    return gauss_newton.initial_estimate(normals, np.full((count, 3), 0.5), rng.uniform(0.2, 0.9, count))


def apart(one: Surface, other: Surface) -> Float[np.ndarray, " p"]:
    """Angle between two answers' normals, degrees, pixel by pixel."""
    return np.degrees(angle_between(one.normal[one.mask], other.normal[one.mask]))


def within(off: Float[np.ndarray, " p"]) -> list[float]:
    return [float((off <= limit).mean()) for limit in AGREE_DEG]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="starts", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--preset", default="standard")
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
