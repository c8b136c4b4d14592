"""Steps in depth, of which normals say nothing: told by what hides the room.

A plate on a plate of the same slope leaves no trace in normals; its height shows in the shadow it casts. Where a
step stands is plain to see: below its edge the horizon towards it is high, above it low. These edges part
the surface into regions (a watershed); each region, and what grows when regions are joined across the faintest
edges first, is tried nearer and farther as a whole. It stays where the horizons that the depth then has cost the
photographs least; a tear between two regions where no edge is seen costs as well.

Heights are logarithms of the distance along the viewing ray, in units of a pixel's width: adding to them is what
integration of normals leaves open. Camera frame.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_erosion, distance_transform_edt, find_objects, label, maximum, median
from scipy.ndimage import shift as shifted

from engine.light.gaussians.rasterize import workers
from engine.progress import Progress
from engine.surface.data.observations import islands
from engine.surface.optimize.horizon_search import ways
from engine.surface.visibility.height_field import FAR, HORIZONS, Field, horizons_of

ASIDE, RIM = 1.0, 2
"""Pixels to either side of the point whose opening view is an edge, and pixels of the object's rim that tell nothing."""
WALL, SEEN = 0.8, 0.5
"""An edge in radians summed over the sectors: where regions end, and what makes a tear cheap."""
CORES = (12, 8, 6, 4, 2.5, 1.5)
"""Pixels from the nearest wall where regions begin, the widest first."""
SPEAKERS = 6000
"""Pixels, evenly spread, whose horizons decide."""
LOUDEST = 40.0
"""Squared spreads: the most that one sector says."""
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
    """What the photographs say about the horizons of the mask's pixels."""

    goal: Float[np.ndarray, "p s"]  # the horizon each prefers, radians from the viewing ray
    speakers: Int[np.ndarray, " k"]  # those whose prices are known
    price: Float[np.ndarray, "k s l"]  # what other horizons cost these more, squared spreads


def speakers(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, " k"]:
    """Pixels, evenly spread, that are enough to decide on heights."""
    v, u = np.nonzero(mask)
    stride = int(np.ceil(np.sqrt(len(v) / SPEAKERS)))
    return np.nonzero((v % stride == 0) & (u % stride == 0))[0]


def tell(
    level: Int[np.ndarray, "p s"],
    speakers: Int[np.ndarray, " k"],
    prices: Float[np.ndarray, "k s l"],
    height: Float[np.ndarray, " p"],
    mask: Bool[np.ndarray, "h w"],
    pitch: float,
) -> Told:
    """From the levels that pixels hold, what all levels cost some, and the heights that level 0 speaks of."""
    with workers() as run:
        own = horizons_of(mask, height, pitch, run)
    goal = np.where(level > 0, HORIZONS[level], own).astype(np.float32)
    prices = np.clip(prices, 0, LOUDEST)
    # Who keeps what the depth has would gain too little elsewhere: where it stands, between rings, it costs hardly anything.
    kept = np.where(level[speakers] > 0, 0, between(prices, own[speakers]))
    return Told(goal, speakers, np.maximum(prices - kept[..., None], 0).astype(np.float32))


def between(prices: Float[np.ndarray, "k s l"], angle: Float[np.ndarray, "k s"]) -> Float[np.ndarray, "k s"]:
    """What horizons cost that lie between those of the levels."""
    within = np.clip(angle, HORIZONS[1], HORIZONS[-1])
    level = np.clip(np.searchsorted(HORIZONS, within, "right") - 1, 1, len(HORIZONS) - 2)[..., None]
    share = (within - HORIZONS[level[..., 0]]) / np.diff(HORIZONS)[level[..., 0]]
    nearer, farther = (np.take_along_axis(prices, level + step, 2)[..., 0] for step in (0, 1))
    return (1 - share) * nearer + share * farther


def lifts(
    mask: Bool[np.ndarray, "h w"],
    height: Float[np.ndarray, " p"],
    told: Told,
    pitch: float,
    start: Float[np.ndarray, " p"],
    progress: Progress,
) -> Float[np.ndarray, " p"]:
    """How much nearer the camera than `height` says, in the same units; the median of each connected part is zero.

    `height` is the logarithm of the range over `pitch`, the angle between neighbouring pixels' rays. Coordinate descent
    from the lifts believed so far (`start`), over groups of regions.
    """
    strength = edges(mask, told.goal)
    region = regions(mask, strength)
    border, length = borders(region, strength)
    of, speaking = region[mask], told.speakers
    count = len(border)
    if count < 2 or not len(speaking):
        return np.zeros(len(of))
    weight = len(of) / len(speaking)
    shifts = np.array(LIFTS) * np.sqrt(len(of)) / UNIT
    field = Field(mask, height, pitch, of)
    rows, columns = np.nonzero(mask)
    rows, columns = rows[speaking], columns[speaking]
    reach = [
        (rows >= v.start - FAR)
        & (rows < v.stop + FAR)
        & (columns >= u.start - FAR)
        & (columns < u.stop + FAR)
        for v, u in find_objects(region + 1)
    ]
    lift = np.array(median(start, of, np.arange(count)))
    touch = (border > 0) | np.eye(count, dtype=bool)
    every = groups(border, length)
    clock, moved, tried = 1, np.ones(count, int), {}
    with workers() as run:
        costs = field.costs(lift, [], np.zeros(1), speaking, told.goal[speaking], told.price, run)[:, 0]
        for sweep in range(SWEEPS):
            # A group is tried again when it has moved, or a neighbour since.
            todo = [group for group in every if moved[touch[list(group)].any(0)].max() >= tried.get(group, 0)]
            for i, group in enumerate(todo):
                progress.step((sweep + i / len(todo)) / SWEEPS, "heights of steps")
                members = list(group)
                near = np.nonzero(np.any([reach[k] for k in group], axis=0))[0]
                who = speaking[near]
                now = field.costs(lift, members, shifts, who, told.goal[who], told.price[near], run)
                change = weight * (now - costs[near, None]).sum(0)
                change += TEAR * tension(border, lift, members, shifts)
                best, clock = int(change.argmin()), clock + 1
                tried[group] = clock
                if change[best] < -GAIN:
                    lift[members] += shifts[best]
                    costs[near] = now[:, best]
                    moved[members] = clock
            if not todo:
                break
    answer, (part, number) = lift[of], islands(mask)
    return answer - np.asarray(median(answer, part, np.arange(number)))[part]


def groups(border: Float[np.ndarray, "k k"], length: Float[np.ndarray, "k k"]) -> list[tuple[int, ...]]:
    """Regions that are lifted together: each, and what grows when they are joined across the least edge first."""
    bond = border / np.maximum(length, 1)
    pairs = np.argwhere(np.triu(border > 0))
    order = np.argsort(-bond[tuple(pairs.T)], kind="stable")
    count = len(border)
    joined: dict[int, tuple[int, ...]] = {k: (k,) for k in range(count)}
    of = list(range(count))
    found = list(joined.values())
    for a, b in pairs[order]:
        one, other = of[a], of[b]
        if one == other:
            continue
        joined[one] += joined.pop(other)
        for k in joined[one]:
            of[k] = one
        if len(joined[one]) < count:
            found.append(joined[one])
    return found


def tension(
    border: Float[np.ndarray, "k k"],
    lift: Float[np.ndarray, " k"],
    group: list[int],
    shifts: Float[np.ndarray, " t"],
) -> Float[np.ndarray, " t"]:
    """What lifting a group by each of `shifts` adds to the tears at its borders."""
    outside = np.setdiff1d(np.arange(len(lift)), group)
    apart = lift[group][:, None] - lift[outside]
    torn = np.abs(apart + shifts[:, None, None]) - np.abs(apart)
    return (border[group][:, outside] * torn).sum((1, 2))


def edges(mask: Bool[np.ndarray, "h w"], goal: Float[np.ndarray, "p s"]) -> Float[np.ndarray, "h w"]:
    """How much the view opens, over `ASIDE` pixels to both sides, summed over the sectors in which it does; radians."""
    strength = np.zeros(mask.shape)
    for s, (dv, du) in enumerate(ways()):
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


def borders(
    region: Int[np.ndarray, "h w"], strength: Float[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k k"]]:
    """Pixels of border between every two regions, each counting less the more of an edge is seen there; and plainly."""
    count = int(region.max()) + 1
    border, length = np.zeros((2, count, count))
    for a, b in (((slice(None), slice(0, -1)), (slice(None), slice(1, None))),
                 ((slice(0, -1), slice(None)), (slice(1, None), slice(None)))):  # fmt: skip
        one, other = region[a], region[b]
        apart = (one >= 0) & (other >= 0) & (one != other)
        edge = np.maximum(strength[a], strength[b])[apart]
        np.add.at(border, (one[apart], other[apart]), np.exp(-((edge / SEEN) ** 2)) + LEAST_TEAR)
        np.add.at(length, (one[apart], other[apart]), 1)
    return border + border.T, length + length.T
