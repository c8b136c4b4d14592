"""The object as a field of heights, and the horizons that the heights make.

Heights are logarithms of the range, the distance along the viewing ray, in units of `pitch`: the angle between the rays of
neighbouring pixels. Camera frame.
"""

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.light.gaussians.rasterize import Run
from engine.surface.data.observations import numbered
from engine.surface.optimize.horizon_search import RINGS, SECTORS, ways

HORIZONS = np.concatenate([[0.0], RINGS, [np.radians(130.0)]])
"""Angle from the viewing ray of every level's horizon; level 0 has none of its own, the last stands for an open sky."""
NEAR, GROWTH, FAR = 16, 1.12, 96
"""Pixels along a sector that are looked at: every one to NEAR, then in steps that grow, to FAR."""
ALIKE = np.radians(8.0)
"""A horizon so near to the one preferred costs nothing: rings are as wide."""


class Field:
    """Heights of the object's pixels, parted into regions, and the horizons they make."""

    def __init__(
        self,
        mask: Bool[np.ndarray, "h w"],
        height: Float[np.ndarray, " p"],
        pitch: float,
        of: Int[np.ndarray, " p"],
    ) -> None:
        self.height, self.pitch, self.of = height * pitch, pitch, of
        self.place = np.stack(np.nonzero(mask), 1) + FAR + 1
        self.index = numbered(np.pad(mask, FAR + 1))
        steps = [*range(1, NEAR + 1)]
        while (farther := int(np.ceil(steps[-1] * GROWTH))) <= FAR:
            steps.append(farther)
        self.offsets = np.rint(np.array(steps)[None, :, None] * ways()[:, None]).astype(np.int64)
        # Rounded to whole pixels: what is looked at is nearer or farther than the step.
        angle = np.linalg.norm(self.offsets, axis=2) * pitch
        self.cosine, self.per_sine = np.cos(angle), 1 / np.sin(angle)

    def horizons(
        self,
        lift: Float[np.ndarray, " k"],
        group: list[int],
        shifts: Float[np.ndarray, " t"],
        pixels: Int[np.ndarray, " n"],
        run: Run,
    ) -> Float[np.ndarray, "n s t"]:
        """Angles from the viewing ray beyond which the heights hide the room, pi where nothing does.

        Every region is lifted by its `lift`, those of the group besides by every one of `shifts`.
        """
        found = np.empty((len(pixels), SECTORS, len(shifts)), np.float32)
        member = np.isin(np.arange(len(lift)), group).astype(float)[self.of]
        run(_walk, (
            self.height - lift[self.of] * self.pitch, member, np.asarray(shifts) * self.pitch, self.index,
            self.place[pixels], pixels, self.offsets, self.cosine, self.per_sine, found,
        ))  # fmt: skip
        return found

    def uphill(
        self,
        height: Float[np.ndarray, " p"],
        pixels: Int[np.ndarray, " n"],
        price: Float[np.ndarray, "n s l"],
        run: Run,
    ) -> tuple[float, Float[np.ndarray, " p"]]:
        """What the horizons of some pixels cost where these are the heights, and by how much more for every pixel's height."""
        shape = len(pixels), SECTORS
        steep, hider, per_sine = np.empty(shape), np.empty(shape, np.int64), np.zeros(shape)
        run(_look, (
            height * self.pitch, self.index, self.place[pixels], pixels, self.offsets, self.cosine, self.per_sine,
            steep, hider, per_sine,
        ))  # fmt: skip
        cost, slope = np.empty(len(pixels)), np.zeros(shape)
        run(_slope, (steep, hider, price, HORIZONS, cost, slope))
        slope *= per_sine * self.pitch
        count, seen = len(height), hider >= 0
        pull = np.bincount(pixels, slope.sum(1), count) - np.bincount(hider[seen], slope[seen], count)
        return float(cost.sum()), pull

    def costs(
        self,
        lift: Float[np.ndarray, " k"],
        group: list[int],
        shifts: Float[np.ndarray, " t"],
        pixels: Int[np.ndarray, " n"],
        goal: Float[np.ndarray, "n s"],
        price: Float[np.ndarray, "n s l"],
        run: Run,
    ) -> Float[np.ndarray, "n t"]:
        """What these horizons cost, where `goal` costs nothing and the levels' horizons the `price`."""
        found = np.empty((len(pixels), len(shifts)))
        horizon = self.horizons(lift, group, shifts, pixels, run)
        run(_price, (horizon, goal, price, HORIZONS, found))
        return found


def horizons_of(
    mask: Bool[np.ndarray, "h w"], height: Float[np.ndarray, " p"], pitch: float, run: Run
) -> Float[np.ndarray, "p s"]:
    """Every pixel's horizons as its height field has them."""
    every = np.arange(len(height))
    field = Field(mask, height, pitch, np.zeros(len(height), int))
    return field.horizons(np.zeros(1), [], np.zeros(1), every, run)[..., 0]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _walk(
    height, member, shifts, index, place, pixels, offsets, cosine, per_sine, found, part, parts
):  # fmt: skip
    """Horizons of every `parts`-th pixel: along a ray the cotangent is (range - range' cos) / (range' sin)."""
    count = len(shifts)
    steepest = np.empty(count)
    for i in range(part, len(pixels), parts):
        v, u = place[i]
        own, one = height[pixels[i]], member[pixels[i]]
        for s in range(offsets.shape[0]):
            steepest[:] = -1e30
            for k in range(offsets.shape[1]):
                other = index[v + offsets[s, k, 0], u + offsets[s, k, 1]]
                if other < 0:
                    continue
                # Ranges differ by little: their ratio is one more than the difference of their logarithms.
                steep = (1 + own - height[other] - cosine[s, k]) * per_sine[s, k]
                by = (one - member[other]) * per_sine[s, k]
                for t in range(count):
                    steepest[t] = max(steepest[t], steep - by * shifts[t])
            for t in range(count):
                found[i, s, t] = np.arctan2(1.0, steepest[t]) if steepest[t] > -1e29 else np.pi


# Inlined, as in `horizons`: what a cached kernel calls is not cached with it.
@numba.njit(inline="always", fastmath=True, error_model="numpy")
@no_type_check
def _level(angle, angles):
    """The farthest level whose horizon is no farther than an angle, and which has one beyond it."""
    level = 1
    while level < len(angles) - 2 and angle >= angles[level + 1]:
        level += 1
    return level


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _price(horizon, goal, price, angles, total, part, parts):
    """Sum over the sectors of what each horizon costs, between those of the levels in proportion."""
    last = price.shape[2] - 1
    for i in range(part, len(total), parts):
        total[i] = 0.0
        for s in range(horizon.shape[1]):
            for t in range(horizon.shape[2]):
                angle = horizon[i, s, t]
                if angle >= 3.14159 or abs(angle - goal[i, s]) < ALIKE:
                    continue
                angle = min(max(angle, angles[1]), angles[last])
                level = _level(angle, angles)
                share = (angle - angles[level]) / (angles[level + 1] - angles[level])
                total[i, t] += (1 - share) * price[i, s, level] + share * price[i, s, level + 1]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _look(height, index, place, pixels, offsets, cosine, per_sine, steep, hider, per, part, parts):
    """What bounds the view of every `parts`-th pixel: the cotangent (range - range' cos) / (range' sin), and whose it is."""
    for i in range(part, len(pixels), parts):
        v, u = place[i]
        own = height[pixels[i]]
        for s in range(offsets.shape[0]):
            steepest, who, which = -1e30, -1, 0
            for k in range(offsets.shape[1]):
                other = index[v + offsets[s, k, 0], u + offsets[s, k, 1]]
                if other < 0:
                    continue
                # Ranges differ by little: their ratio is one more than the difference of their logarithms.
                cotangent = (1 + own - height[other] - cosine[s, k]) * per_sine[s, k]
                if cotangent > steepest:
                    steepest, who, which = cotangent, other, k
            steep[i, s], hider[i, s], per[i, s] = steepest, who, per_sine[s, which]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _slope(steep, hider, price, angles, cost, slope, part, parts):
    """Sum over the sectors of what each horizon costs, between those of the levels in proportion; and how it follows the
    cotangents."""
    last = price.shape[2] - 1
    for i in range(part, len(cost), parts):
        cost[i] = 0.0
        for s in range(steep.shape[1]):
            if hider[i, s] < 0:
                continue
            angle = np.arctan2(1.0, steep[i, s])
            within = min(max(angle, angles[1]), angles[last])
            level = _level(within, angles)
            wide = angles[level + 1] - angles[level]
            share = (within - angles[level]) / wide
            cost[i] += (1 - share) * price[i, s, level] + share * price[i, s, level + 1]
            if angle == within:
                rise = (price[i, s, level + 1] - price[i, s, level]) / wide
                slope[i, s] = -rise / (1 + steep[i, s] ** 2)
