"""Holds a measurement against a committed baseline: accuracies, and times as ratios between rows of one run.

Seconds are the machine's and are never compared; `Metric.tolerance` of the baseline says how much worse is allowed.
"""

import math
from dataclasses import replace

from app.bench.record import BenchError, Metric, Record

RATIO = "x"
"""Unit of a ratio of times."""


def check(now: Record, baseline: Record) -> tuple[list[str], list[str]]:
    """(what got worse, what could not be compared), a line each; nothing got worse if the first is empty.

    A ratio is not there where its two times were measured in different runs; that is said, and is no fault.

    Raises:
        BenchError: the baseline is of another measurement.
    """
    for name in ("command", "size", "inputs", "seed"):
        mine, theirs = getattr(now, name), getattr(baseline, name)
        if mine != theirs:
            raise BenchError(
                f"the baseline's {name} is {theirs!r}, this measurement's {mine!r};"
                " measure the same, or make another baseline with --write-baseline"
            )
    found = {metric.key: metric for metric in now.metrics}
    worse, skipped = [], []
    for asked in baseline.metrics:
        if asked.tolerance is None or math.isnan(asked.value):
            continue
        if asked.key in found:
            value = found[asked.key].value
            if not _good_enough(value, asked):
                worse.append(
                    f"{asked.key}: {value:.4g} {asked.unit}, was {asked.value:.4g}"
                    f" ({asked.direction} is better, tolerance {asked.tolerance:.3g})"
                )
        elif asked.unit == RATIO:
            skipped.append(f"{asked.key}: its times are of different runs; --fresh measures both again")
        else:
            worse.append(f"{asked.key}: not measured, was {asked.value:.4g} {asked.unit}")
    return worse, skipped


def baseline_of(record: Record) -> Record:
    """What is worth keeping of a measurement: the metrics that a gate compares."""
    return replace(record, metrics=tuple(m for m in record.metrics if m.tolerance is not None), rows={})


def _good_enough(value: float, asked: Metric) -> bool:
    """NaN is not."""
    assert asked.tolerance is not None
    if asked.direction == "lower":
        return value <= asked.value + asked.tolerance
    return value >= asked.value - asked.tolerance
