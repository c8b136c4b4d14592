"""Whether a result can be trusted, in one line: what its stages measured of themselves, without a truth.

A sign is a number of a stage's report that grows where results go wrong. Its limit is where results began to be wrong on half
of the dials of `roomlight bench stress`; the other half scored them (docs/decisions/0066-quality.md).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Facts = Mapping[str, Mapping[str, Any]]
"""Of every finished stage, by its name: the values of its report."""

GOOD, DOUBTFUL, BAD = "good", "doubtful", "not to be trusted"
BAD_FROM = 2.0
"""So many times its limit a sign says that the result is wrong; once, that it may be."""


@dataclass(frozen=True, slots=True)
class Sign:
    """One number that tells of wrong results."""

    reason: str  # with `{value}`
    remedy: str
    measure: Callable[[Facts], float]  # NaN: not known
    limit: float
    scale: float = 1.0  # from what is measured to what is told

    def doubt(self, facts: Facts) -> float:
        """The number over its limit; 0 where it is not known."""
        value = self.measure(facts)
        return value / self.limit if math.isfinite(value) else (0.0 if math.isnan(value) else math.inf)


@dataclass(frozen=True, slots=True)
class Quality:
    """The verdict of a session's result."""

    grade: str
    doubt: float  # of the sign that says most, over its limit
    reason: str
    remedy: str

    @property
    def good(self) -> bool:
        """Nothing speaks against the result."""
        return self.grade == GOOD

    def __str__(self) -> str:
        return f"{self.grade}: {self.reason}" + (f" {self.remedy}" if self.remedy else "")


def quality(facts: Facts) -> Quality:
    """The verdict of what the sign that says most says."""
    doubts = [sign.doubt(facts) for sign in SIGNS]
    most = int(np.argmax(doubts))
    sign, doubt = SIGNS[most], doubts[most]
    if doubt < 1:
        return Quality(GOOD, doubt, "nothing that the stages measured of themselves speaks against it.", "")
    value = f"{sign.scale * sign.measure(facts):.2g}"
    return Quality(
        BAD if doubt >= BAD_FROM else DOUBTFUL, doubt, sign.reason.format(value=value), sign.remedy
    )


def _number(stage: str, name: str) -> Callable[[Facts], float]:
    """A number of a stage's report."""

    def measure(facts: Facts) -> float:
        value = facts.get(stage, {}).get(name)
        return float(value) if isinstance(value, int | float) else math.nan

    return measure


def _views(facts: Facts) -> float:
    """Larger where they are fewer."""
    return 1 / max(_number("surface", "fitted_views")(facts), 1)


def _exposure_drift(facts: Facts) -> float:
    """Standard deviation of the views' log factors."""
    drift = facts.get("surface", {}).get("exposure_drift")
    return float(np.std(drift)) if drift else math.nan


SIGNS: tuple[Sign, ...] = ()
