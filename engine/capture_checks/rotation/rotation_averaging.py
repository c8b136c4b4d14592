"""How the camera stood in each shot, as far as is known while capturing: turns only, chained and averaged.

Source: robust averaging of relative rotations (Chatterjee and Govindu 2013), here in the chordal sense. Each link
offers up to four turns; the one that fits best with what other links say is believed. Shots that no link joins
are in different groups, each with a world of its own. `cam_from_world` is the rotation of the world's directions
into the camera's frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int

from engine.capture_checks.rotation.overlap import ENOUGH, ViewPair

TOLERANCE_RAD = np.radians(4.0)  # by which a good link may contradict the others
PATIENCE = 20.0  # misfit (of Turn) up to which a turn may win by fitting better with other links
MISFIT_WEIGHT = 0.3  # misfits add up over matches that are not independent
MOST_WEIGHT = 60  # inliers; more make no link surer
INERTIA = 0.3
ROUNDS, DONE_RAD = 20, np.radians(0.05)


@dataclass(frozen=True, slots=True, eq=False)
class RotationGraph:
    """The rotations so far."""

    cam_from_world: Float64[np.ndarray, "n 3 3"]
    group: Int[np.ndarray, " n"]  # shots of one number share a world
    logged: Bool[np.ndarray, " n"]  # told by the rig: never changed; all of group 0

    @property
    def main(self) -> int:
        """The largest group's number; of equals the earliest."""
        numbers, sizes = np.unique(self.group, return_counts=True)
        return int(numbers[sizes.argmax()]) if len(numbers) else 0


NOTHING = RotationGraph(np.zeros((0, 3, 3)), np.zeros(0, np.int64), np.zeros(0, bool))


def with_shot(
    before: RotationGraph,
    links: Sequence[ViewPair],
    all_links: Sequence[ViewPair],
    logged: Float64[np.ndarray, "3 3"] | None,
) -> RotationGraph:
    """One shot more, by its `links` to earlier ones; `all_links` hold those of every shot, these included."""
    number = len(before.group)
    good = sorted((one for one in links if one.inliers >= ENOUGH), key=lambda one: -one.inliers)
    fresh = int(before.group.max(initial=0)) + 1
    if logged is not None:
        cam_from_world, group = logged, 0
    elif good:
        group = int(before.group[good[0].earlier])
        cam_from_world = _first_guess(before, [one for one in good if before.group[one.earlier] == group])
    else:
        cam_from_world, group = np.eye(3), fresh
    turned = RotationGraph(
        np.concatenate([before.cam_from_world, cam_from_world[None]]),
        np.append(before.group, group),
        np.append(before.logged, logged is not None),
    )
    for one in good:
        turned = _joined(turned, one, number)
    return _averaged(turned, [one for one in all_links if one.inliers >= ENOUGH])


def _first_guess(before: RotationGraph, links: Sequence[ViewPair]) -> Float64[np.ndarray, "3 3"]:
    """Of all turns that the links offer a new shot the one that contradicts the fewest."""
    offers = [
        np.stack([turn.later_from_earlier @ before.cam_from_world[one.earlier] for turn in one.turns])
        for one in links
    ]
    tries = np.concatenate(offers)
    cost = np.zeros(len(tries))
    for one, offer in zip(links, offers, strict=True):
        misfit = np.array([turn.misfit for turn in one.turns])
        off = _off(np.einsum("tij,kij->tk", tries, offer))
        price = (MISFIT_WEIGHT * (misfit - misfit[0]) + PATIENCE * off / (1 + off)).min(axis=1)
        cost += min(one.inliers, MOST_WEIGHT) * price
    return tries[int(cost.argmin())]


def _off(trace: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
    """Squared angle, in `TOLERANCE_RAD`, of a turn of that trace."""
    return np.square(np.arccos(np.clip((trace - 1) / 2, -1, 1)) / TOLERANCE_RAD)


def _joined(turned: RotationGraph, link: ViewPair, number: int) -> RotationGraph:
    """The two shots' groups as one: the world of the one without the rig, or of the smaller, is turned."""
    ours, theirs = int(turned.group[number]), int(turned.group[link.earlier])
    if ours == theirs:
        return turned
    sizes = {group: int((turned.group == group).sum()) for group in (ours, theirs)}
    # Group 0 holds the rig's shots.
    stays = min((ours, theirs), key=lambda group: (group != 0, -sizes[group], group))
    goes = theirs if stays == ours else ours
    turn = link.turns[0].later_from_earlier
    later, earlier = turned.cam_from_world[number], turned.cam_from_world[link.earlier]
    old_from_new = earlier.T @ turn.T @ later if stays == ours else later.T @ turn @ earlier
    moves = turned.group == goes
    cam_from_world = np.where(
        moves[:, None, None], turned.cam_from_world @ old_from_new, turned.cam_from_world
    )
    return RotationGraph(cam_from_world, np.where(moves, stays, turned.group), turned.logged)


def _averaged(turned: RotationGraph, links: Sequence[ViewPair]) -> RotationGraph:
    """All rotations settled between their links."""
    if not links or turned.logged.all():
        return turned
    earlier = np.array([one.earlier for one in links])
    later = np.array([one.later for one in links])
    weight = np.minimum([one.inliers for one in links], MOST_WEIGHT).astype(np.float64)
    most = max(len(one.turns) for one in links)
    turns = np.stack(
        [[one.turns[min(k, len(one.turns) - 1)].later_from_earlier for k in range(most)] for one in links]
    )
    misfit = np.array([[one.turns[min(k, len(one.turns) - 1)].misfit for k in range(most)] for one in links])
    misfit -= misfit[:, :1]
    now = turned.cam_from_world.copy()
    row = np.arange(len(links))
    for _ in range(ROUNDS):
        told = np.einsum("lij,lkj->lik", now[later], now[earlier])
        off = _off(np.einsum("lij,lkij->lk", told, turns))
        choice = (MISFIT_WEIGHT * misfit + PATIENCE * off / (1 + off)).argmin(axis=1)
        chosen, distance = turns[row, choice], off[row, choice]
        pull = weight / (1 + distance)
        total = np.zeros_like(now)
        np.add.at(total, later, pull[:, None, None] * (chosen @ now[earlier]))
        np.add.at(total, earlier, pull[:, None, None] * (chosen.transpose(0, 2, 1) @ now[later]))
        total += (INERTIA * np.abs(total).max(axis=(1, 2)) + 1e-9)[:, None, None] * now
        u, _, vt = np.linalg.svd(total)
        u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
        new = np.where(turned.logged[:, None, None], now, u @ vt)
        moved = float(np.abs(new - now).max())
        now = new
        if moved < DONE_RAD:
            break
    return RotationGraph(now, turned.group, turned.logged)
