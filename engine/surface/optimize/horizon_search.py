"""What hides the room from a pixel, when its photographs know better than the depth.

Normals do not say how high a step is, and what a step hides is then unknown too: pixels at its foot, believed
to see the whole room, lean away from it instead. But they also photographed the shadow. Seen from the
camera the surface is a height field, so that a hidden direction hides all those farther from the viewing ray at
the same azimuth: what a point sees is bounded by a horizon, one angle for each sector of azimuth. Each
sector keeps what the depth says unless another horizon explains the pixel's photographs markedly better.

A level of 0 stands for "as the depth has it"; level l >= 1 hides the rings l and beyond. Camera frame.
"""

from dataclasses import replace
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.surface.data.observations import Observations, aside
from engine.surface.optimize.gauss_newton import ALBEDO
from engine.surface.reflectance.brdf import of_pixels, rows
from engine.surface.rendering.transport import Responses, Sight
from engine.surface.visibility.ray_visibility import SECTORS, Occlusion

RINGS = np.radians([28.0, 40.0, 50.0, 60.0, 68.0, 76.0, 84.0, 92.0, 102.0, 115.0])
"""Angles from the viewing ray between the rings; finer where horizons usually are."""
LEVELS = len(RINGS) + 2
PRICE = 12.0
"""Fall of the misfit that a sector must buy to depart from the depth, in squared residual spreads: the pixel's own or
the object's median, whichever is less. The best of all sectors and levels brings about 2 ln(12 x 11) = 10 by
chance. On a relief under lamps the horizons bought at 30, at 8 and at 3 were equally right (4.5 degrees off in the
median), but at 30 only a third as many were, and normals stood at 6.6 degrees instead of 5.9."""
SWEEPS = 2
BESIDE = 4
"""Pixels to the side, at most, whose photographs stand for what an overruled horizon puts in the way, in the directions that
they look towards; in others nothing is known. A pixel whose neighbours lean as it does would explain its photographs
by theirs, whatever its normal is."""


def compass(
    directions: Float[np.ndarray, "d 3"], view: Float[np.ndarray, " 3"]
) -> tuple[Int[np.ndarray, " d"], Int[np.ndarray, " d"]]:
    """Sector and ring of every direction around a unit vector that points to the camera."""
    right = np.cross([0.0, 1.0, 0.0], -view)
    right /= np.linalg.norm(right)
    down = np.cross(-view, right)
    turn = np.arctan2(directions @ down, directions @ right) / (2 * np.pi) + 0.5
    sector = np.minimum((turn * SECTORS).astype(np.int32), SECTORS - 1)
    ring = np.searchsorted(RINGS, np.arccos(np.clip(directions @ view, -1, 1)))
    return sector, ring.astype(np.int32)


def ways() -> Float[np.ndarray, "s 2"]:
    """(row, column) of a pixel's step along the middle of every sector."""
    turn = 2 * np.pi * ((np.arange(SECTORS) + 0.5) / SECTORS - 0.5)
    return np.stack([np.sin(turn), np.cos(turn)], 1)


def beside(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "p s"]:
    """For every pixel and sector the pixel (in mask order) a little that way, itself at the object's edge."""
    found = np.repeat(np.arange(mask.sum())[:, None], SECTORS, 1)
    for reach in range(1, BESIDE + 1):
        steps = np.round(reach * ways()).astype(int)
        other = aside(mask, steps)
        found = np.where(other >= 0, other, found)
    return found


def overruled(
    sight: Sight,
    level: Int[np.ndarray, "p s"],
    normals: Float[np.ndarray, "p 3"],
    parts: list[Int[np.ndarray, " _"]],
    directions: Float[np.ndarray, "d 3"],
    beside: Int[np.ndarray, "p s"],
) -> Sight:
    """The sight with every sector's level in force; `beside` from the function."""
    known = sight.occlusion
    if known is None or not level.any():
        return sight
    sectors, rings = (np.empty((len(parts), len(directions)), np.int32) for _ in range(2))
    owner = np.empty(len(level), np.int64)
    for i, pixels in enumerate(parts):
        sectors[i], rings[i] = compass(directions, sight.middle(pixels))
        owner[pixels] = i
    counts = np.zeros(len(level), np.int64)
    nothing = np.zeros(0, np.int32)
    share = np.zeros(len(level), np.float32)
    tables = (
        known.start, known.direction, known.source, level, owner, sectors, rings, beside,
        normals.astype(np.float32), directions.astype(np.float32),
    )  # fmt: skip
    _merge(*tables, counts, nothing, nothing, share, False)
    start = np.concatenate([[0], np.cumsum(counts)])
    direction, source = np.empty(start[-1], np.int32), np.empty(start[-1], np.int32)
    _merge(*tables, start[:-1], direction, source, share, True)
    return replace(sight, occlusion=Occlusion(start, direction, source, share, known.walls))


def by_channel(x: Float[np.ndarray, "k v"]) -> Float[np.ndarray, "k v"]:
    """View-major to channel-major: what one channel saw lies side by side."""
    return np.ascontiguousarray(x.reshape(len(x), x.shape[1] // 3, 3).transpose(0, 2, 1).reshape(x.shape))


@numba.njit(parallel=True, cache=True)
@no_type_check
def _merge(
    start, direction, source, level, owner, sectors, rings, beside, normals, directions, at, out_d, out_s, share,
    fill,
):  # fmt: skip
    """Count (in `at`) or write (from `at` on) every pixel's hidden directions."""
    count = sectors.shape[1]
    for p in numba.prange(level.shape[0]):
        behind = np.full(count, -2, np.int32)
        for k in range(start[p], start[p + 1]):
            behind[direction[k]] = source[k]
        sector, ring = sectors[owner[p]], rings[owner[p]]
        n, lost, whole = 0, np.float32(0), np.float32(0)
        for d in range(count):
            own = level[p, sector[d]]
            hides = behind[d] != -2 if own == 0 else ring[d] >= own
            cosine = np.float32(0)
            for axis in range(3):
                cosine += normals[p, axis] * directions[d, axis]
            cosine = max(cosine, np.float32(0))
            whole += cosine
            if not hides:
                continue
            lost += cosine
            if fill:
                out_d[at[p] + n] = d
                out_s[at[p] + n] = behind[d]
                if behind[d] == -2:
                    other, facing = beside[p, sector[d]], np.float32(0)
                    for axis in range(3):
                        facing -= normals[other, axis] * directions[d, axis]
                    out_s[at[p] + n] = other if facing > 0 else -1
            n += 1
        share[p] = lost / max(whole, np.float32(1e-9))
        if not fill:
            at[p] = n


def explain(
    responses: Responses,
    sight: Sight,
    pixels: Int[np.ndarray, " p"],
    normals: Float[np.ndarray, "p 3"],
    roughness: Float[np.ndarray, " p"],
    level: Int[np.ndarray, "p s"],
    energy: Float[np.ndarray, "d v"],
    around: tuple[Int[np.ndarray, " d"], Int[np.ndarray, " d"]],
    seen: Observations,
    spread: Float[np.ndarray, " p"],
    gloss: Float[np.ndarray, "p 2"],
    usual: float,
    beside: Int[np.ndarray, "every s"],
    facing: Float[np.ndarray, "every 3"],
    sweeps: int = SWEEPS,
    prices: Float[np.ndarray, "p s l"] | None = None,
) -> tuple[Int[np.ndarray, "p s"], Float[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """The levels that explain the photographs of a block's pixels best, their misfit, and albedo.

    Coordinate descent from the given levels, sector by sector; albedo is solved for every trial. `sight` is that
    of the depth; `energy` and `around` (the compass) belong to the block, `seen`, `spread` and `gloss` to the given pixels;
    `usual` is the object's median spread; `facing` are the normals (float32) of those that stand `beside`; all light and
    photographs are `by_channel`. Misfits compare between normals, roughnesses and levels of one pixel. `prices` (float32), if
    given, takes what each level of each sector would add to the misfit, all others as they are found to be, in the spreads of
    `PRICE`.
    """
    directions, (sector, ring) = responses.incident.directions, around
    everything = np.ones((len(pixels), len(directions)), np.uint8)
    diffuse, specular = rows(
        normals,
        roughness,
        sight.views[pixels],
        directions,
        everything,
        responses.full_diffuse,
        responses.floor,
        of_pixels(sight.material, pixels),
    )
    hidden = sight.occlusion
    if hidden is None:
        start, direction, source = np.zeros(len(pixels) + 1, np.int64), *np.zeros((2, 0), np.int32)
    else:
        start, direction, source = hidden.of(pixels)
    if prices is None:
        prices = np.empty((0, SECTORS, LEVELS), np.float32)
    away = ((roughness - gloss[:, 0]) / gloss[:, 1]) ** 2
    answer = level.copy(), np.empty(len(level)), np.empty((len(level), 3))
    _descend(
        diffuse, specular, np.argsort(sector * LEVELS + ring, kind="stable"), sector, ring,
        directions.astype(np.float32), energy, responses.cell, start, direction, source, beside[pixels],
        facing, responses.photographed,
        responses.walls, responses.bounce, seen.radiance, seen.weight, seen.eps, np.float32(seen.cauchy**2),
        spread.astype(np.float32) ** 2, np.float32(PRICE * usual**2), away.astype(np.float32), sweeps, *answer,
        prices,
    )  # fmt: skip
    return answer


@numba.njit(inline="always", fastmath=True, error_model="numpy")
@no_type_check
def _misfit(sent, radiance, weight, eps, wide, square, albedo, limit):
    """Robust misfit of one pixel at the albedo that suits it best, which is left in `albedo`; given up above `limit`.

    Ranks what Gauss-Newton will fit: its log residual as a relative difference, its Cauchy weight as Geman and
    McClure's, since neither needs a logarithm.
    """
    width = wide * square
    per = np.float32(1) / width
    count = radiance.shape[0] // 3
    low, high = np.float32(ALBEDO[0]), np.float32(ALBEDO[1])
    total = np.float32(0)
    for c in range(3):
        d, s = sent[0, c * count : (c + 1) * count], sent[1, c * count : (c + 1) * count]
        seen, trust = radiance[c * count : (c + 1) * count], weight[c * count : (c + 1) * count]
        up, down = np.float32(0), np.float32(1e-30)
        for v in range(count):
            w = trust[v] * d[v] / ((seen[v] + eps) * (seen[v] + eps))
            up += w * (seen[v] - s[v])
            down += w * d[v]
        a = min(max(up / down, low), high)
        for turn in range(3):
            up, down, cost = np.float32(0), np.float32(1e-30), np.float32(0)
            for v in range(count):
                model = max(a * d[v] + s[v], np.float32(0)) + eps
                e = np.float32(2) * (seen[v] + eps - model) / (seen[v] + eps + model)
                ratio = trust[v] * e * e * per
                share = np.float32(1) / (np.float32(1) + ratio)
                cost += ratio * share
                j = a * d[v] / model
                up += trust[v] * share * share * j * e
                down += trust[v] * share * share * j * j
            if turn < 2:
                step = min(max(up / down, np.float32(-0.5)), np.float32(0.5))
                a = min(max(a * (np.float32(1) + step), low), high)
        total += width * cost
        albedo[c] = a
        if total > limit:
            break
    return total


# Threads from outside, no `parallel`: of a parallel kernel what was just compiled and what is kept of it differ in
# the last bits, for they are optimised in different company.
@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _descend(
    diffuse, specular, order, sector, ring, towards, energy, cell, start, direction, source, beside, facing, photographed,
    walls, bounce, radiance, weight, eps, wide, squares, dearest, away, sweeps, found, misfits, albedos, prices,
):  # fmt: skip
    """Every pixel begins at what `found` holds of it."""
    count, across, size = diffuse.shape[0], energy.shape[0], energy.shape[1]
    rings, known_pixels = LEVELS - 1, len(photographed)
    for p in range(count):
        # What each ring of each sector sends, what each sector sends as the depth has it, and how much of
        # what stands in the way each ring would show.
        room = np.zeros((SECTORS, rings, 2, size), np.float32)
        sends = np.zeros((SECTORS, LEVELS, 2, size), np.float32)
        wall = np.zeros((SECTORS, rings, 2), np.float32)
        behind = np.full(across, -2, np.int32)
        for k in range(start[p], start[p + 1]):
            behind[direction[k]] = source[k]
        for i in range(across):
            d = order[i]
            a, b = diffuse[p, d], specular[p, d]
            if a <= 0:
                continue
            s, r = sector[d], ring[d]
            other, seen = beside[p, s], np.float32(0)
            for axis in range(3):
                seen -= facing[other, axis] * towards[d, axis]
            if seen > 0:
                wall[s, r, 0] += a * cell
                wall[s, r, 1] += b * cell
            into = room[s, r]
            for v in range(size):
                into[0, v] += a * energy[d, v]
                into[1, v] += b * energy[d, v]
            q = behind[d]
            if q == -2:
                continue
            # As the depth has it: the room's light is taken back, the photographed light or a wall's comes instead.
            own = sends[s, 0]
            thrown = walls[q - known_pixels] if q >= known_pixels and bounce else photographed[max(q, 0)]
            for v in range(size):
                light = -energy[d, v]
                if q >= 0 and bounce:
                    light += cell * thrown[v]
                own[0, v] += a * light
                own[1, v] += b * light
        for s in range(SECTORS):
            before = photographed[beside[p, s]]
            for l in range(1, LEVELS):
                for v in range(size):
                    for k in range(2):
                        nearer = sends[s, l - 1, k, v] if l > 1 else np.float32(0)
                        sends[s, l, k, v] = nearer + room[s, l - 1, k, v]
            for v in range(size):
                sends[s, 0, 0, v] += sends[s, LEVELS - 1, 0, v]
                sends[s, 0, 1, v] += sends[s, LEVELS - 1, 1, v]
            if not bounce:
                continue
            lost_a, lost_b = np.float32(0), np.float32(0)
            for l in range(LEVELS - 2, 0, -1):
                lost_a += wall[s, l, 0]
                lost_b += wall[s, l, 1]
                for v in range(size):
                    sends[s, l, 0, v] += lost_a * before[v]
                    sends[s, l, 1, v] += lost_b * before[v]
        own = found[p]
        total = np.zeros((2, size), np.float32)
        departures = 0
        for s in range(SECTORS):
            departures += own[s] != 0
            for v in range(size):
                total[0, v] += sends[s, own[s], 0, v]
                total[1, v] += sends[s, own[s], 1, v]
        trial, a, square = np.empty((2, size), np.float32), np.empty(3, np.float32), squares[p]
        price = min(np.float32(PRICE) * square, dearest)
        best = _misfit(total, radiance[p], weight[p], eps[p], wide, square, a, np.float32(np.inf))
        best += away[p] * square + price * departures
        albedos[p] = a
        for _ in range(sweeps):
            moved = False
            for s in range(SECTORS):
                here, chosen = own[s], own[s]
                for l in range(LEVELS):
                    if l == here:
                        continue
                    for v in range(size):
                        trial[0, v] = total[0, v] + sends[s, l, 0, v] - sends[s, here, 0, v]
                        trial[1, v] = total[1, v] + sends[s, l, 1, v] - sends[s, here, 1, v]
                    known = away[p] * square + price * (departures - (here != 0) + (l != 0))
                    cost = known + _misfit(
                        trial, radiance[p], weight[p], eps[p], wide, square, a, best - known
                    )
                    if cost < best:
                        best, chosen = cost, l
                        albedos[p] = a
                if chosen != here:
                    for v in range(size):
                        total[0, v] += sends[s, chosen, 0, v] - sends[s, here, 0, v]
                        total[1, v] += sends[s, chosen, 1, v] - sends[s, here, 1, v]
                    departures += (chosen != 0) - (here != 0)
                    own[s] = chosen
                    moved = True
            if not moved:
                break
        misfits[p] = best
        if not len(prices):
            continue
        known = _misfit(total, radiance[p], weight[p], eps[p], wide, square, a, np.float32(np.inf))
        for s in range(SECTORS):
            for l in range(LEVELS):
                for v in range(size):
                    trial[0, v] = total[0, v] + sends[s, l, 0, v] - sends[s, own[s], 0, v]
                    trial[1, v] = total[1, v] + sends[s, l, 1, v] - sends[s, own[s], 1, v]
                cost = _misfit(trial, radiance[p], weight[p], eps[p], wide, square, a, np.float32(np.inf))
                prices[p, s, l] = (cost - known) * np.float32(PRICE) / price
