"""What stressed runs say of the method and of its verdict.

A run failed where its normals' mean error is above twice that of the clean set and above 3 degrees; it was told where the capture
was refused or the verdict is not good; it failed silently where it failed and was not told.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from app.bench.markdown import markdown
from app.bench.record import Metric
from app.bench.stress.dials import DIALS, FITTED
from app.bench.stress.measure import CLEAN, MethodErrors, Stressed
from engine.results.quality import GOOD

TIMES, LEAST_DEG = 2.0, 3.0


@dataclass(frozen=True, slots=True)
class Score:
    """Of some runs; NaN where none is of the kind."""

    runs: int
    failed: int  # among them those that were refused
    silent: float  # share of the runs that failed and were not told
    false_alarms: float  # share of the clean sets that were told
    auroc: float  # of the verdict's doubt, for telling failed from others
    coverage: tuple[float, ...]  # mean shares within the stated 50, 68, 90, 95 %, of runs that were not told
    ause: float  # mean, of all that were solved
    # By the keys of the methods beside ours, over the pixels that both solved:
    behind: Mapping[str, float]  # share of the solved runs in which it does better
    corruption: Mapping[str, float]  # ours' error over its: `corruption`


def was_told(one: Stressed) -> bool:
    """Refused, or warned of."""
    return bool(one.refused) or one.grade != GOOD


def failed(one: Stressed, clean: Stressed) -> bool:
    """A run that was refused failed too, and was told."""
    return bool(one.refused) or one.normal_deg > max(TIMES * clean.normal_deg, LEAST_DEG)


def score(runs: Sequence[Stressed]) -> Score:
    """Of all runs, each beside the clean one of its set."""
    clean = {one.set: one for one in runs if one.dial == CLEAN}
    worse = [one for one in runs if one.dial != CLEAN]
    wrong = [failed(one, clean[one.set]) for one in worse]
    silent = [one for one, off in zip(worse, wrong, strict=True) if off and not was_told(one)]
    solved = [(one.doubt, off) for one, off in zip(worse, wrong, strict=True) if not one.refused]
    solved += [(one.doubt, False) for one in clean.values()]
    trusted = [(one.in_50, one.in_68, one.in_90, one.in_95) for one in runs if not was_told(one)]
    answered = [one for one in runs if not one.refused]
    return Score(
        len(worse),
        sum(wrong),
        len(silent) / len(worse) if worse else math.nan,
        sum(was_told(one) for one in clean.values()) / len(clean),
        auroc(solved),
        tuple(map(statistics.fmean, zip(*trusted, strict=True))) or (math.nan,) * 4,
        _mean([one.ause for one in answered]),
        {
            key: _mean([float(b.normal_deg < b.ours_deg) for b in errors_of(answered, key)])
            for key in keys(runs)
        },
        {key: corruption(worse, key) for key in keys(runs)},
    )


def keys(runs: Sequence[Stressed]) -> tuple[str, ...]:
    """Of the methods beside ours."""
    return tuple(dict.fromkeys(key for one in runs for key in one.others))


def errors_of(runs: Sequence[Stressed], key: str) -> list[MethodErrors]:
    """What one of them made of the runs, where it and ours answered some of the same pixels."""
    found = [one.others[key] for one in runs if key in one.others]
    return [one for one in found if not math.isnan(one.normal_deg)]


def corruption(runs: Sequence[Stressed], key: str) -> float:
    """Mean corruption error: ours' error over another's, each summed over a dial's runs, the mean of all dials."""
    by_dial = [
        errors_of([one for one in runs if one.dial == dial], key)
        for dial in dict.fromkeys(one.dial for one in runs)
    ]
    sums = [(sum(one.ours_deg for one in found), sum(one.normal_deg for one in found)) for found in by_dial]
    return _mean([own / other for own, other in sums if other])


def _mean(values: Sequence[float]) -> float:
    return statistics.fmean(values) if values else math.nan


def auroc(doubts: Sequence[tuple[float, bool]]) -> float:
    """The chance that a failed run is doubted more than another; NaN without one of either."""
    bad, good = ([doubt for doubt, off in doubts if off == kind] for kind in (True, False))
    if not bad or not good:
        return math.nan
    wins = sum((b > g) + 0.5 * (b == g) for b in bad for g in good)
    return wins / (len(bad) * len(good))


def table(runs: Sequence[Stressed]) -> str:
    """A dial as a row, its steps as columns: the mean over the sets of the error over the clean one's, and what was told."""
    clean = {one.set: one for one in runs if one.dial == CLEAN}
    steps = sorted({one.step for one in runs if one.dial != CLEAN})
    lines = [["normals' error over the clean set's", *(f"step {step}" for step in steps)]]
    for dial in dict.fromkeys(one.dial for one in runs if one.dial != CLEAN):
        cells = [cell([one for one in runs if (one.dial, one.step) == (dial, step)], clean) for step in steps]
        lines.append([DIALS[dial].title, *cells])
    return markdown(lines)


def cell(runs: Sequence[Stressed], clean: Mapping[str, Stressed]) -> str:
    """The mean ratio and its mark; - where nothing was run."""
    ratio, marked = mean_ratio(runs, clean), mark(runs, clean)
    if math.isnan(ratio):
        return marked or "-"
    return f"{ratio:.2f} {marked}".strip()


def mean_ratio(runs: Sequence[Stressed], clean: Mapping[str, Stressed]) -> float:
    """Of the normals' error to that of the clean set, over the sets; NaN where all were refused."""
    solved = [one.normal_deg / clean[one.set].normal_deg for one in runs if not one.refused]
    return _mean(solved)


def mark(runs: Sequence[Stressed], clean: Mapping[str, Stressed]) -> str:
    """R where all were refused, S where one was wrong and nothing was told, w where one was told of."""
    if runs and all(one.refused for one in runs):
        return "R"
    if any(failed(one, clean[one.set]) and not was_told(one) for one in runs):
        return "S"
    return "w" if any(map(was_told, runs)) else ""


def told(runs: Sequence[Stressed]) -> str:
    """What all runs say, and those of the dials that no limit is from."""
    rest = [one for one in runs if one.dial not in FITTED]
    return f"all dials: {summary(score(runs))}\nthose that no limit is from: {summary(score(rest))}"


def summary(found: Score) -> str:
    """In one sentence each."""
    return (
        f"{found.runs} worse captures, {found.failed} of them failed or were refused; silent failures"
        f" {_percent(found.silent)}, false alarms {_percent(found.false_alarms)}, AUROC {found.auroc:.3f};"
        f" within the stated 50, 68, 90, 95 % where nothing was told: {', '.join(map(_percent, found.coverage))}; AUSE"
        f" {found.ause:.3f}"
    ) + "".join(
        f"; {name_of(key)} does better in {_percent(share)}, and in the mean of the dials ours has {found.corruption[key]:.2f}"
        " of its error"
        for key, share in found.behind.items()
    )


def columns(runs: Sequence[Stressed]) -> str:
    """A dial as a row, a method as a column: its mean error, and ours over its pixels."""
    lines = [["mean error of normals, deg", *(f"{name_of(key)} (ours there)" for key in keys(runs))]]
    for dial in dict.fromkeys(one.dial for one in runs):
        here = [one for one in runs if one.dial == dial]
        cells = [_column(errors_of(here, key)) for key in keys(runs)]
        lines.append([DIALS[dial].title if dial in DIALS else dial, *cells])
    return markdown(lines)


def _column(found: Sequence[MethodErrors]) -> str:
    if not found:
        return "-"
    return f"{_mean([one.normal_deg for one in found]):.2f} ({_mean([one.ours_deg for one in found]):.2f})"


def name_of(key: str) -> str:
    return key.replace("_", " ")


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"


def as_metrics(runs: Sequence[Stressed], found: Score) -> list[Metric]:
    """Every run's error, and the scores; scores alone are gated."""
    metrics = [
        Metric(f"{one.set}/{one.dial}/{one.step}/normal", one.normal_deg, "deg", "lower")
        for one in runs
        if not one.refused
    ]
    for name, value, direction, tolerance in (
        ("silent_failures", found.silent, "lower", 0.05), ("false_alarms", found.false_alarms, "lower", 0.05),
        ("auroc", found.auroc, "higher", 0.05),
    ):  # fmt: skip
        if not math.isnan(value):
            metrics.append(Metric(f"stress/{name}", value, "share", direction, tolerance))
    return metrics
