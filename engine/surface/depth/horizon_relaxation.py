"""Heights relax until their horizons suit the photographs.

Integration draws together what hangs in front of each other: two tubes that cross, the ribs of a vase. But what stands in
front shows in what it hides. Every horizon that a pixel may have has its price, in how much worse its photographs are then
explained; and heights make horizons. So the heights go where their horizons cost least, all pixels and sectors together. To
depart from what normals tell costs as well, by how much one pixel rises against the next, and little where the view opens:
there stands an edge. `step_heights` tries whole regions, far; here every pixel moves, as far as it is downhill.

Heights are logarithms of the distance along the viewing ray, in units of a pixel's width. Camera frame.
"""

import itertools
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int

from engine.light.gaussians.rasterize import Run, workers
from engine.progress import Progress
from engine.surface.data.observations import aside, numbered
from engine.surface.depth.graph_laplacian import laplacian, solver_of
from engine.surface.depth.step_heights import SEEN, Told, edges
from engine.surface.visibility.height_field import Field

TEAR, LEAST_TEAR = 20.0, 0.05
"""Squared spreads for a pixel's width of height between two neighbours without an edge; share of it with one. With 5, 60 and 100
a knot and a vase come out alike."""
SOFT = 0.2
"""Pixel widths of height below which a departure costs by its square."""
ENOUGH = 2e-4
"""Part of the cost that a step must take away, else it is the last."""
WORTH = 4.0
"""Squared spreads that each pixel's height must bring on average over what normals tell, or none is moved: by Akaike's criterion a
number of its own is worth two, and of a ball, where there is nothing to be found, they bring one."""
LOOSE = 1e-4
"""What keeps a part that nothing holds from flying off, beside what holds a pixel to its neighbour."""


@dataclass(frozen=True, slots=True)
class Steps:
    """How far and how often heights step."""

    turns: int  # at most
    afresh: int  # under one preconditioner
    farthest: float  # that one takes a pixel
    shorter: float  # what one that does not pay is multiplied with,
    tries: int  # so many times at most,
    shortest: float = 0.0  # and no farther down than to this part of its direction


STEPS = Steps(turns=100, afresh=8, farthest=8.0, shorter=0.5, tries=64, shortest=1e-4)
"""Heights in pixel widths; 64 halvings come down to the shortest from anywhere."""


def relaxed(
    mask: Bool[np.ndarray, "h w"],
    height: Float[np.ndarray, " p"],
    told: Told,
    pitch: float,
    start: Float[np.ndarray, " p"],
    progress: Progress,
) -> Float[np.ndarray, " p"]:
    """How much nearer the camera than `height` says, in the same units.

    Arguments as of `step_heights.lifts`. Conjugate gradients (Polak, Ribiere) from the lifts believed so far (`start`), preconditioned by
    what holds neighbours together: what is one piece moves as one.
    """
    if not len(told.speakers):
        return start
    with workers() as run:
        cost = _Cost(mask, height, told, pitch, run)
        own, begun = cost.at(height).total, cost.at(height - start)
        now, here = descended(cost, height - start, begun, STEPS, progress, "heights of what hides the room")
    if own - here.total > WORTH * len(height):
        return _without_needles(height - now, mask)
    return start if begun.total < own else np.zeros(len(height))


def _without_needles(lift: Float[np.ndarray, " p"], mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, " p"]:
    """Each the median of those around it. The rings and sectors in which a few pixels look around meet some of the others and
    never the rest, which stay behind; on a mesh each of them is a needle that hides what stands beside it."""
    near = aside(mask, np.array(list(itertools.product((-1, 0, 1), repeat=2))))
    around = np.sort(np.where(near >= 0, lift[near], np.inf), axis=1)
    middle = ((near >= 0).sum(1) - 1) // 2
    return around[np.arange(len(lift)), middle]


@dataclass(frozen=True, slots=True, eq=False)
class Here:
    """What heights cost."""

    total: float
    slope: Float[np.ndarray, " p"]
    hold: Float[np.ndarray, " e"]  # how stiffly each pair of neighbours holds together there


@runtime_checkable
class Cost(Protocol):
    """What goes downhill."""

    def at(self, height: Float[np.ndarray, " p"]) -> Here:
        """At some heights."""
        ...

    def stiffness(self, hold: Float[np.ndarray, " e"]) -> sparse.csc_matrix:
        """What resists a step."""
        ...


def descended(
    cost: Cost,
    height: Float[np.ndarray, " p"],
    here: Here,
    steps: Steps,
    progress: Progress,
    doing: str,
) -> tuple[Float[np.ndarray, " p"], Here]:
    """The heights after some steps of conjugate gradients (Polak, Ribiere), preconditioned by what holds neighbours together;
    and what they cost. `here` is what they cost to begin with.
    """
    direction, before, power = np.zeros(len(height)), np.zeros(len(height)), np.inf
    along, solve = 1.0, None
    for turn in range(steps.turns):
        progress.step(turn / steps.turns, doing)
        if solve is None or turn % steps.afresh == 0:
            _, solve = solver_of(cost.stiffness(here.hold), len(height))
        downhill = -solve(here.slope)
        direction = downhill + max(0.0, float(downhill @ (before - here.slope)) / power) * direction
        if direction @ here.slope >= 0:
            direction = downhill
        before, power = here.slope, max(-float(downhill @ here.slope), 1e-30)
        along = min(4 * along, steps.farthest / max(float(np.abs(direction).max()), 1e-9))
        there = cost.at(height + along * direction)
        for _ in range(steps.tries):
            if there.total < here.total or along <= steps.shortest:
                break
            along *= steps.shorter
            there = cost.at(height + along * direction)
        fall = here.total - there.total
        if fall <= 0:
            break
        height, here = height + along * direction, there
        if fall < ENOUGH * here.total:
            break
    return height, here


class _Cost:
    """What horizons and departures from the normals' own heights cost together."""

    def __init__(self, mask, height, told, pitch, run: Run):
        self.normals, self.told, self.run = height, told, run
        self.field = Field(mask, height, pitch, np.zeros(len(height), int))
        self.weight = len(height) / len(told.speakers)
        self.bonds = seams(mask, edges(mask, told.goal))

    def at(self, height: Float[np.ndarray, " p"]) -> Here:
        told = self.told
        cost, slope = self.field.uphill(height, told.speakers, told.price, self.run)
        torn, pull, hold = self.bonds.torn(height - self.normals)
        return Here(self.weight * cost + torn, self.weight * slope + pull, hold)

    def stiffness(self, hold: Float[np.ndarray, " e"]) -> sparse.csc_matrix:
        return self.bonds.stiffness(hold)


@dataclass(frozen=True, slots=True, eq=False)
class Bonds:
    """What holds `count` pixels together."""

    pairs: Int[np.ndarray, "2 e"]  # every two neighbours
    strength: Float[np.ndarray, " e"]  # what a pixel's width of height between them costs
    count: int

    def torn(
        self, lift: Float[np.ndarray, " p"]
    ) -> tuple[float, Float[np.ndarray, " p"], Float[np.ndarray, " e"]]:
        """What departures from the normals' own heights cost, in pixel widths; by how much more for every pixel's; and how stiffly
        each pair holds together there."""
        one, other = self.pairs
        apart = lift[other] - lift[one]
        far = np.sqrt(apart**2 + SOFT**2)
        hold = self.strength / far
        pull = np.bincount(other, hold * apart, self.count) - np.bincount(one, hold * apart, self.count)
        return float((self.strength * (far - SOFT)).sum()), pull, hold

    def stiffness(self, hold: Float[np.ndarray, " e"]) -> sparse.csc_matrix:
        """What resists a step."""
        one, other = self.pairs
        return laplacian(one, other, hold, self.count, LOOSE * float(hold.mean()))


def seams(mask: Bool[np.ndarray, "h w"], strength: Float[np.ndarray, "h w"], tear: float = TEAR) -> Bonds:
    """Of every two neighbours of the mask, weaker where an edge is seen."""
    index, pairs, bond = numbered(mask), [], []
    for a, b in (((slice(None), slice(0, -1)), (slice(None), slice(1, None))),
                 ((slice(0, -1), slice(None)), (slice(1, None), slice(None)))):  # fmt: skip
        both = mask[a] & mask[b]
        edge = np.maximum(strength[a], strength[b])[both]
        pairs.append(np.stack([index[a][both], index[b][both]]))
        bond.append(tear * (np.exp(-((edge / SEEN) ** 2)) + LEAST_TEAR))
    return Bonds(np.concatenate(pairs, 1), np.concatenate(bond), int(mask.sum()))
