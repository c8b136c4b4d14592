"""Prints how near our solver comes to what its photographs allow, when the studio's own light is given: one row per set.

    python -m tests.bench.true_light FOLDER [--rooms study,lamps,window] [--objects blob,sphere] [--json FILE]

FOLDER holds sets as `roomlight bench` makes them (size small, true poses and masks); missing ones are made. The light
is the studio's (`true_incident`), the object's distance the true one, nothing of the light is refined; from there on it
is our solver with all its machinery, from a global search on. "bound" is the mean error of the best unbiased estimate from
each pixel for itself (`bound`), with the true depth, visibility and bounced light; "without path noise" counts the
sensor alone. "from the truth" is the same error where Gauss-Newton begins at the truth and knows the true depth: what
photographs and model disagree on, however the answer is found. Sets of which less than `HIDDEN` of the
hemisphere is hidden count as convex. Neighbours' accord may come below the bound, which knows single pixels.
"""

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from app import cores, places, results
from app.bench import sets
from app.bench.markdown import markdown, shown
from app.bench.sizes import OBJECTS, ROOMS, SIZES
from engine.errors import RoomlightError
from engine.geometry import angle_between
from engine.hdr import HdrReport
from engine.metrics import psnr
from engine.pipeline import run
from engine.progress import Progress
from engine.surface.newton import STEP, State, begin, iterate, respread, variants
from engine.surface.pixels import Subject, SurfaceParams, depth_of, search, sight_of, subject
from engine.surface.rough import reach
from engine.surface.solve import until_still
from engine.surface.transport import Incident, Responses, Sight, blocks, lattice_around
from engine.truth import Truth
from hardware.errors import StudioError
from hardware.virtual.studio import shoot
from tests.bench import true_incident
from tests.bench.bound import Scatter, expected_angle, information
from tests.bench.light_sets import session_per_studio

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
    ("bound mean deg", "bound", 2),
    ("median", "bound_median", 2),
    ("without path noise", "bound_sensor", 3),
    ("error / bound", "ratio", 2),
    ("off the rim deg", "inner", 2),
    ("from the truth deg", "from_truth", 2),
    ("albedo dB", "albedo_db", 1),
    ("roughness MAE", "roughness_mae", 3),
    ("hidden %", "hidden", 1),
    ("rounds", "rounds", 0),
    ("s", "seconds", 0),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One set; degrees and means over the object's pixels unless a name says otherwise."""

    name: str
    pixels: int
    views: int
    mean: float
    median: float
    bound: float
    bound_median: float
    bound_sensor: float
    ratio: float
    inner: float  # without the pixels that may hold some background
    from_truth: float
    albedo_db: float
    roughness_mae: float
    hidden: float  # per cent of the hemisphere that the object hides from itself
    rounds: int
    seconds: float  # of the solve, with its search

    @property
    def convex(self) -> bool:
        return self.hidden < 100 * HIDDEN


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A set's photographs with the light and the truth they were taken of."""

    who: Subject
    light: Incident
    truth: Truth
    scatter: Scatter


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    cores.prepare()
    rooms, things = (tuple(filter(None, names.split(","))) for names in (args.rooms, args.objects))
    rows = []
    try:
        sets.check_names(rooms, things)
        params = SurfaceParams(
            directions=args.directions, rounds=ROUNDS, held_out=0, relight=False, model_error=args.model_error
        )
        for room in rooms:
            for thing in things:
                one = sets.ready(args.folder, room, thing, SIZE, SIZE.views, 0, "cpu")
                with sets.job(one.name) as progress:
                    known = furnished(one, params, progress.part(0, 0.2))
                    rows.append(score(one.name, known, params, progress.part(0.2, 1)))
                print(table(rows[-1:]).splitlines()[-1], file=sys.stderr)
    except (RoomlightError, StudioError) as fault:
        print(fault, file=sys.stderr)
        return 2
    print(f"{params.directions} directions, {os.cpu_count()} cores, {platform.machine()}\n\n{table(rows)}\n")
    print("\n".join(verdicts(rows)))
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return 0


def furnished(one: sets.Set, params: SurfaceParams, progress: Progress) -> Known:
    """A set under the studio's light; the truth's poses are its poses.

    Raises:
        StudioError: Mitsuba has no vectorised variant here.
    """
    order = shoot.Order(one.room, one.thing, SIZE.views, SIZE.width, SIZE.height, SIZE.motion, 0, "cpu")
    studio = shoot.build(order, places.cache() / "studio", progress.part(0, 0.3).step)
    frames, masks, poses, *_ = one.stored.inputs
    report = run.loader(results.steps_of(one.session))("hdr", "report", HdrReport)
    mask = masks.object & one.truth.mask
    lattice = lattice_around(poses.camera, mask, reach(one.truth.depth[mask]), PROBES)
    light = true_incident.incident_of(
        studio.room, studio.atlas, poses.cam_from_world, lattice, params.directions,
        session_per_studio(report.scale), 1, "cpu", progress.part(0.3, 1),
    )  # fmt: skip
    views = np.nonzero(poses.registered)[0]
    who = subject(frames, mask, poses.camera, views, params)
    return Known(who, light.views(views), one.truth, Scatter(*frames.noise, shoot.NOISE))


def score(name: str, known: Known, params: SurfaceParams, progress: Progress) -> Row:
    """Solve, and hold the answer against the truth and against what the photographs allow."""
    who, light, truth = known.who, known.light, known.truth
    begun, z = time.perf_counter(), float(truth.depth[who.mask].mean())
    sight = who.flat(z)
    state = search(who, light, sight, params, "cpu", progress.part(0, 0.1))
    depth = depth_of(who, state, z, progress.part(0.1, 0.12))
    state, _, rounds = until_still(
        who, state, depth, sight, light, z, params, "cpu", progress.part(0.12, 0.9)
    )
    seconds = time.perf_counter() - begun
    true = begin(truth.normal[who.mask], truth.albedo[who.mask], truth.roughness[who.mask])
    sight = sight_of(who, true, truth.depth, light.directions, params, progress.part(0.9, 0.92))
    least, sensor = bounds(known, true, sight, params)
    hidden = sight.occlusion.share.mean() if sight.occlusion is not None else 0.0
    near = from_truth(known, true, sight, params, progress.part(0.92, 1))
    error, nearest = (np.degrees(angle_between(x.normals, true.normals)) for x in (state, near))
    return Row(
        name, len(error), light.energy.shape[2] // 3, float(error.mean()), float(np.median(error)),
        float(least.mean()), float(np.median(least)), float(sensor.mean()), float(error.mean() / least.mean()),
        float(error[~who.seen.edge].mean()), float(nearest.mean()), psnr(state.albedo - true.albedo),
        float(np.abs(state.roughness - true.roughness).mean()), float(100 * hidden),
        rounds, seconds,
    )  # fmt: skip


def bounds(
    known: Known, true: State, sight: Sight, params: SurfaceParams
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Degrees that each normal is off at least on average: with the path tracer's noise, and without."""
    responses = known.who.responses(known.light, params, "cpu")
    sensor = Scatter(known.scatter.shot, known.scatter.floor, 0.0)
    found = np.zeros((2, len(true.normals)))
    for pixels in blocks(known.who.mask):
        radiance, jacobian = derivatives(responses, sight, pixels, true)
        usable = known.who.seen.weight[pixels].reshape(radiance.shape) > 0
        jacobian *= usable[..., None]
        for row, scatter in enumerate((known.scatter, sensor)):
            found[row, pixels] = expected_angle(information(radiance, jacobian, scatter))
    least, without = np.degrees(found)
    return least, without


def derivatives(
    responses: Responses, sight: Sight, pixels: np.ndarray, at: State
) -> tuple[Float[np.ndarray, "p n 3"], Float[np.ndarray, "p n 3 6"]]:
    """Radiance of some pixels in every view, and its derivatives by the six unknowns."""
    n, r, albedo = at.normals[pixels], at.roughness[pixels], at.albedo[pixels][:, None]
    leaning, rough, inward = variants(n, r)
    diffuse, specular = (
        x.astype(np.float64).reshape(len(pixels), 4, -1, 3)
        for x in responses(responses.block(sight, pixels), leaning, rough)
    )
    sent = albedo[:, None] * diffuse + specular
    steps = np.stack([np.full(len(pixels), STEP), np.full(len(pixels), STEP), inward], 1)
    jacobian = np.zeros((*sent[:, 0].shape, 6))
    for k, unknown in enumerate((0, 1, 5)):
        jacobian[..., unknown] = (sent[:, k + 1] - sent[:, 0]) / steps[:, k, None, None]
    for c in range(3):
        jacobian[:, :, c, 2 + c] = albedo[..., c] * diffuse[:, 0, :, c]
    return sent[:, 0], jacobian


def from_truth(known: Known, true: State, sight: Sight, params: SurfaceParams, progress: Progress) -> State:
    """Where Gauss-Newton ends that begins at the truth and sees what the true depth hides."""
    who, parts = known.who, blocks(known.who.mask)
    responses = who.responses(known.light, params, "cpu")
    begun = respread(true, responses, sight, parts, who.seen)
    return iterate(begun, responses, sight, parts, who.seen, params.passes, progress)


def table(rows: Sequence[Row]) -> str:
    """A Markdown table: the sets and their mean."""
    lines = [["set", *(heading for heading, *_ in COLUMNS)]]
    lines += [[row.name, *(shown(getattr(row, key), d) for _, key, d in COLUMNS)] for row in rows]
    if len(rows) > 1:
        means = {key: statistics.fmean(getattr(row, key) for row in rows) for _, key, _ in COLUMNS}
        lines.append(["mean", *(shown(means[key], decimals) for _, key, decimals in COLUMNS)])
    return markdown(lines)


def verdicts(rows: Sequence[Row]) -> list[str]:
    """One line for each of the two targets."""
    convex = [row for row in rows if row.convex]
    told = []
    if convex:
        off, least = (statistics.fmean(getattr(row, key) for row in convex) for key in ("mean", "bound"))
        verdict = "reached" if off <= TIMES_BOUND * least else "missed"
        told.append(
            f"convex ({', '.join(row.name for row in convex)}): {off:.2f} deg is {off / least:.2f} x the bound;"
            f" target <= {TIMES_BOUND}: {verdict}"
        )
    off = statistics.fmean(row.mean for row in rows)
    verdict = "reached" if off <= ALL_DEG else "missed"
    return [*told, f"all {len(rows)} sets: {off:.2f} deg; target <= {ALL_DEG}: {verdict}"]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="true_light", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--objects", default=",".join(OBJECTS))
    parser.add_argument("--directions", type=int, default=1024)
    parser.add_argument("--model-error", type=float, default=SurfaceParams().model_error)
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
