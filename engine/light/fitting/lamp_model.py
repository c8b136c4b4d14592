"""The lamps that were found, as emitters of their own: measured, kept out of the fit, put back as they are.

A lamp of a few pixels, fifty times brighter than its wall, is what a fit of many Gaussians does worst: it is
spread over whatever stands near its rays and dims or doubles from place to place. Here each lamp's power is
counted in the photographs that show it whole, its pixels are cut out before the fit, and one dense round
Gaussian of its size stands in its place afterwards. What the fit left in front of it is cleared away: the
views that show the lamp look through there. World frame, scene units.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from engine.geometry import sphere_solid_angle
from engine.light.fitting.lamp_detection import LampDetections
from engine.light.fitting.training_views import Photographs, camera_centres, window_around
from engine.light.gaussians.gaussians import isotropic_gaussians, joined, part, rotations
from engine.types import Gaussians, Lamps

GLOW = 1.3
"""A lamp's light lies within so many of its radii, and SOFT pixels: optics and demosaicing blur its rim."""
SOFT = 1.5
WHOLE = 0.95
"""Share of that disc which must be seen for a view to say how bright the lamp is."""
CLIPPED = 0.02
"""Share of it that may be clipped."""
DENSITY = 20.0
HAZE = (0.2, 0.6)
"""A lamp is hidden where less of a ray gets through, and unhidden where more does: the fit leaves some haze."""
IN_FRONT = 0.02
"""Opacity from which on a Gaussian between a lamp and a view that shows it has no business there."""


def _discs(photographs: Photographs, centre, radius):
    """Where a sphere is seen: view, its middle (u, v), radius in pixels, distance, off-axis cosine."""
    _, height, width = photographs.weight.shape
    focal = photographs.lens[:2].mean()
    for view, ((u, v), cam) in enumerate(zip(*photographs.image_of(centre), strict=True)):
        if cam[2] <= radius:
            continue
        distance = float(np.linalg.norm(cam))
        cosine = float(cam[2] / distance)
        size = radius * focal / cam[2] / cosine  # off axis a sphere's image is this long at most
        if -size < u < width + size and -size < v < height + size:
            yield view, u, v, size, distance, cosine


def measure_lamps(sightings: LampDetections, photographs: Photographs) -> tuple[LampDetections, Lamps]:
    """Each lamp's mean radiance: its power above what surrounds it, over its own solid angle.

    The median of the views that show it whole and unclipped; of a lamp that is nowhere whole its middle alone; of
    one that is always clipped the brightest, a lower bound. What no view shows a pixel of is no lamp.
    """
    _, height, width = photographs.weight.shape
    focal = photographs.lens[:2].mean()
    radiances, clipped, kept = [], [], []
    for lamp, (centre, radius, shown) in enumerate(
        zip(sightings.centres, sightings.radii, sightings.shown, strict=True)
    ):
        whole, middle = ([], []), ([], [])  # unclipped views, clipped ones
        for view, u, v, size, distance, cosine in _discs(photographs, centre, radius):
            if not shown[view]:
                continue
            reach = GLOW * size + SOFT
            rows, columns, away = window_around(height, width, u, v, reach + 3)
            known = photographs.weight[view, rows, columns] > 0
            picture = photographs.radiance[view, rows, columns]
            disc, ring = away < reach, (away >= reach) & known
            inner = (away < max(0.7 * size, 0.7)) & known
            cut = photographs.clipped[view, rows, columns] & known
            if inner.any():
                middle[bool(cut[inner].any())].append(picture[inner].mean(0))
            if (disc & known).sum() < WHOLE * np.pi * reach**2 or not ring.any():
                continue
            behind = np.median(picture[ring], axis=0)
            pixel = cosine**3 / focal**2  # its solid angle
            power = ((picture - behind) * (disc & known)[..., None]).sum((0, 1)) * pixel
            solid = sphere_solid_angle(radius, distance)
            whole[bool((cut & disc).sum() > CLIPPED * disc.sum())].append(power / solid + behind)
        counted = whole if any(whole) else middle
        if not any(counted):
            continue
        sure, bounds = counted
        radiances.append(np.median(sure, axis=0) if sure else np.max(bounds, axis=0))
        clipped.append(not sure)
        kept.append(lamp)
    kept = np.array(kept, int)
    seen = LampDetections(sightings.centres[kept], sightings.radii[kept], sightings.shown[kept])
    radiance = np.maximum(np.array(radiances).reshape(-1, 3), 0)
    return seen, Lamps(seen.centres, seen.radii, radiance, np.array(clipped, bool))


def mask_lamps(photographs: Photographs, lamps: Lamps) -> Photographs:
    """The photographs with every lamp cut out of every view that might show it."""
    weight = photographs.weight.copy()
    _, height, width = weight.shape
    for centre, radius in zip(lamps.centres, lamps.radii, strict=True):
        for view, u, v, size, *_ in _discs(photographs, centre, radius):
            reach = GLOW * size + SOFT
            rows, columns, away = window_around(height, width, u, v, reach)
            weight[view, rows, columns][away < reach] = 0
    return replace(photographs, weight=weight)


def insert_lamps(
    gaussians: Gaussians, lamps: Lamps, sightings: LampDetections, photographs: Photographs
) -> Gaussians:
    """The fitted room with the lamps as its last Gaussians, and nothing between them and the views that show them."""
    blocks = np.zeros(len(gaussians.means), bool)
    eyes = camera_centres(photographs)
    for centre, radius, shown in zip(lamps.centres, lamps.radii, sightings.shown, strict=True):
        for eye in eyes[shown]:
            opacity, at, distance = _on_the_way(gaussians, eye, centre)
            blocks |= (at < distance - 2 * radius) & (opacity > IN_FRONT)
    return with_lamps(part(gaussians, ~blocks), lamps)


def with_lamps(gaussians: Gaussians, lamps: Lamps) -> Gaussians:
    """The room with the lamps as its last Gaussians."""
    scale = np.repeat(lamps.radii[:, None], 3, 1) / np.sqrt(_covered(DENSITY))
    upright = np.tile([1.0, 0, 0, 0], (len(scale), 1))
    fresh = isotropic_gaussians(
        lamps.centres, upright, scale, DENSITY, lamps.radiance, gaussians.radiance.shape[1]
    )
    return joined(gaussians, fresh)


def without_lamps(gaussians: Gaussians, lamps: Lamps) -> Gaussians:
    """The room without the lamps, which are its last Gaussians; undoes `beside`."""
    return part(gaussians, slice(len(gaussians.means) - len(lamps.radii)))


def lamp_transmittance(
    lamps: Lamps,
    gaussians: Gaussians,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    middle: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, "n l"]:
    """The share of each lamp's light that gets to a point of the camera frame in every view.

    `gaussians` is the room without the lamps: what is solid in front hides a lamp, haze does not.
    """
    through = np.zeros((len(cam_from_world), len(lamps.radii)))
    for view, pose in enumerate(cam_from_world):
        eye = (middle - pose[:, 3]) @ pose[:, :3]
        for i, (centre, radius) in enumerate(zip(lamps.centres, lamps.radii, strict=True)):
            opacity, at, far = _on_the_way(gaussians, eye, centre)
            share = float(np.prod(1 - opacity[at < far - 2 * radius]))
            through[view, i] = min(max((share - HAZE[0]) / (HAZE[1] - HAZE[0]), 0.0), 1.0)
    return through


def _covered(density: float) -> float:
    """What the kernels' profile (1 - q/8)^8 covers of the plane, in units of pi scale^2."""
    q = (np.arange(4000) + 0.5) / 500
    return float((-np.expm1(-density * (1 - q / 8) ** 8)).sum() / 500)


def _on_the_way(
    gaussians: Gaussians, eye: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Opacity of every Gaussian on the ray from an eye to a point, how far along it stands, and the point's distance."""
    ray = point - eye
    distance = float(np.linalg.norm(ray))
    ray = ray / distance
    away = gaussians.means - eye
    at = away @ ray
    # Only those that may reach the ray are worth the exact answer.
    off = (away**2).sum(1) - at**2
    near = np.nonzero((at > 0) & (at < distance) & (off < 8 * gaussians.scales.max(1) ** 2))[0]
    turn = np.swapaxes(rotations(gaussians.quaternions[near].astype(np.float64)), 1, 2)
    whiten = turn / gaussians.scales[near][..., None]
    start = np.einsum("kij,kj->ki", whiten, -away[near])
    along = whiten @ ray
    at[near] = -(start * along).sum(1) / (along**2).sum(1)
    q = ((start + along * at[near][:, None]) ** 2).sum(1)
    opacity = np.zeros(len(at))
    opacity[near] = -np.expm1(-gaussians.density[near] * np.maximum(1 - q / 8, 0) ** 8)
    return np.where(at > 0, opacity, 0), at, distance
