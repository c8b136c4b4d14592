"""Prints how near our solver comes to what its photographs allow, when the studio's own light is given: one row per set.

    python -m tests.bench.true_light FOLDER [--rooms study lamps] [--objects blob] [--object-size M] [--noise .03] [--one-in 6] [--json FILE]

FOLDER holds sets as `roomlight bench` makes them (size small, true poses and masks); missing ones are made. The light
is the studio's (`true_incident`), the object's distance the true one, nothing of the light is refined; from there on it
is our solver with all its machinery, from a global search on. "bound" is the mean error of the best unbiased estimate from
each pixel for itself (`bound`), with the true depth, visibility and bounced light; "without path noise" counts the
sensor alone. "from the truth" is the same error where Gauss-Newton begins at the truth and knows the true depth: what
photographs and model disagree on, however the answer is found. Sets of which less than `HIDDEN` of the
hemisphere is hidden count as convex. Neighbours' accord may come below the bound, which knows single pixels.
With --one-in N nothing is solved, and bound and "from the truth" are of one in N blocks of 16 x 16 pixels: a look.
"""

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from app import cores, places
from app.bench import choices, sets
from app.bench.bound import Known, known_of
from app.bench.information import Scatter
from app.bench.markdown import markdown, shown
from app.bench.sizes import OBJECTS, ROOMS, SIZES
from engine.errors import RoomlightError
from engine.geometry import angle_between
from engine.progress import Progress
from engine.results.metrics import psnr
from engine.surface import estimate
from engine.surface.data.scene import Picture, Scene
from engine.surface.estimate import Estimate
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.room_light import RoomLight, build_room_light
from engine.surface.optimize.gauss_newton import PixelEstimate, minimize
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import (
    depth_from_normals,
    geometry_with_visibility,
    search_initial_normals,
)
from engine.surface.rendering.transport import SurfaceGeometry, pixel_blocks
from engine.surface.schedule import run, schedule
from hardware.errors import StudioError
from hardware.virtual.studio import shoot
from hardware.virtual.studio.order import Order

SIZE = SIZES["small"]
PROBES = (3, 3, 3)
ROUNDS = 8
"""At most: no rough turns come before them, as they do in the product."""
HIDDEN = 0.005
TIMES_BOUND, ALL_DEG = 1.3, 0.8

# Heading, field, decimals.
COLUMNS = (
    ("normal mean deg", "mean", 2),
    ("median", "median", 2),
    ("off the rim", "inner", 2),
    ("bound mean deg", "bound", 2),
    ("median", "bound_median", 2),
    ("without path noise", "bound_sensor", 2),
    ("error / bound", "ratio", 2),
    ("from the truth deg", "from_truth", 2),
    ("off the rim", "from_truth_inner", 2),
    ("/ bound", "from_truth_ratio", 2),
    ("albedo dB", "albedo_db", 1),
    ("roughness MAE", "roughness_mae", 3),
    ("hidden %", "hidden", 2),
    ("rounds", "rounds", 0),
    ("s", "seconds", 0),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One set; degrees and means over the pixels looked at unless a name says otherwise."""

    name: str
    pixels: int
    views: int
    bound: float
    bound_median: float
    bound_sensor: float
    from_truth: float
    from_truth_inner: float  # without the pixels that may hold some background
    from_truth_ratio: float
    hidden: float  # per cent of the hemisphere that the object hides from itself
    mean: float | None = None  # None here and below: not solved
    median: float | None = None
    inner: float | None = None
    ratio: float | None = None
    albedo_db: float | None = None
    roughness_mae: float | None = None
    rounds: int | None = None
    seconds: float | None = None  # of the solve, with its search

    @property
    def convex(self) -> bool:
        return self.hidden < 100 * HIDDEN


@dataclass(frozen=True, slots=True, eq=False)
class Furnished:
    """A set under the studio's light, and its photographs."""

    known: Known
    picture: Picture
    room: RoomLight  # its poses are the truth's


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    cores.prepare()
    size = replace(SIZE, noise=args.noise)
    rows = []
    try:
        chosen = choices.rooms(args.rooms), choices.objects(args.objects, None, 0, args.object_size)
        params = SurfaceParams(
            directions=args.directions,
            fine_iterations=ROUNDS,
            validation_views=0,
            without=("light_gains",),
            model_error=args.model_error,
        )
        for room in chosen[0]:
            for thing in chosen[1]:
                one = sets.ready(args.folder, room, thing, size, size.views, 0, "cpu")
                with sets.job(one.name) as progress:
                    order = sets.order_of(room, thing, size, size.views, 0, "cpu")
                    given = made_ready(one, order, params, progress.part(0, 0.2))
                    row = score(one.name, given, params, args.one_in, progress.part(0.2, 0.3))
                    if args.one_in == 1:
                        row = solved(row, given, params, progress.part(0.3, 1))
                rows.append(row)
                print(table(rows[-1:]).splitlines()[-1], file=sys.stderr)
    except (RoomlightError, StudioError) as fault:
        print(fault, file=sys.stderr)
        return 2
    print(f"{params.directions} directions, {os.cpu_count()} cores, {platform.machine()}\n\n{table(rows)}\n")
    print("\n".join(verdicts(rows)))
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return 0


def made_ready(one: sets.Set, order: Order, params: SurfaceParams, progress: Progress) -> Furnished:
    """A set under the studio's light; the truth's poses are its poses.

    Raises:
        StudioError: Mitsuba has no vectorised variant here.
    """
    studio = shoot.build(order, places.cache() / "studio", progress.part(0, 0.3).step)
    known = known_of(one, studio, np.arange(SIZE.views), params, PROBES, progress.part(0.3, 1))
    picture = Picture(one.stored.frames, known.object_pixels.mask, one.stored.poses.camera)
    bare = SurfaceParams(light_groups=1, without=("light_gains",))
    room = build_room_light(one.stored.captured, bare, 0)
    return Furnished(known, picture, room)


def score(name: str, given: Furnished, params: SurfaceParams, one_in: int, progress: Progress) -> Row:
    """What the photographs of some blocks of pixels allow, and where Gauss-Newton ends near their truth."""
    known = given.known
    who, truth = known.object_pixels, known.truth
    parts = pixel_blocks(who.mask)[::one_in]
    pixels = np.concatenate(parts)
    true = known.true_state()
    sight = geometry_with_visibility(
        who, true, truth.depth, known.light.directions, params, progress.part(0, 0.1)
    )
    least, sensor = bounds(known, true, sight, params, parts)
    near = from_truth(known, true, sight, params, parts, progress.part(0.1, 1))
    error = np.degrees(angle_between(near.normals, true.normals))[pixels]
    hidden = sight.visibility.hidden_share.mean() if sight.visibility is not None else 0.0
    return Row(
        name, len(pixels), known.light.energy.shape[2] // 3, float(least.mean()), float(np.median(least)),
        float(sensor.mean()), float(error.mean()), float(error[~who.observations.edge[pixels]].mean()),
        float(error.mean() / least.mean()), float(100 * hidden),
    )  # fmt: skip


def solved(row: Row, given: Furnished, params: SurfaceParams, progress: Progress) -> Row:
    """The row with what our solver makes of the photographs, from nothing but the light and the distance."""
    known = given.known
    who, light, true = known.object_pixels, known.light, known.true_state()
    begun, z = time.perf_counter(), float(known.truth.depth[who.mask].mean())
    every = np.arange(SIZE.views)
    scene = Scene(
        given.picture, (given.picture,), given.room.poses, every, every, every[:0], params, "cpu", 0
    )
    sight = who.geometry_at(z)
    state = search_initial_normals(who, light, sight, params, progress.part(0, 0.1))
    depth = depth_from_normals(who, state, z, progress.part(0.1, 0.12))
    now = Estimate(0, every, who, given.room, Distance(z, 0.0, "given"), sight, state, depth, light=light)
    phases = [one for one in schedule(params, False) if one.name in ("fine", "finish")]
    now = run(scene, now, phases, progress.part(0.12, 1))
    state, rounds = estimate.known(now.state), len(now.residuals)
    error = np.degrees(angle_between(state.normals, true.normals))
    return replace(
        row,
        mean=float(error.mean()),
        median=float(np.median(error)),
        inner=float(error[~who.observations.edge].mean()),
        ratio=float(error.mean() / row.bound),
        albedo_db=psnr(state.albedo - true.albedo),
        roughness_mae=float(np.abs(state.roughness - true.roughness).mean()),
        rounds=rounds,
        seconds=time.perf_counter() - begun,
    )


def bounds(
    known: Known,
    true: PixelEstimate,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
    blocks: list[Int[np.ndarray, " _"]],
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Degrees that each normal is off at least on average: with the path tracer's noise, and without."""
    sensor = Scatter(known.scatter.shot, known.scatter.floor, 0.0)
    least, without = (
        np.concatenate(list(known.least(true, geometry, params, blocks, scatter)))
        for scatter in (known.scatter, sensor)
    )
    return least, without


def from_truth(
    known: Known,
    true: PixelEstimate,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
    blocks: list[Int[np.ndarray, " _"]],
    progress: Progress,
) -> PixelEstimate:
    """Where Gauss-Newton ends that begins at the truth and sees what the true depth hides."""
    problem = replace(known.object_pixels.problem(known.light, geometry, params, "cpu"), blocks=blocks)
    return minimize(true, problem, params.gauss_newton_steps, progress, reset_scale=True)


def table(rows: Sequence[Row]) -> str:
    """A Markdown table: the sets and their mean."""
    lines = [["set", *(heading for heading, *_ in COLUMNS)]]
    lines += [[row.name, *(shown(getattr(row, key), d) for _, key, d in COLUMNS)] for row in rows]
    if len(rows) > 1:
        cells = []
        for _, key, decimals in COLUMNS:
            known = [value for row in rows if (value := getattr(row, key)) is not None]
            cells.append(shown(statistics.fmean(known) if known else None, decimals))
        lines.append(["mean", *cells])
    return markdown(lines)


def verdicts(rows: Sequence[Row]) -> list[str]:
    """One line for each of the two targets; none for what was not solved."""
    answers = [(row, row.mean) for row in rows if row.mean is not None]
    convex = [(row, off) for row, off in answers if row.convex]
    told = []
    if convex:
        off, least = (
            statistics.fmean(off for _, off in convex),
            statistics.fmean(row.bound for row, _ in convex),
        )
        told.append(
            f"convex ({', '.join(row.name for row, _ in convex)}): {off:.2f} deg is {off / least:.2f} x the bound;"
            f" target <= {TIMES_BOUND}: {'reached' if off <= TIMES_BOUND * least else 'missed'}"
        )
    if answers:
        off = statistics.fmean(off for _, off in answers)
        verdict = "reached" if off <= ALL_DEG else "missed"
        told.append(f"all {len(answers)} sets: {off:.2f} deg; target <= {ALL_DEG}: {verdict}")
    return told


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="true_light", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rooms", nargs="+", default=ROOMS, metavar="NAME|SCENE")
    parser.add_argument("--objects", nargs="+", default=OBJECTS, metavar="NAME|MESH")
    parser.add_argument("--object-size", type=float, metavar="M", help="of meshes")
    parser.add_argument(
        "--noise", type=float, default=SIZE.noise, help="of the path tracer, in the photographs"
    )
    parser.add_argument("--directions", type=int, default=1024)
    parser.add_argument("--model-error", type=float, default=SurfaceParams().model_error)
    parser.add_argument("--one-in", type=int, default=1, help="see above; 1: all, and solve")
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
