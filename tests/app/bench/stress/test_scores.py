"""What was wrong, what was told, and how often the one without the other."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from app.bench.stress import chart, scores
from app.bench.stress.measure import CLEAN, MethodErrors, Stressed
from engine.results.quality import BAD, DOUBTFUL, GOOD


def run(
    dial: str, step: int, normal_deg: float, grade: str = GOOD, doubt: float = 0.5, on: str = "a"
) -> Stressed:
    coverage = {"in_50": 0.4, "in_68": 0.6, "in_90": 0.85, "in_95": 0.95}
    return Stressed(
        on, dial, step, 1.0, "", normal_deg, 2.0, **coverage, ause=0.1, albedo_db=30.0, roughness=0.05,
        solved=1.0, seconds=9.0, grade=grade, doubt=doubt, reason="why",
        others={"far_field": MethodErrors(4.0, normal_deg, 28.0, 0.06, 1.0, 5.0)},
    )  # fmt: skip


def refused(dial: str, step: int, on: str = "a") -> Stressed:
    return Stressed(on, dial, step, 1.0, "too few views")


RUNS = [
    run(CLEAN, 0, 2.0),
    run("focal", 4, 2.9, GOOD, 0.8),  # above the clean one, and no failure: below 3 degrees
    run("focal", 5, 5.0, DOUBTFUL, 1.5),
    run("noise", 4, 4.5, GOOD, 0.7),  # silent
    run("noise", 5, 9.0, BAD, 3.0),
    refused("views", 5),
    run(CLEAN, 0, 1.0, DOUBTFUL, 1.1, "b"),  # a false alarm
    run("focal", 4, 2.5, GOOD, 0.6, "b"),  # more than twice, but below 3 degrees
    run("focal", 5, 3.5, DOUBTFUL, 1.2, "b"),
]


def test_silent_failures_and_false_alarms_are_counted():
    found = scores.score(RUNS)
    assert (found.runs, found.failed) == (7, 5)
    assert found.silent == 1 / 7
    assert found.false_alarms == 0.5
    # Of the 4 x 4 pairs of failed and other solved runs .7 is doubted less than .8 and 1.1, and all else is right.
    assert found.auroc == pytest.approx((16 - 2) / 16)
    assert found.coverage == pytest.approx((0.4, 0.6, 0.85, 0.95))
    assert found.ause == pytest.approx(0.1)
    assert found.behind == {"far_field": 3 / 8}  # 5, 4.5 and 9 degrees, where light from afar leaves 4
    # 2.9 + 5 + 2.5 + 3.5 over four times 4, and 4.5 + 9 over twice 4; nothing was solved with fewer views.
    assert found.corruption == {"far_field": pytest.approx((13.9 / 16 + 13.5 / 8) / 2)}


def test_the_table_tells_ratios_and_marks():
    text = scores.table(RUNS)
    (focal,) = [line for line in text.splitlines() if line.startswith("| focal")]
    assert [cell.strip() for cell in focal.strip("|").split("|")][1:] == ["1.98", "3.00 w"]
    (noise,) = [line for line in text.splitlines() if line.startswith("| sensor noise")]
    assert [cell.strip() for cell in noise.strip("|").split("|")][1:] == ["2.25 S", "4.50 w"]
    (views,) = [line for line in text.splitlines() if line.startswith("| views")]
    assert [cell.strip() for cell in views.strip("|").split("|")][1:] == ["-", "R"]
    all_runs, unfitted = scores.told(RUNS).splitlines()
    assert all_runs == f"all dials: {scores.summary(scores.score(RUNS))}"
    assert "no limit is from: 6 worse captures" in unfitted  # views is one that limits are from
    assert "silent failures 14.3 %, false alarms 50.0 %, AUROC 0.875" in scores.summary(scores.score(RUNS))


def test_methods_beside_ours_are_a_column_each_with_ours_over_their_pixels():
    tile = {"reference_256_100": MethodErrors(7.0, 3.0, 20.0, 0.1, 0.01, 900.0)}
    nowhere = {
        "reference_256_100": replace(tile["reference_256_100"], normal_deg=math.nan, ours_deg=math.nan)
    }
    runs = [replace(RUNS[0], others=RUNS[0].others | tile), replace(RUNS[2], others=nowhere), RUNS[5]]
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in scores.columns(runs).splitlines()
    ]
    assert lines[0][1:] == ["far field (ours there)", "reference 256 100 (ours there)"]
    assert lines[2][1:] == ["4.00 (2.00)", "7.00 (3.00)"]
    assert lines[3][1:] == ["-", "-"]  # of the tile's pixels ours answered none there
    assert "in the mean of the dials ours has 1.28 of its error" in scores.summary(scores.score(RUNS))


def test_scores_are_gated_and_single_errors_are_not():
    metrics = {metric.key: metric for metric in scores.as_metrics(RUNS, scores.score(RUNS))}
    assert metrics["stress/silent_failures"].tolerance is not None
    assert metrics["a/focal/5/normal"].tolerance is None
    assert "a/views/5/normal" not in metrics


def test_the_heat_map_is_drawn_with_every_run_beside_it(tmp_path: Path):
    paths = chart.write(RUNS, tmp_path, "two sets")
    assert [path.name for path in paths[:3]] == ["stress.png", "stress.svg", "stress.csv"]
    assert [path.name for path in paths[3:]] == ["stress_dials.png", "stress_dials.svg"]
    table = paths[2].read_text().splitlines()
    assert len(table) == 1 + len(RUNS)
    assert dict(zip(table[0].split(","), table[1].split(","), strict=True))["far_field.normal_deg"] == "4.0"
    drawn = paths[1].read_text()
    for words in ("focal length, % off", "2.25 S", "R", "two sets"):
        assert words in drawn
