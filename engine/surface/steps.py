"""Steps in depth, of which normals say nothing: told by what hides the room.

A plate on a plate of the same slope leaves no trace in normals; its height shows in the shadow it casts. Where a
step stands is plain to see: below its edge the horizon towards it is high, above it low. These edges part
the surface into regions (a watershed), and each region, with a neighbour or with all that stand as high, is tried
nearer and farther as a whole. It stays where the horizons that the depth then has cost the photographs least;
a tear between two regions where no edge is seen costs as well.

Heights are logarithms of the distance along the viewing ray, in units of a pixel's width: adding to them is what
integration of normals leaves open. Camera frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import no_type_check

import cv2
import numba
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_erosion, distance_transform_edt, label, maximum
from scipy.ndimage import shift as shifted
from scipy.sparse.csgraph import connected_components

from engine.light.rasterise import Run, workers
from engine.progress import Progress
from engine.surface.horizons import RINGS, SECTORS
from engine.surface.observations import numbered

HORIZONS = np.concatenate([[0.0], RINGS, [np.radians(130.0)]])
"""Angle from the viewing ray of every level's horizon; the last one stands for an open sky."""
NEAR, GROWTH, FAR = 16, 1.12, 96
"""Pixels along a sector that are looked at: every one to NEAR, then in steps that grow, to FAR."""
ASIDE, RIM = 1.0, 2
"""Pixels between the two horizons whose difference is an edge, and pixels of the object's rim that tell nothing."""
WALL, SEEN = 0.8, 0.5
"""An edge in radians summed over the sectors: where regions end, and what makes a tear cheap."""
CORES = (12, 8, 6, 4, 2.5, 1.5)
"""Pixels from the nearest wall where regions begin, the widest first."""
SPEAKERS = 6000
"""Pixels, evenly spread, whose horizons decide."""
ALIKE, LOUDEST = np.radians(8.0), 40.0
"""A horizon so near to the one preferred costs nothing (rings are as wide); and the most that a sector says."""
TEAR, LEAST_TEAR = 5.0, 0.05
"""Squared spreads for a pixel's width of height along a pixel of border without an edge; share of it with one."""
GAIN = 300.0
"""Squared spreads that a lift must bring: what 25 sectors pay for their horizons."""
LIFTS = (-16, -8, -4, -2, -1, 1, 2, 4, 8, 16)
UNIT = 220
"""Lifts are tried in pixel widths of an object that fills so many squared."""
SWEEPS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What the photographs of every pixel say about its horizons."""

    goal: Float[np.ndarray, "p s"]  # the horizon it prefers, radians from the viewing ray
    price: Float[np.ndarray, "p s l"]  # what others cost more, squared spreads


def told(
    level: Int[np.ndarray, "p s"],
    prices: Float[np.ndarray, "p s l"],
    height: Float[np.ndarray, " p"],
    mask: Bool[np.ndarray, "h w"],
    pitch: float,
) -> Told:
    """From the levels that pixels hold, the prices of all, and the heights that level 0 speaks of."""
    with workers() as run:
        own = horizons_of(mask, height, pitch, run)
    goal = np.where(level > 0, HORIZONS[level], own)
    held = np.take_along_axis(prices, level[..., None].astype(int), 2)
    return Told(goal, np.clip(prices - held, 0, LOUDEST).astype(np.float32))


def lifts(
    mask: Bool[np.ndarray, "h w"],
    height: Float[np.ndarray, " p"],
    told: Told,
    pitch: float,
    start: Float[np.ndarray, " p"],
    progress: Progress,
) -> Float[np.ndarray, " p"]:
    """How much nearer the camera than `height` says, in the same units; zero for most, or where no step is seen.

    `height` is the logarithm of the range over `pitch`, the angle between neighbouring pixels' rays. Coordinate descent
    from the lifts believed so far (`start`), over groups of regions.
    """
    strength = edges(mask, told.goal)
    region = regions(mask, strength)
    border = borders(region, strength)
    of = region[mask]
    v, u = np.nonzero(mask)
    stride = int(np.ceil(np.sqrt(len(of) / SPEAKERS)))
    speakers = np.nonzero((v % stride == 0) & (u % stride == 0))[0]
    if len(border) < 2 or not len(speakers):
        return np.zeros(len(of))
    weight = len(of) / len(speakers)
    shifts = np.array(LIFTS) * np.sqrt(len(of)) / UNIT
    known = Told(told.goal[speakers], told.price[speakers])
    field = Field(mask, height, pitch, of)
    at = np.stack([v, u], 1)
    reach = [
        np.nonzero(np.all((at[speakers] >= box[0] - FAR) & (at[speakers] <= box[1] + FAR), 1))[0]
        for box in ((at[of == k].min(0), at[of == k].max(0)) for k in range(len(border)))
    ]
    lift = np.array([np.median(start[of == k]) for k in range(len(border))])
    touch = (border > 0) | np.eye(len(border), dtype=bool)
    clock, moved, tried = 1, np.ones(len(border), int), {}
    with workers() as run:
        costs = field.costs(lift, [], np.zeros(1), speakers, known, run)[:, 0]
        for sweep in range(SWEEPS):
            # A group is tried again when it has moved, or a neighbour since.
            todo = [
                group
                for group in groups(border, lift)
                if moved[touch[list(group)].any(0)].max() >= tried.get(group, 0)
            ]
            for i, group in enumerate(todo):
                progress.step((sweep + i / len(todo)) / SWEEPS, "heights of steps")
                members = list(group)
                near = np.unique(np.concatenate([reach[k] for k in group]))
                part = Told(known.goal[near], known.price[near])
                now = field.costs(lift, members, shifts, speakers[near], part, run)
                change = weight * (now - costs[near, None]).sum(0)
                change += TEAR * (
                    tension(border, lift, members, shifts) - tension(border, lift, members, np.zeros(1))
                )
                best, clock = int(change.argmin()), clock + 1
                tried[group] = clock
                if change[best] < -GAIN:
                    lift[members] += shifts[best]
                    costs[near] = now[:, best]
                    moved[members] = clock
            if not todo:
                break
    lift -= np.median(lift[of])
    return lift[of]


def groups(border: Float[np.ndarray, "k k"], lift: Float[np.ndarray, " k"]) -> Iterator[tuple[int, ...]]:
    """Regions that are lifted together: each, each two that touch, and all that touch and stand as high."""
    count = len(lift)
    for k in range(count):
        yield (k,)
    for k, j in np.argwhere(np.triu(border > 0)):
        yield int(k), int(j)
    together = (border > 0) & (np.abs(lift[:, None] - lift) < 1e-6)
    number, plate = connected_components(together, directed=False)
    for p in range(number):
        group = tuple(np.nonzero(plate == p)[0].tolist())
        if 2 < len(group) < count:
            yield group


def tension(
    border: Float[np.ndarray, "k k"],
    lift: Float[np.ndarray, " k"],
    group: list[int],
    shifts: Float[np.ndarray, " t"],
) -> Float[np.ndarray, " t"]:
    """Tears at the borders of a group lifted so far; those inside it twice, which no lift of it changes."""
    member = np.isin(np.arange(len(lift)), group)
    apart = lift[group][:, None] - lift + np.multiply.outer(shifts, 1 - member[None, :])
    return (border[group] * np.abs(apart)).sum((1, 2))


def edges(mask: Bool[np.ndarray, "h w"], goal: Float[np.ndarray, "p s"]) -> Float[np.ndarray, "h w"]:
    """How much the view opens, over `ASIDE` pixels to both sides, summed over the sectors in which it does; radians."""
    strength = np.zeros(mask.shape)
    for s, (dv, du) in enumerate(_ways()):
        horizon = np.zeros(mask.shape, np.float32)
        horizon[mask] = np.minimum(goal[:, s], HORIZONS[-1])
        horizon = cv2.medianBlur(horizon, 3)
        ahead, behind = (
            shifted(horizon, (-r * dv, -r * du), order=1, mode="nearest") for r in (ASIDE, -ASIDE)
        )
        strength += np.maximum(ahead - behind, 0)
    inner = binary_erosion(mask, iterations=RIM)
    return np.where(inner, strength, 0)


def regions(mask: Bool[np.ndarray, "h w"], strength: Float[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """The mask's parts between edges, numbered from 0; -1 outside."""
    wall = (strength > WALL) | ~np.asarray(binary_erosion(mask, iterations=RIM), bool)
    away = cv2.GaussianBlur(np.asarray(distance_transform_edt(~wall)), (0, 0), 0.6)
    seeds, count = np.zeros(mask.shape, np.int32), 0
    for core in CORES:
        found, number = label(away > core)  # pyright: ignore[reportGeneralTypeIssues]
        taken = maximum(seeds, found, np.arange(1, number + 1))
        for fresh in np.nonzero(np.asarray(taken) == 0)[0] + 1:
            count += 1
            seeds[found == fresh] = count
    if not count:
        return np.where(mask, 0, -1)
    relief = np.clip(strength / 4 * 230, 0, 230) + np.clip(25 - 3 * away, 0, 25)
    seeds = cv2.watershed(cv2.merge([relief.astype(np.uint8)] * 3), seeds)
    seeds[~mask] = 0
    nearest = distance_transform_edt(seeds <= 0, return_distances=False, return_indices=True)
    whole = seeds[tuple(nearest)]  # pyright: ignore[reportArgumentType]
    numbers = np.unique(whole[mask])
    return np.where(mask, np.searchsorted(numbers, whole), -1)


def borders(region: Int[np.ndarray, "h w"], strength: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "k k"]:
    """Pixels of border between every two regions, each counting less the more of an edge is seen there."""
    count = int(region.max()) + 1
    border = np.zeros((count, count))
    for a, b in (((slice(None), slice(0, -1)), (slice(None), slice(1, None))),
                 ((slice(0, -1), slice(None)), (slice(1, None), slice(None)))):  # fmt: skip
        one, other = region[a], region[b]
        apart = (one >= 0) & (other >= 0) & (one != other)
        edge = np.maximum(strength[a], strength[b])[apart]
        np.add.at(border, (one[apart], other[apart]), np.exp(-((edge / SEEN) ** 2)) + LEAST_TEAR)
    return border + border.T


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
        self.offsets = np.rint(np.array(steps)[None, :, None] * _ways()[:, None]).astype(np.int64)
        self.cosine, self.per_sine = np.cos(np.array(steps) * pitch), 1 / np.sin(np.array(steps) * pitch)

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

    def costs(
        self,
        lift: Float[np.ndarray, " k"],
        group: list[int],
        shifts: Float[np.ndarray, " t"],
        pixels: Int[np.ndarray, " n"],
        told: Told,
        run: Run,
    ) -> Float[np.ndarray, "n t"]:
        """What these horizons cost the pixels' photographs; `told` is theirs."""
        found = np.empty((len(pixels), len(shifts)))
        horizon = self.horizons(lift, group, shifts, pixels, run)
        run(_price, (horizon, told.goal.astype(np.float32), told.price, HORIZONS, found))
        return found


def horizons_of(
    mask: Bool[np.ndarray, "h w"], height: Float[np.ndarray, " p"], pitch: float, run: Run
) -> Float[np.ndarray, "p s"]:
    """Every pixel's horizons as its height field has them."""
    every = np.arange(len(height))
    field = Field(mask, height, pitch, np.zeros(len(height), int))
    return field.horizons(np.zeros(1), [], np.zeros(1), every, run)[..., 0]


def _ways() -> Float[np.ndarray, "s 2"]:
    """(row, column) of a pixel's step along the middle of every sector, as in `horizons.compass`."""
    turn = 2 * np.pi * ((np.arange(SECTORS) + 0.5) / SECTORS - 0.5)
    return np.stack([np.sin(turn), np.cos(turn)], 1)


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
                    break
                # Ranges differ by little: their ratio is one more than the difference of their logarithms.
                steep = (1 + own - height[other] - cosine[k]) * per_sine[k]
                by = (one - member[other]) * per_sine[k]
                for t in range(count):
                    steepest[t] = max(steepest[t], steep - by * shifts[t])
            for t in range(count):
                found[i, s, t] = np.arctan2(1.0, steepest[t]) if steepest[t] > -1e29 else np.pi


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
                level = 1
                while level < last - 1 and angle >= angles[level + 1]:
                    level += 1
                share = (angle - angles[level]) / (angles[level + 1] - angles[level])
                total[i, t] += (1 - share) * price[i, s, level] + share * price[i, s, level + 1]
