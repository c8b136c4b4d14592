"""`process --budget TIME` and `--until DEG`: the least preset that the photographs ask for, within a budget.

Presets are climbed from draft on, or, where nothing but a budget is given, from the richest on that is expected to fit it. The
next is tried as long as its predicted time fits what is left of the budget and the error asked for is not reached. It is taken where it
renders the validation views better by more than the standard error of the gain over the views (the one-standard-error rule);
else the one before stays, and nothing above it is tried.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from engine.errors import SessionError

UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}
LEAST_EXPONENT = 0.1
"""Least exponent of error over time from which it is said what time would halve the error."""


@dataclass(frozen=True, slots=True)
class Goal:
    """What ends the climb."""

    budget_s: float = math.inf
    error_deg: float = 0.0  # median standard error of the normals


@dataclass(frozen=True, slots=True)
class Rung:
    """What a preset has reached."""

    preset: str
    seconds: float  # of the stage surface
    stderr_normal_deg: float  # median
    validation_error: Float[np.ndarray, " k"]  # of every validation view, relative


def asks_for_error(until: str | None) -> bool:
    """Whether `--until` names an error, not a stage."""
    return until is not None and not until.isalpha()


def goal_of(budget: str | None, until: str | None) -> Goal:
    """A goal as it is written on the command line: "90s", "3min", "1h"; "0.5deg".

    Raises:
        SessionError: they are written otherwise.
    """
    goal = Goal()
    if budget is not None:
        unit = next((unit for unit in UNITS if budget.endswith(unit)), "")
        goal = Goal(
            _positive(budget.removesuffix(unit), f"--budget {budget}: write it as 90s, 3min or 1h")
            * UNITS.get(unit, 1.0)
        )
    if until is not None:
        goal = Goal(
            goal.budget_s,
            _positive(
                until.removesuffix("deg"),
                f"--until {until}: where a budget or an error chooses the preset, write it as 0.5deg",
            ),
        )
    return goal


def _positive(text: str, otherwise: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise SessionError(otherwise) from None
    if not 0 < value < math.inf:
        raise SessionError(otherwise)
    return value


def climb(
    presets: Sequence[str],
    goal: Goal,
    reach: Callable[[str], Rung],
    predict: Callable[[str], float],
    tell: Callable[[str], None],
    now: Callable[[], float] = time.monotonic,
) -> Rung:
    """The rung to stay on.

    Args:
        reach: runs a preset.
        predict: seconds that a preset will take, NaN where nobody knows.
        tell: is given a sentence for every choice.
    """
    begun, first = now(), 0
    if math.isfinite(goal.budget_s) and not goal.error_deg:
        # What a climb spends on the way is lost.
        first = max((k for k, preset in enumerate(presets) if predict(preset) <= goal.budget_s), default=0)
    rung = reach(presets[first])
    tell(_told(rung))
    for above in presets[first + 1 :]:
        if rung.stderr_normal_deg <= goal.error_deg:
            tell(f"{rung.preset} stays: the error asked for, {goal.error_deg:g} deg, is reached")
            break
        seconds, left = predict(above), goal.budget_s - (now() - begun)
        if seconds > left:
            tell(
                f"{rung.preset} stays: {above} would take about {seconds:.0f} s, and {max(left, 0):.0f} s of the budget are left"
            )
            break
        higher = reach(above)
        tell(_told(higher))
        gain, stderr = gained(rung.validation_error, higher.validation_error)
        if gain <= stderr:
            tell(
                f"{rung.preset} stays: {above} renders the validation views better by {100 * gain:.2f} %, which is"
                f" no more than its standard error of {100 * stderr:.2f} %"
            )
            break
        tell(halving(rung, higher))
        rung = higher
    return rung


def gained(before: Float[np.ndarray, " k"], after: Float[np.ndarray, " k"]) -> tuple[float, float]:
    """By how much the views' errors fell in the mean, and its standard error; infinite with fewer than two views."""
    fell = before - after
    if len(fell) < 2:
        return 0.0, math.inf
    return float(fell.mean()), float(fell.std(ddof=1) / math.sqrt(len(fell)))


def halving(lower: Rung, higher: Rung) -> str:
    """What time would halve the standard error, by the power law through two rungs."""
    error = math.log(lower.stderr_normal_deg / higher.stderr_normal_deg)
    longer = math.log(max(higher.seconds, 1e-3) / max(lower.seconds, 1e-3))
    if longer <= 0 or error / longer < LEAST_EXPONENT:
        return "more time would not halve the error: more views would, about four times as many"
    return f"about {higher.seconds * 2 ** (longer / error):.0f} s of stage surface would halve the error"


def _told(rung: Rung) -> str:
    error = np.median(rung.validation_error) if len(rung.validation_error) else math.nan
    return (
        f"{rung.preset}: surface in {rung.seconds:.0f} s, normals within {rung.stderr_normal_deg:.2f} deg by their standard"
        f" error, validation views {100 * error:.1f} % off"
    )
