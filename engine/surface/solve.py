"""Stage *surface*: from photographs and the room's light to normals, albedo, roughness, depth, with errors.

The order of work: the light at a lattice of probes around the object (near field), a global search that needs
no start, damped Gauss-Newton on every pixel, depth by integrating the normals, and again with the points,
visibility and inter-reflection that the depth gives. Some views are kept out of the fit and re-rendered.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int
from scipy.ndimage import binary_erosion

from engine.errors import SurfaceError
from engine.geometry import inverse, rays
from engine.light.probes import incident_energy
from engine.progress import Progress
from engine.surface.distance import Distance, find_distance
from engine.surface.observations import observe
from engine.surface.pixels import SurfaceParams, coarse_regions, rerender, solve_pixels
from engine.surface.transport import Incident, direction_cells, lattice_around
from engine.types import Frames, Gaussians, Masks, Poses, Renders, Surface

DEPTH_MARGIN = 0.2
"""Half of the depth range the probes cover, relative to the object's distance."""
DISTANCE_PIXELS = 400
DISTANCES = 8


@dataclass(frozen=True, slots=True)
class SurfaceReport:
    """Facts of one solve, fit for JSON."""

    pixels: int
    fitted_views: int
    held_out_views: tuple[int, ...]
    held_out_error: float  # median relative error of the re-rendered radiance
    residual: float  # median weighted residual spread
    distance: Distance
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
    """The energy at the probe lattice for some views, unseen directions filled."""
    depths = (distance * (1 - DEPTH_MARGIN), distance * (1 + DEPTH_MARGIN))
    shape = (params.probes_across, params.probes_across, params.probes_deep)
    lattice = lattice_around(poses.camera, mask, depths, shape)
    directions = direction_cells(params.directions)
    energy, _ = incident_energy(
        gaussians,
        poses.cam_from_world[views],
        lattice.points(),
        directions,
        params.probe_face_px,
        True,
        progress,
    )
    n, m, d, _ = energy.shape
    flat = np.ascontiguousarray(energy.transpose(1, 2, 0, 3).reshape(m, d, 3 * n), dtype=np.float32)
    return Incident(lattice, directions, flat)


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
    """Ask the light how far the object is, with a few hundred pixels in at most 40 views.

    The search runs from a fiftieth of the room to the nearest tenth of what the cameras saw of it: the
    object is in front of the background.
    """
    few = views[:: max(1, len(views) // 40)]
    generator = np.random.default_rng(seed)
    inner = np.nonzero(binary_erosion(masks.object, np.ones((5, 5), bool)).ravel())[0]
    if len(inner) < 50:
        inner = np.nonzero(masks.object.ravel())[0]
    chosen = generator.choice(inner, min(DISTANCE_PIXELS, len(inner)), replace=False)
    subset = np.zeros(masks.object.size, bool)
    subset[chosen] = True
    subset = subset.reshape(masks.object.shape)
    centres = inverse(poses.cam_from_world[views])[..., 3]
    far = np.linalg.norm(gaussians.means[None] - centres[:, None], axis=2)
    coarse = replace(params, directions=1024, probes_across=2, probes_deep=1, probe_face_px=24)

    def light_at(z: float, span: Progress) -> Incident:
        return gather_light(gaussians, poses, few, masks.object, z, coarse, span)

    return find_distance(
        light_at,
        observe(frames, subset, few, params.model_error),
        rays(poses.camera)[subset],
        coarse_regions(subset),
        params.full_diffuse,
        (float(np.median(far)) / 50, float(np.percentile(far.min(0), 10))),
        DISTANCES,
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
    light = gather_light(
        gaussians, poses, everything, masks.object, distance.value, params, progress.part(0.15, 0.35)
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
        progress.part(0.35, 0.95),
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
        float(np.degrees(np.median(certainty.normal))),
        {
            name: int((certainty.flags & bit > 0).sum())
            for name, bit in (("grazing", 1), ("shadowed", 2), ("saturated", 4), ("ill_conditioned", 8))
        },
    )
    return surface, renders, report
