"""Prints what becomes of the surface where capture goes wrong: one row per case, the light fitted anew for each.

    python -m tests.bench.hard_cases FOLDER [--object NAME] [--only WORDS] [--json FILE]

FOLDER keeps the sets (48 views of 320 x 240, true mask and poses given), which the studio makes on first use. "In band":
pixels whose true normal lies within the stated 95 %; a case may be worse than the first row, but ought to say so.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from app import cores
from app.bench import sets
from app.bench.choices import built_in
from app.bench.markdown import markdown
from app.bench.sizes import SIZES
from app.bench.stored import Stored, fewer_views
from engine.errors import RoomlightError
from engine.geometry import inverse, rays, tangents
from engine.light.fitting.fit import fit
from engine.light.fitting.lamp_model import with_lamps, without_lamps
from engine.light.fitting.params import LightParams
from engine.progress import Progress
from engine.results import metrics
from engine.surface.params import SurfaceParams
from engine.surface.solve import solve
from engine.types import Camera
from hardware.errors import StudioError
from tests.bench import irradiance
from tests.bench.inputs import Clock, machine, told

SIZE = SIZES["small"]
FEW = 12
TURNED_DEG = 0.5
DRIFT = 0.03
ASIDE_DEG = 2.0
PASSES_EVERY = 8  # a person is in every so many-th view
STRANGE = 0.3  # share of a picture's width and height that something which does not belong there takes
SCREEN = np.array([[1.597, 0.5, 0.98], [0.0, -0.29, 0.0], [0.0, 0.0, -0.17]])
"""Where the study's screen stands: its middle, and half its width and height (metres, the truth's world)."""
FLICKER = 2.0  # at most so many times brighter or darker than it is


@dataclass(frozen=True, slots=True)
class Case:
    """A set, and what is done to it before the light is fitted."""

    title: str
    room: str
    motion: str
    spoil: Callable[[Stored, np.random.Generator], Stored]
    spoil_lit: Callable[[Stored, np.random.Generator], Stored] = lambda given, rng: given  # after it
    thing: str = ""  # the object, where it is what is hard


@dataclass(frozen=True, slots=True)
class Row:
    """What came out."""

    title: str
    views: int
    normal_deg: float
    median_deg: float
    in_band: float
    albedo_db: float
    roughness: float
    distance: float  # ours over true
    stated: float  # its standard error, relative
    light: float  # log-L1 of the kept-out views
    irradiance: float  # error of the fitted light at the object, percent
    seconds: float


def untouched(given: Stored, rng: np.random.Generator) -> Stored:
    return given


def few(given: Stored, rng: np.random.Generator) -> Stored:
    """Some of the views, points of the room by all of them."""
    return fewer_views(given, FEW)


def turned(given: Stored, rng: np.random.Generator) -> Stored:
    """Every camera turned about its place, by half a degree about a random axis; no points."""
    axes = rng.normal(size=(len(given.frames.names), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turn = Rotation.from_rotvec(np.radians(TURNED_DEG) * axes).as_matrix()
    poses = replace(given.poses, cam_from_world=turn @ given.poses.cam_from_world, points=np.zeros((0, 3)))
    return replace(given, poses=poses)


def moved_chair(given: Stored, rng: np.random.Generator) -> Stored:
    """In one view something dark stands that no other shows."""
    return _strange(given, [len(given.frames.names) // 2], 0.05)


def passer_by(given: Stored, rng: np.random.Generator) -> Stored:
    """In every eighth view somebody stands, elsewhere each time."""
    return _strange(given, range(0, len(given.frames.names), PASSES_EVERY), 0.4, rng)


def flickering(given: Stored, rng: np.random.Generator) -> Stored:
    """The study's screen is brighter or darker in every view, evenly in the logarithm.

    In the background only: the object is photographed as the steady screen lights it.
    """
    radiance, gains = given.frames.radiance.copy(), FLICKER ** rng.uniform(-1, 1, len(given.frames.names))
    for view, gain in enumerate(gains):
        on = screen_of(given.poses.camera, given.poses.cam_from_world[view]) & given.masks.background[view]
        radiance[view][on] *= np.float32(gain)
    return replace(given, frames=replace(given.frames, radiance=radiance))


def screen_of(camera: Camera, cam_from_world: Float[np.ndarray, "3 4"]) -> Bool[np.ndarray, "h w"]:
    """The pixels that look at the study's screen, as if nothing stood before it."""
    middle, right, down = SCREEN
    eye, towards = -cam_from_world[:, :3].T @ cam_from_world[:, 3], rays(camera) @ cam_from_world[:, :3]
    normal = np.cross(right, down)
    with np.errstate(divide="ignore"):
        reach = (middle - eye) @ normal / (towards @ normal)
    at = eye + reach[..., None] * towards - middle
    inside = (np.abs(at @ right) < right @ right) & (np.abs(at @ down) < down @ down)
    return inside & (reach > 0)


def drifting(given: Stored, rng: np.random.Generator) -> Stored:
    """Every photograph brighter or darker by a factor of its own."""
    factor = np.exp(DRIFT * rng.normal(size=len(given.frames.names)))
    radiance = (given.frames.radiance * factor[:, None, None, None]).astype(np.float32)
    return replace(given, frames=replace(given.frames, radiance=radiance))


def lamps_aside(given: Stored, rng: np.random.Generator) -> Stored:
    """Every lamp that was found in another direction, as seen from amid the cameras."""
    lamps = given.lamps
    away = lamps.centres - inverse(given.poses.cam_from_world[given.poses.registered])[..., 3].mean(0)
    first, second = tangents(away / np.linalg.norm(away, axis=1, keepdims=True))
    turn = rng.uniform(0, 2 * np.pi, (len(away), 1))
    far = np.tan(np.radians(ASIDE_DEG)) * np.linalg.norm(away, axis=1, keepdims=True)
    moved = replace(lamps, centres=lamps.centres + far * (np.cos(turn) * first + np.sin(turn) * second))
    return replace(given, lamps=moved, gaussians=with_lamps(without_lamps(given.gaussians, lamps), moved))


CASES = (
    Case("as it should be", "study", "gimbal", untouched),
    Case(f"{FEW} views", "study", "gimbal", few),
    Case(f"poses off by {TURNED_DEG} deg", "study", "gimbal", turned),
    Case("a chair moved in one view", "study", "gimbal", moved_chair),
    Case(f"somebody in every {PASSES_EVERY}th view", "study", "gimbal", passer_by),
    Case("a flickering screen", "study", "gimbal", flickering),
    Case("turned about one axis only", "study", "turntable", untouched),
    Case("walls without texture", "plain", "gimbal", untouched),
    Case("a floor like a mirror", "polished", "gimbal", untouched),
    Case("a lamp behind leaves", "leafy", "gimbal", untouched),
    Case("a chink 10,000 times brighter than the walls", "chink", "gimbal", untouched),
    Case(f"exposures drift by {DRIFT:.0%}", "study", "gimbal", drifting),
    Case(f"exposures drift by {DRIFT:.0%}, after the light", "study", "gimbal", untouched, drifting),
    Case(f"lamps {ASIDE_DEG:.0f} degrees off", "lamps", "gimbal", untouched, lamps_aside),
    Case("a quarter of it gilded", "study", "gimbal", untouched, thing="gilded"),
    Case("a coat that mirrors twice as much", "study", "gimbal", untouched, thing="lacquered"),
)


def _strange(
    given: Stored, views: Sequence[int], brightness: float, rng: np.random.Generator | None = None
) -> Stored:
    """A plate of even radiance, `brightness` times the room's mean, before the background of some views; on the right
    without `rng`."""
    radiance = given.frames.radiance.copy()
    _, height, width, _ = radiance.shape
    tall, wide = int(STRANGE * height), int(STRANGE * width)
    mean = radiance[given.masks.background].mean(0)
    for view in views:
        top, left = (height - tall) // 2, width - wide
        if rng is not None:
            top, left = int(rng.integers(height - tall)), int(rng.integers(width - wide))
        plate = np.zeros((height, width), bool)
        plate[top : top + tall, left : left + wide] = True
        radiance[view][plate & given.masks.background[view]] = brightness * mean
    return replace(given, frames=replace(given.frames, radiance=radiance))


def measured(case: Case, on: sets.Set) -> Row:
    """Light and surface of the spoilt set, against the truth."""
    spoilt, truth = case.spoil(on.stored, np.random.default_rng(0)), on.truth
    clock = Clock()
    gaussians, lamps, light = fit(spoilt.frames, spoilt.masks, spoilt.poses, LightParams(), 0, Progress())
    spoilt = case.spoil_lit(replace(spoilt, gaussians=gaussians, lamps=lamps), np.random.default_rng(0))
    solved = solve(spoilt.captured, SurfaceParams(), "cpu", 0, told(case.title))
    surface, report = solved.surface, solved.report
    seconds, _ = clock.read()
    found, off = (
        metrics.evaluate(surface, truth),
        irradiance.off(irradiance.beside(on.session), gaussians, lamps),
    )
    both = surface.mask & truth.mask
    distance = float(np.median(surface.depth[both] / truth.depth[both]))
    return Row(
        case.title, len(spoilt.frames.names), found.normal_mean_deg, found.normal_median_deg, found.normal_in_band,
        found.albedo_psnr_db, found.roughness_mae, distance, report.distance.stderr / report.distance.value,
        light.heldout_log_l1, off.mean, seconds,
    )  # fmt: skip


def table(rows: Sequence[Row]) -> str:
    lines = [
        ["case", "views", "normals deg", "median", "in band %", "albedo dB", "roughness", "distance ours/true",
         "stated +-", "light log-L1", "irradiance off %", "s"]
    ]  # fmt: skip
    for row in rows:
        lines.append([
            row.title, str(row.views), f"{row.normal_deg:.2f}", f"{row.median_deg:.2f}", f"{100 * row.in_band:.0f}",
            f"{row.albedo_db:.1f}", f"{row.roughness:.4f}", f"{row.distance:.3f}", f"{row.stated:.3f}",
            f"{row.light:.4f}", f"{row.irradiance:.2f}", f"{row.seconds:.0f}",
        ])  # fmt: skip
    return markdown(lines)


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    cores.prepare()
    where, rows = machine(), []
    try:
        for case in CASES:
            if args.only in case.title:
                size = replace(SIZE, motion=case.motion)
                on = sets.ready(
                    args.folder,
                    built_in(case.room),
                    built_in(case.thing or args.object),
                    size,
                    size.views,
                    0,
                    "cpu",
                )
                rows.append(measured(case, on))
                print(table(rows[-1:]).splitlines()[-1], file=sys.stderr)
    except (RoomlightError, StudioError) as fault:
        print(fault, file=sys.stderr)
        return 2
    print(f"{args.object}, {SIZE.told()} but where another motion is named, {where}\n\n{table(rows)}")
    if args.json:
        args.json.write_text(
            json.dumps({"machine": where, "rows": [asdict(row) for row in rows]}, indent=1) + "\n"
        )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="hard_cases", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--object", default="blob")
    parser.add_argument("--only", default="", help="cases whose name holds these words")
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
