"""Ours beside the reference: ratios of one run, every error, and the cheapest setting that is as good."""

from dataclasses import replace

from app.bench import beside
from app.bench.scores import Scored


def point(method: str, normal: float, seconds: float, kind: str = "reference", **changes: object) -> Scored:
    values = {"normal": normal, "albedo": 30.0 - normal, "roughness": 0.01 * normal}
    title = f"ours, {method}" if kind == "ours" else method
    return replace(Scored("s", method, title, kind, values, seconds, False, 9, ("now",)), **changes)


USUAL, SLOW = point("standard", 1.0, 10.0, "ours"), point("dear", 2.0, 20_000.0)


def test_a_setting_as_good_as_ours_is_found_and_the_cheapest_counts():
    rivals = [point("good", 0.9, 5000.0), point("cheap", 1.0, 400.0), point("poor", 1.5, 20.0)]
    lines = beside.told([USUAL, SLOW, *rivals], "dear")
    assert lines[0] == "ours, standard, beside dear: 2,000 times faster; better in each error"
    assert (
        lines[-1]
        == "the cheapest setting that reaches our normals is cheap: ours, standard is 40 times faster"
    )
    assert "no setting of the reference" in beside.told([USUAL, SLOW], "dear")[-1]


def test_a_few_times_are_not_rounded_to_none():
    quick = replace(SLOW, seconds=4.9)
    assert "0.49 times faster" in beside.told([USUAL, quick], "dear")[0]


def test_times_of_different_runs_are_not_divided():
    assert "times of different runs" in beside.told([USUAL, replace(SLOW, runs=("before",))], "dear")[0]


def test_one_worse_error_is_enough_not_to_dominate():
    assert beside.dominates([USUAL, SLOW], "dear")
    darker = replace(USUAL, values=dict(USUAL.values) | {"albedo": 20.0})
    assert not beside.dominates([darker, SLOW], "dear")
    assert "worse in albedo" in beside.told([darker, SLOW], "dear")[0]
    assert not beside.dominates([replace(USUAL, seconds=30_000.0), SLOW], "dear")
    unknown = replace(SLOW, values=dict(SLOW.values) | {"normal": float("nan")})
    assert not beside.dominates([USUAL, unknown], "dear")
