"""Stage *surface*: from photographs and the room's light to normals, albedo, roughness, depth, with errors.

The order of work: the light at a lattice of probes around the object (near field), a global search that needs
no start, damped Gauss-Newton on every pixel, depth by integrating the normals, and again with the points,
visibility and inter-reflection that the depth gives. Some views are kept out of the fit and re-rendered.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int
from scipy.ndimage import binary_erosion

from engine.errors import SurfaceError
from engine.geometry import inverse, rays, transform
from engine.light.probes import incident_energy
from engine.progress import Progress
from engine.surface import newton
from engine.surface.distance import Distance, find_distance
from engine.surface.groups import brightened, group_emitters, labelled, whose
from engine.surface.observations import observe
from engine.surface.pixels import SurfaceParams, coarse_regions, rerender, solve_pixels
from engine.surface.relight import Gains, refine
from engine.surface.start import global_start
from engine.surface.transport import Incident, Lattice, Responses, Sight, direction_cells, lattice_around
from engine.types import Frames, Gaussians, Masks, Poses, Renders, Surface

DEPTH_MARGIN = 0.2
"""Half of the depth range the probes cover, relative to the object's distance."""
DISTANCE_PIXELS = 240
DISTANCE_VIEWS = 24
RELIGHT_PIXELS = 600
RELIGHT_VIEWS = 48
RELIGHT_ROUNDS = 4
DISTANCES = 7
NEAREST, FARTHEST = 0.05, 0.8


@dataclass(frozen=True, slots=True)
class SurfaceReport:
    """Facts of one solve, fit for JSON."""

    pixels: int
    fitted_views: int
    held_out_views: tuple[int, ...]
    held_out_error: float  # median relative error of the re-rendered radiance
    residual: float  # median weighted residual spread
    distance: Distance
    light_gains: tuple[tuple[float, ...], ...]  # per group of emitters; empty without refinement
    residual_before_relight: float  # median weighted residual spread of the sample; NaN without refinement
    stderr_normal_deg: float  # median
    flagged: dict[str, int]


def held_out(registered: Bool[np.ndarray, " n"], count: int) -> tuple[Int[np.ndarray, " f"], tuple[int, ...]]:
    """(fitted, held out) view indices: the held-out ones evenly spread over the registered."""
    usable = np.nonzero(registered)[0]
    if len(usable) < 8:
        raise SurfaceError(
            f"only {len(usable)} views have a pose and light; at least 8 are needed, add photographs"
        )
    count = min(count, max(0, len(usable) - 8))
    out = usable[np.linspace(0, len(usable) - 1, count + 2).astype(int)[1:-1]]
    return np.setdiff1d(usable, out), tuple(int(i) for i in out)


def gather_light(
    gaussians: Gaussians,
    poses: Poses,
    views: Int[np.ndarray, " n"],
    mask: Bool[np.ndarray, "h w"],
    distance: float,
    params: SurfaceParams,
    progress: Progress,
) -> Incident:
    """The energy at a lattice of probes around the object, for some views."""
    depths = (distance * (1 - DEPTH_MARGIN), distance * (1 + DEPTH_MARGIN))
    shape = (params.probes_across, params.probes_across, params.probes_deep)
    lattice = lattice_around(poses.camera, mask, depths, shape)
    return light_at(lattice, gaussians, poses, views, params.directions, params.probe_face_px, progress)


def light_at(
    lattice: Lattice,
    gaussians: Gaussians,
    poses: Poses,
    views: Int[np.ndarray, " n"],
    directions: int,
    face_px: int,
    progress: Progress,
    fill: bool = True,
) -> Incident:
    """The energy at the lattice for some views; with `fill`, unseen directions are filled."""
    cells = direction_cells(directions)
    energy, _ = incident_energy(
        gaussians, poses.cam_from_world[views], lattice.points(), cells, face_px, fill, progress
    )
    n, m, d, _ = energy.shape
    flat = np.ascontiguousarray(energy.transpose(1, 2, 0, 3).reshape(m, d, 3 * n), dtype=np.float32)
    return Incident(lattice, cells, flat)


def sample_pixels(mask: Bool[np.ndarray, "h w"], count: int, seed: int) -> Bool[np.ndarray, "h w"]:
    """A random part of the mask, away from its rim where there is enough of it."""
    inner = np.nonzero(np.asarray(binary_erosion(mask, np.ones((5, 5), bool))).ravel())[0]
    if len(inner) < 50:
        inner = np.nonzero(mask.ravel())[0]
    chosen = np.random.default_rng(seed).choice(inner, min(count, len(inner)), replace=False)
    subset = np.zeros(mask.size, bool)
    subset[chosen] = True
    return subset.reshape(mask.shape)


def refine_light(
    frames: Frames,
    masks: Masks,
    poses: Poses,
    gaussians: Gaussians,
    views: Int[np.ndarray, " n"],
    distance: float,
    params: SurfaceParams,
    seed: int,
    progress: Progress,
) -> tuple[Gaussians, Gains]:
    """The light with a gain for every group of emitters, as a sample of the object's pixels asks for."""
    few = views[:: max(1, len(views) // RELIGHT_VIEWS)]
    middle = transform(inverse(poses.cam_from_world[few]).mean(0), np.array([0.0, 0.0, distance]))
    group = group_emitters(gaussians, middle, params.relight_groups, seed)
    count = int(group.max()) + 1
    lattice = lattice_around(poses.camera, masks.object, (distance, distance), (2, 2, 1))

    def look(which: Gaussians, fill: bool, first: float) -> Incident:
        span = progress.part(first, first + 0.15)
        return light_at(lattice, which, poses, few, 1024, 32, span, fill)

    total, bare = look(gaussians, True, 0.0), look(gaussians, False, 0.15)
    places, low = labelled(gaussians)
    came_from = whose(look(places, False, 0.3), bare, low, gaussians, group)
    # What no photograph shows was filled in from its surroundings; it keeps its level here.
    filled = Incident(lattice, total.directions, np.maximum(total.energy - bare.energy, 0))
    lights = [bare.where(came_from == k) for k in range(count)]
    lights.append(filled)
    subset = sample_pixels(masks.object, RELIGHT_PIXELS, seed)
    directions = rays(poses.camera)[subset]
    sight = Sight(directions / directions[:, 2:] * distance, -directions, None)
    seen = observe(frames, subset, few, params.model_error)
    parts = coarse_regions(subset)
    responses = Responses(total, seen.radiance, params.full_diffuse, False, "cpu")
    span = progress.part(0.45, 1.0)
    start = global_start(responses, sight, seen, parts, params.candidates, span.part(0, 0.2))
    prior = np.append(np.full(count, params.relight_prior), 1e-3)
    gains, _ = refine(
        lights, prior, newton.begin(*start), sight, parts, seen, params.full_diffuse,
        RELIGHT_ROUNDS, 3, span.part(0.2, 1.0),
    )  # fmt: skip
    return brightened(gaussians, group, gains.gain[:-1]), gains


def estimate_distance(
    frames: Frames,
    masks: Masks,
    poses: Poses,
    gaussians: Gaussians,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
    seed: int,
    progress: Progress,
) -> Distance:
    """Ask the light how far the object is, with a few hundred pixels in a few dozen views.

    The search runs from NEAREST to FARTHEST of the median distance from the cameras to the room's Gaussians.
    """
    few = views[:: max(1, len(views) // DISTANCE_VIEWS)]
    subset = sample_pixels(masks.object, DISTANCE_PIXELS, seed)
    centres = inverse(poses.cam_from_world[views])[..., 3]
    room = float(np.median(np.linalg.norm(gaussians.means[None] - centres[:, None], axis=2)))

    def light_between(first: float, last: float, fine: bool, span: Progress) -> Incident:
        shape = (2, 2, 3) if fine else (1, 1, DISTANCES)
        lattice = lattice_around(poses.camera, masks.object, (first, last), shape)
        return light_at(lattice, gaussians, poses, few, 1024, 24, span)

    return find_distance(
        light_between,
        observe(frames, subset, few, params.model_error),
        rays(poses.camera)[subset],
        coarse_regions(subset),
        params.full_diffuse,
        (NEAREST * room, FARTHEST * room),
        progress,
    )


def solve(
    frames: Frames,
    masks: Masks,
    poses: Poses,
    gaussians: Gaussians,
    params: SurfaceParams,
    device: str,
    seed: int,
    progress: Progress,
) -> tuple[Surface, Renders, SurfaceReport]:
    """Solve the surface; `seed` picks the pixels that vote on the distance.

    Raises:
        SurfaceError: too few views, an empty mask, or frames without usable object pixels.
    """
    fitted, kept_out = held_out(poses.registered, params.held_out)
    everything = np.concatenate([fitted, np.array(kept_out, int)])
    if params.object_distance > 0:
        distance = Distance(params.object_distance, 0.0, "given")
    else:
        distance = estimate_distance(
            frames, masks, poses, gaussians, fitted, params, seed, progress.part(0, 0.15)
        )
    gains = None
    if params.relight:
        gaussians, gains = refine_light(
            frames, masks, poses, gaussians, fitted, distance.value, params, seed, progress.part(0.15, 0.3)
        )
    light = gather_light(
        gaussians, poses, everything, masks.object, distance.value, params, progress.part(0.3, 0.45)
    )
    here = light.views(np.arange(len(fitted)))
    surface, sight, certainty, state = solve_pixels(
        frames,
        masks.object,
        poses.camera,
        here,
        fitted,
        distance.value,
        params,
        device,
        progress.part(0.45, 0.98),
    )
    there = light.views(np.arange(len(fitted), len(everything)))
    renders = rerender(frames, masks.object, there, kept_out, surface, sight, params, device)
    truth = frames.radiance[list(kept_out)][:, masks.object]
    answer = renders.radiance[:, masks.object]
    error = np.abs(answer - truth) / np.maximum(truth, 0.02 * np.median(truth)) if kept_out else np.zeros(1)
    report = SurfaceReport(
        int(masks.object.sum()),
        len(fitted),
        kept_out,
        float(np.median(error)),
        float(np.median(state.spread)),
        distance,
        tuple(tuple(map(float, g)) for g in gains.gain) if gains else (),
        gains.before if gains else float("nan"),
        float(np.degrees(np.median(certainty.normal))),
        {
            name: int((certainty.flags & bit > 0).sum())
            for name, bit in (("grazing", 1), ("shadowed", 2), ("saturated", 4), ("ill_conditioned", 8))
        },
    )
    return surface, renders, report
