"""Whether a result can be trusted, in one line: what its stages measured of themselves, without a truth.

A sign is a number of a stage's report that grows where results go wrong. Its limit is where results began to be wrong on half
of the dials of `roomlight bench stress`; the other half scored them (docs/decisions/0066-quality.md).
"""

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Facts = Mapping[str, Mapping[str, Any]]
"""Of every finished stage, by its name: the values of its report."""

GOOD, DOUBTFUL, BAD = "good", "doubtful", "not to be trusted"
BAD_FROM = 2.0
"""So many times its limit a sign says that the result is wrong; once, that it may be."""

LEAST_PART = 4
"""Views before and after a change, for a mean and its error."""
LEAST_SHARE = 0.01
"""Of the error of the views kept out: a part of the model that buys less is not needed, however certain that little is."""


@dataclass(frozen=True, slots=True)
class Sign:
    """One number that tells of wrong results."""

    reason: str  # with `{}` for what is measured
    remedy: str
    measure: Callable[[Facts], float]  # NaN: not known
    limit: float
    told: Callable[[float], str] = "{:.2g}".format

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


def is_needed(gain: float, stderr: float, error: float) -> bool:
    """Whether a scene asks for a part of the model that lowers the relative `error` of the views kept out by so much, give or
    take its standard error."""
    return gain > max(stderr, LEAST_SHARE * error)


def quality(facts: Facts) -> Quality | None:
    """The verdict that the sign that says most gives; None where there is no surface, or one of a solver that knows no errors."""
    if "stderr_normal_deg" not in facts.get("surface", {}):
        return None
    doubts = [sign.doubt(facts) for sign in SIGNS]
    doubt = max(doubts)
    sign = SIGNS[doubts.index(doubt)]
    if doubt < 1:
        return Quality(GOOD, doubt, "no check of the stages found a fault.", "")
    reason = sign.reason.format(sign.told(sign.measure(facts)))
    return Quality(BAD if doubt >= BAD_FROM else DOUBTFUL, doubt, reason, sign.remedy)


def _number(stage: str, name: str) -> Callable[[Facts], float]:
    """A number of a stage's report."""

    def measure(facts: Facts) -> float:
        value = facts.get(stage, {}).get(name)
        return float(value) if isinstance(value, int | float) else math.nan

    return measure


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def _share_of_log(logarithm: float) -> str:
    return _share(math.expm1(logarithm))


def _drift(facts: Facts) -> list[float]:
    """Log factors of the fitted views, in the order in which they were taken; the others have 0."""
    return [float(offset) for offset in facts.get("surface", {}).get("exposure_drift") or () if offset]


def _exposure_drift(facts: Facts) -> float:
    """Standard deviation of the views' log factors."""
    drift = _drift(facts)
    return statistics.pstdev(drift) if drift else math.nan


def _exposure_step(facts: Facts) -> float:
    """By how much the log factors differ before and after a time, at least: three standard errors less than measured, the
    most of the eighths of the session."""
    drift = _drift(facts)
    cuts = {len(drift) * eighth // 8 for eighth in range(1, 8)}
    steps = [
        abs(statistics.fmean(before) - statistics.fmean(after))
        - 3 * math.hypot(_stderr(before), _stderr(after))
        for before, after in ((drift[:cut], drift[cut:]) for cut in sorted(cuts))
        if min(len(before), len(after)) >= LEAST_PART
    ]
    return max(0.0, *steps) if steps else math.nan


def _stderr(values: Sequence[float]) -> float:
    return statistics.stdev(values) / math.sqrt(len(values))


SIGNS = (
    Sign(
        "half of the normals have a standard error of {} degrees or more.",
        "Add views that turn about a second axis, and views that show more of the room.",
        _number("surface", "stderr_normal_deg"), 5.5,
    ),
    Sign(
        "validation views differ from their renderings by {} (median).",
        "Look at the mask, whether the object moved on its mount, and at the exposures; add views.",
        _number("surface", "held_out_error"), 0.11, _share,
    ),
    Sign(
        "the residuals of the object's pixels are {} times the expected error (median).",
        "Look at the mask, whether the object moved on its mount, and at the poses.",
        _number("surface", "residual"), 5.0,
    ),
    Sign(
        "in some photographs the object stands {} px or more beside where it stands in others.",
        "It moved on its mount: fix it and take them again, or leave out those before or after it moved.",
        _number("surface", "object_shift_px"), 0.5,
    ),
    Sign(
        "along {} of the mask's border, pixels just inside and just outside change alike from view to view.",
        "Look whether the mask is too large, too small or lacks a piece; if not, the photographs are out of focus: take them again.",
        _number("segment", "border_alike"), 0.25, _share,
    ),
    Sign(
        "backgrounds of validation views differ from the fitted light by {}.",
        "Check poses and focal length, and whether lamps or people moved while the photographs were taken; add views.",
        _number("light", "heldout_log_l1"), 0.35, _share_of_log,
    ),
    Sign(
        "the brightness of the light varies by {} from view to view (standard deviation).",
        "Fix exposure and white balance, and keep lamps and curtains as they are.",
        _exposure_drift, 0.2, _share,
    ),
    Sign(
        "earlier photographs show the object {} brighter or darker, beside its renderings, than later ones.",
        "A lamp was switched, a curtain moved or the sun came out: take them again, or leave out those before or after the change.",
        _exposure_step, 0.1, _share_of_log,
    ),
    Sign(
        "{} of the light on the object comes from directions that no photograph shows.",
        "Turn camera and object about a second axis as well, or add views that look up and down.",
        _number("surface", "unseen_light"), 0.25, _share,
    ),
)  # fmt: skip
