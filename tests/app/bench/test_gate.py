"""The gate is red on worse, silent on better and on seconds, and refuses what cannot be compared."""

import math
from dataclasses import replace

import pytest

from app.bench import gate
from app.bench.record import BenchError, Metric, Record

NORMAL = Metric("mean/standard/normal", 3.0, "deg", "lower", 0.1)
ALBEDO = Metric("mean/standard/albedo", 30.0, "dB", "higher", 0.2)
SECONDS = Metric("mean/standard/seconds", 10.0, "s", "lower")
RATIO = Metric("mean/fine/seconds_to_standard", 3.0, "x", "lower", 3.0)


def record(*metrics: Metric, **changes: object) -> Record:
    plain = Record("table", "quick", "given", 0, {}, {}, tuple(metrics))
    return replace(plain, **changes)


BASELINE = record(NORMAL, ALBEDO, SECONDS, RATIO)


def test_the_same_measurement_passes():
    assert gate.check(BASELINE, BASELINE) == ([], [])


@pytest.mark.parametrize(
    ("metric", "value", "red"),
    [
        (NORMAL, 3.09, False),
        (NORMAL, 3.11, True),
        (NORMAL, 0.5, False),
        (NORMAL, math.nan, True),
        (ALBEDO, 29.81, False),
        (ALBEDO, 29.79, True),
        (ALBEDO, 45.0, False),
        (SECONDS, 1e6, False),
        (RATIO, 5.9, False),
        (RATIO, 6.1, True),
    ],
)
def test_worse_than_the_tolerance_is_red_and_better_is_not(metric, value, red):
    now = record(*(replace(m, value=value) if m is metric else m for m in BASELINE.metrics))
    worse, skipped = gate.check(now, BASELINE)
    assert [line.partition(":")[0] for line in worse] == ([metric.key] if red else [])
    assert not skipped


def test_an_accuracy_that_is_no_longer_measured_is_red_and_a_missing_ratio_is_said():
    worse, skipped = gate.check(record(ALBEDO), BASELINE)
    assert len(worse) == 1
    assert worse[0].startswith("mean/standard/normal: not measured")
    assert skipped[0].startswith("mean/fine/seconds_to_standard")


def test_new_metrics_do_not_redden():
    more = record(*BASELINE.metrics, replace(NORMAL, key="mean/new/normal", value=80.0))
    assert gate.check(more, BASELINE) == ([], [])


@pytest.mark.parametrize("change", [{"command": "views"}, {"size": "small"}, {"seed": 1}, {"inputs": "else"}])
def test_a_baseline_of_another_measurement_is_refused(change):
    with pytest.raises(BenchError, match=f"baseline's {next(iter(change))} "):
        gate.check(BASELINE, replace(BASELINE, **change))


def test_a_baseline_keeps_what_the_gate_compares():
    assert gate.baseline_of(BASELINE).metrics == (NORMAL, ALBEDO, RATIO)
