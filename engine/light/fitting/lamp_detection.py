"""Find the lamps before anything is fitted: small bright spots that several views agree on.

A lamp has no texture, is often clipped, and hangs in front of a wall that it lights: matching patches sees a
bright patch on any wall behind. Its outline is sharp, though: the centres of bright spots are rays that meet in
the lamp. Pairs of rays propose places, and every ray one that is far away; every view votes, the best place takes its spots,
and so on.
World frame; pixels are those of the photographs at hand.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import find_objects, label

from engine.color import luminance
from engine.light.fitting.training_views import Photographs, camera_centres, window_around

BRIGHT = 6.0
"""A spot's luminance, at least, in units of the background's mean."""
LARGEST = 0.2
"""Widest spot, relative to the picture: windows are left to the sweep."""
MOST = 200
"""Spots that are looked into, the widest first: a fairy light hardly moves the sum, and pairs grow fast."""
FEWEST = 8
"""Pixels of outline that say where a circle is."""
APART = 4.0
"""A lamp outshines, so many times at least, nearly all of what is seen right beside it."""
HITS = 2
ASTRAY = 2.0
"""A view votes for a place if a spot's centre lies within so many pixels, and half the spot's radius, of it."""
FAR = 100.0
"""Times the extent of the camera path: where a spot's lamp is proposed if it shows no parallax."""
ALIKE = 1.3
"""Spots of one lamp give radii (scene units) that agree within this factor."""


@dataclass(frozen=True, slots=True, eq=False)
class BrightSpots:
    """Bright round spots of all views."""

    view: Int[np.ndarray, " s"]
    centre: Float[np.ndarray, "s 2"]  # pixels
    radius: Float[np.ndarray, " s"]  # pixels
    ray: Float[np.ndarray, "s 3"]  # world, unit


@dataclass(frozen=True, slots=True, eq=False)
class LampDetections:
    """Places that shine, and which views show them."""

    centres: Float[np.ndarray, "l 3"]  # world
    radii: Float[np.ndarray, " l"]  # scene units
    shown: Bool[np.ndarray, "l n"]


def find_bright_spots(photographs: Photographs) -> BrightSpots:
    """Connected bright pixels with a round outline, as far as it is seen: no windows, no reflections."""
    # View by view: at full size all at once are gigabytes.
    pairs = list(zip(photographs.radiance, photographs.weight, strict=True))
    total, count = np.sum([(luminance(p[w > 0]).sum(dtype=float), (w > 0).sum()) for p, w in pairs], axis=0)
    least = BRIGHT * total / max(count, 1)
    width = photographs.weight.shape[2]
    view, centre, radius, ray = [], [], [], []
    for i, (picture, weight) in enumerate(pairs):
        level, known = luminance(picture), weight > 0
        spots, _ = label(known & ((level > least) | photographs.clipped[i]), np.ones((3, 3)))
        for k, found in enumerate(find_objects(spots), 1):
            # With what it borders on, and no more: a glittering room has thousands.
            rows, columns = (slice(max(side.start - 1, 0), side.stop + 1) for side in found)
            corner = columns.start, rows.start
            circle = _outline(spots[rows, columns] == k, known[rows, columns], corner)
            if circle is None or circle[2] > LARGEST / 2 * width or not _stands_out(circle, level, known):
                continue
            at = circle[:2]
            cam = np.append((at - photographs.lens[2:]) / photographs.lens[:2], 1.0)
            world = cam @ photographs.cam_from_world[i, :, :3]
            view.append(i)
            centre.append(at)
            radius.append(circle[2])
            ray.append(world / np.linalg.norm(world))
    widest = np.sort(np.argsort(-np.array(radius), kind="stable")[:MOST])
    return BrightSpots(
        np.array(view, int)[widest],
        np.array(centre).reshape(-1, 2)[widest],
        np.array(radius)[widest],
        np.array(ray).reshape(-1, 3)[widest],
    )


def _outline(
    spot: Bool[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"], corner: tuple[int, int]
) -> Float[np.ndarray, " 3"] | None:
    """Circle (u, v, radius) around a spot, from where it borders on known darkness; None if it is not round.

    Both are a part of the picture, whose first pixel is its (u, v) = `corner`.
    A stand, a shade or the picture's edge may hide a part of the outline: the worst quarter is dropped.
    """
    dark = known & ~spot
    edge = np.zeros_like(spot)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        beside = np.roll(dark, step, axis)
        np.moveaxis(beside, axis, 0)[0 if step > 0 else -1] = False  # np.roll wraps round
        edge |= spot & beside
    v, u = np.nonzero(edge)
    if len(v) < FEWEST:
        return None
    points = np.stack([u + 0.5, v + 0.5], 1) + corner
    middle = points.mean(0)
    for _ in range(3):
        offset = points - middle
        system = np.column_stack([2 * offset, np.ones(len(points))])
        answer = np.linalg.lstsq(system, (offset**2).sum(1), rcond=None)[0]
        centre, radius = middle + answer[:2], np.sqrt(max(answer[2] + (answer[:2] ** 2).sum(), 0.0))
        miss = np.abs(np.linalg.norm(points - centre, axis=1) - radius)
        points = points[miss <= np.quantile(miss, 0.9)]
    turn = np.sort(np.arctan2(*(points - centre).T))
    widest = np.diff(np.append(turn, turn[0] + 2 * np.pi)).max()
    inside = spot.sum() < 1.3 * np.pi * radius**2
    if np.median(miss) > 0.5 + 0.04 * radius or widest > np.pi or not inside:
        return None
    return np.array([*centre, radius])


def _stands_out(
    circle: Float[np.ndarray, " 3"], level: Float[np.ndarray, "h w"], known: Bool[np.ndarray, "h w"]
) -> bool:
    """Whether what surrounds a circle is dark: a piece of a window or of its reflection has bright neighbours."""
    u, v, radius = circle
    reach = 1.3 * radius + 4.5
    rows, columns, away = window_around(level.shape[0], level.shape[1], u, v, reach)
    level, known = level[rows, columns], known[rows, columns]
    inside = known & (away < max(0.7 * radius, 0.8))
    ring = known & (away > reach - 3) & (away < reach)
    if not (inside.any() and ring.any()):
        return False
    return bool(np.median(level[inside]) > APART * np.quantile(level[ring], 0.9))


def find_lamps(photographs: Photographs) -> LampDetections:
    """The lamps that at least HITS views agree on, those with most votes first."""
    spots = find_bright_spots(photographs)
    eyes = camera_centres(photographs)
    bright = BRIGHT * np.array([float(luminance(picture).mean()) for picture in photographs.radiance])
    free = np.ones(len(spots.view), bool)
    far = FAR * float(np.linalg.norm(np.ptp(eyes, axis=0)))
    proposals = np.concatenate([_crossings(spots, eyes), eyes[spots.view] + far * spots.ray])
    centres, radii, rows = [], [], []
    while len(proposals):
        votes = [_votes(photographs, bright, spots, free, point) for point in proposals]
        score = np.array([(spot >= 0).sum() - missed - apart for spot, _, missed, apart in votes])
        best = int(np.argmax(score))
        spot, radius, *_ = votes[best]
        if score[best] < HITS - 0.5:
            break
        point = _meeting(eyes[spots.view[spot[spot >= 0]]], spots.ray[spot[spot >= 0]])
        again, radius_again, *_ = _votes(photographs, bright, spots, free, point)
        if (again >= 0).sum() >= (spot >= 0).sum():
            spot, radius = again, radius_again
        else:
            point = proposals[best]
        centres.append(point)
        radii.append(radius)
        rows.append(spot >= 0)
        free[spot[spot >= 0]] = False
        keep = score >= HITS - 0.5
        keep[best] = False
        proposals = proposals[keep]
    count = len(photographs.weight)
    return LampDetections(
        np.array(centres).reshape(-1, 3), np.array(radii), np.array(rows, bool).reshape(-1, count)
    )


def _crossings(spots: BrightSpots, eyes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "c 3"]:
    """Where the rays of two views' spots nearly meet, in front of both."""
    a, b = np.triu_indices(len(spots.view), 1)
    other = spots.view[a] != spots.view[b]
    a, b = a[other], b[other]
    p, q, d, e = eyes[spots.view[a]], eyes[spots.view[b]], spots.ray[a], spots.ray[b]
    cosine = (d * e).sum(1)
    apart = np.maximum(1 - cosine**2, 1e-9)
    s = ((q - p) * d).sum(1) - ((q - p) * e).sum(1) * cosine
    t = ((q - p) * d).sum(1) * cosine - ((q - p) * e).sum(1)
    s, t = s / apart, t / apart
    first, second = p + d * s[:, None], q + e * t[:, None]
    gap = np.linalg.norm(first - second, axis=1)
    good = (s > 0) & (t > 0) & (gap < 0.03 * np.minimum(s, t)) & (apart > 0.03**2)
    return ((first + second) / 2)[good]


def _votes(
    photographs: Photographs,
    bright: Float[np.ndarray, " n"],
    spots: BrightSpots,
    free: np.ndarray,
    point: Float[np.ndarray, " 3"],
) -> tuple[Int[np.ndarray, " n"], float, int, float]:
    """Which spot of each view shows a lamp at `point`; its radius; how many views show it dark instead; and
    how far, in the spots' radii, its image lies from the spots' centres on average."""
    count, height, width = photographs.weight.shape
    at, cam = photographs.image_of(point)
    focal = photographs.lens[:2].mean()
    off = np.linalg.norm(spots.centre - at[spots.view], axis=1)  # NaN behind the camera, which compares false
    size = spots.radius * cam[spots.view, 2] / focal
    hit = free & (off < ASTRAY + 0.5 * spots.radius)
    if not hit.any():
        return np.full(count, -1), 0.0, 0, 0.0
    radius = float(np.median(size[hit]))
    hit &= (size < ALIKE * radius) & (size > radius / ALIKE)
    chosen = np.full(count, -1)
    for k in np.nonzero(hit)[0][np.argsort(-off[hit], kind="stable")]:
        chosen[spots.view[k]] = k
    inside = (at[:, 0] > 2) & (at[:, 1] > 2) & (at[:, 0] < width - 2) & (at[:, 1] < height - 2)
    missed = 0
    for i in np.nonzero(inside & (chosen < 0))[0]:
        u, v = at[i].astype(int)
        shines = photographs.clipped[i, v, u] or luminance(photographs.radiance[i, v, u]) > bright[i]
        missed += int(photographs.weight[i, v, u] > 0 and not shines)
    used = chosen[chosen >= 0]
    apart = float((off[used] / (ASTRAY + 0.5 * spots.radius[used])).mean()) if len(used) else 0.0
    return chosen, radius, missed, 0.9 * apart


def _meeting(eyes: Float[np.ndarray, "r 3"], rays: Float[np.ndarray, "r 3"]) -> Float[np.ndarray, " 3"]:
    """The point nearest to all rays."""
    across = np.eye(3) - rays[:, :, None] * rays[:, None]
    return np.linalg.solve(across.sum(0), np.einsum("rij,rj->i", across, eyes))
