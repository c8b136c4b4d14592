"""The way to a target: corners that take up backlash, how long it takes, and whether a place lies on it.

Every axis ends its way upwards, by at least its backlash, so that the gears always rest on the same flank.
Degrees, degrees per minute, seconds; a place has one number an axis.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Place = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Way:
    """Straight lines through `corners`, of which the last is the target."""

    corners: tuple[Place, ...]

    @classmethod
    def to(cls, target: Place, start: Place, backlash: Sequence[float], loaded: bool) -> "Way":
        """From `start`; `loaded`: every axis rests there as after an approach from below."""
        corner = tuple(
            aim - play if _from_above(aim, here, play, loaded) else aim
            for aim, here, play in zip(target, start, backlash, strict=False)
        )
        return cls((target,) if corner == target else (corner, target))


def _from_above(aim: float, here: float, play: float, loaded: bool) -> bool:
    """Would going straight there leave the gear on the wrong flank?"""
    if play == 0 or (loaded and abs(aim - here) < 1e-3):
        return False
    return aim < here or (not loaded and aim - here < play)


def travel_s(corners: Sequence[Place], feed_deg_min: float, settings: Mapping[int, float]) -> float:
    """How long GRBL takes along `corners`, stopping at each; `settings` are its `$` settings as far as known."""
    total_s = 0.0
    for start, end in itertools.pairwise(corners):
        way = math.dist(start, end)
        speed, acceleration = feed_deg_min / 60, math.inf
        for axis, (a, b) in enumerate(zip(start, end, strict=True)):
            share = abs(b - a) / way if way else 0.0
            if share > 0:
                speed = min(speed, settings.get(110 + axis, math.inf) / 60 / share)
                acceleration = min(acceleration, settings.get(120 + axis, 10.0) / share)
        total_s += way / speed + speed / acceleration
    return total_s


def distance_to(place: Place, corners: Sequence[Place]) -> float:
    """From a place to the nearest point of the line through `corners`."""
    if len(corners) == 1:
        return math.dist(place, corners[0])
    return min(_to_segment(place, start, end) for start, end in itertools.pairwise(corners))


def _to_segment(place: Place, start: Place, end: Place) -> float:
    along = [b - a for a, b in zip(start, end, strict=True)]
    square = sum(value * value for value in along)
    share = sum(d * (p - a) for d, p, a in zip(along, place, start, strict=True)) / square if square else 0.0
    share = min(1.0, max(0.0, share))
    return math.dist(place, [a + share * d for a, d in zip(start, along, strict=True)])
