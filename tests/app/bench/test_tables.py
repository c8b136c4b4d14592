"""Tables hold the numbers of the right rows, over the same pixels, and ratios of one run alone."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.bench import chart, scores, tables
from app.bench.information import Bound
from app.bench.markdown import markdown
from app.bench.measured import Row
from app.bench.rows import Method
from app.bench.scores import Scored
from tests.app.bench.synthetic import a_set, leaning, method


def scored(
    thing: str, key: str, normal: float, seconds: float, run: str = "now", room: str = "study"
) -> Scored:
    values = {"normal": normal, "albedo": 30.0, "roughness": 0.05}
    return Scored(f"{room}-{thing}", key, f"ours, {key}", "ours", values, seconds, False, 100, (run,))


def cells(text: str, first: str) -> list[str]:
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {first} ")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_objects_are_averaged_over_rooms_and_then_over_all():
    some = [
        scored("blob", "draft", 2.0, 1.0), scored("blob", "draft", 4.0, 1.0, room="lamps"),
        scored("duo", "draft", 9.0, 1.0), scored("blob", "fine", 1.0, 1.0),
        scored("blob", "fine", 1.0, 1.0, room="lamps"), scored("duo", "fine", 4.0, 1.0),
    ]  # fmt: skip
    text = tables.by_object(some)
    assert cells(text, "blob")[1:] == ["3.00", "30.0", "0.0500", "1.00", "30.0", "0.0500"]
    assert cells(text, "duo")[1] == "9.00"
    assert cells(text, "average")[1::3] == ["5.00", "2.00"]
    assert cells(text, "object")[1] == "ours, draft: Normal ↓"


def test_every_set_is_told_with_its_bound_and_errors_as_a_ratio_to_it():
    rows = [
        replace(scored("bust", "draft", 0.9, 1.0, room="grey-white-room"), thing="bust", bound=0.3, to_bound=3.0, blur=1.5,
                depth_within=0.25, depth_between=1.5),
        replace(scored("cow", "draft", 1.0, 1.0, room="grey-white-room"), thing="cow", bound=0.5, to_bound=2.0, blur=0.5,
                depth_within=0.75),
        scored("blob", "fine", 1.0, 1.0),
    ]  # fmt: skip
    text = tables.by_set(rows)
    assert cells(text, "grey-white-room-bust") == [
        "grey-white-room-bust",
        "0.300",
        "1.50",
        "0.90",
        "3.00",
        "0.25",
        "1.50",
        *4 * "-",
    ]
    assert cells(text, "grey-white-room-cow")[1:7] == ["0.500", "0.50", "1.00", "2.00", "0.75", "-"]
    assert cells(text, "study-blob")[1:] == ["-", "-", *4 * "-", "1.00", "-", "-", "-"]
    assert cells(tables.by_set(rows[:2]), "mean")[1:] == ["0.400", "1.00", "0.95", "2.50", "0.50", "1.50"]
    assert cells(tables.by_switch(rows[:1]), "ours, draft")[6] == "3.00"
    assert "each pixel's photographs allow" in tables.notes(rows)
    assert [one.set for one in scores.object_means(rows[:2])] == ["mean-bust", "mean-cow"]
    told = {m.key: (m.value, m.tolerance) for m in scores.as_metrics(rows)}
    assert told["grey-white-room-bust/draft/normal_to_bound"] == (3.0, None)
    assert "study-blob/fine/bound" not in told


def test_what_a_switch_is_worth_is_a_mean_over_sets_with_its_standard_error():
    usual = [scored("a", "standard", 1.0, 1.0), scored("b", "standard", 2.0, 1.0)]
    off = [scored("a", "no_steps", 1.1, 1.0), scored("b", "no_steps", 2.3, 1.0)]
    text = tables.by_switch([*usual, *off])
    assert cells(text, "ours, no_steps")[7] == "+0.20 ± 0.10"  # 0.1 and 0.3
    assert cells(text, "ours, standard")[7] == "-"
    assert cells(tables.by_switch([usual[0], off[0]]), "ours, no_steps")[7] == "+0.10"


def test_views_are_rows_in_order():
    text = tables.by_views(
        [(40, scored("blob", "standard", 3.0, 1.0)), (10, scored("blob", "standard", 8.0, 1.0))]
    )
    assert [line.split("|")[1].strip() for line in text.splitlines()[2:]] == ["10", "40"]
    assert cells(text, "10")[1] == "8.00"


def test_a_ratio_is_taken_within_one_run_only():
    usual, slow = scored("blob", "standard", 3.0, 10.0), scored("blob", "fine", 2.0, 30.0)
    assert cells(tables.by_switch([usual, slow]), "ours, fine")[-2:] == ["30.0", "3.00"]
    earlier = replace(slow, runs=("before",))
    text = tables.by_switch([earlier, usual])
    assert cells(text, "ours, fine")[-2:] == ["30.0*", "-"]
    assert "other runs than those of ours, standard" in tables.notes([earlier, usual])
    keys = [m.key for m in scores.as_metrics([usual, earlier])]
    assert not any("seconds_to" in key for key in keys)
    assert [m.value for m in scores.as_metrics([usual, slow]) if m.unit == "x"] == [3.0]


def test_yardsticks_are_gated_loosely_and_extrapolated_times_not_at_all():
    usual = scored("blob", "standard", 3.0, 10.0)
    slow = replace(scored("blob", "slow", 3.0, 90.0), kind="reference", extrapolated=True)
    allowed = {m.key: m.tolerance for m in scores.as_metrics([usual, slow])}
    assert allowed["study-blob/slow/normal"] == pytest.approx(
        scores.WANDERING * allowed["study-blob/standard/normal"]
    )
    few = {m.key: m.tolerance for m in scores.as_metrics([usual, slow], few=True)}
    assert few["study-blob 100 pixels/standard/normal"] == allowed["study-blob/slow/normal"]
    assert allowed["study-blob/slow/seconds_to_standard"] is None
    measured = replace(slow, extrapolated=False)
    assert {m.key: m.tolerance for m in scores.as_metrics([usual, measured])}[
        "study-blob/slow/seconds_to_standard"
    ]


def test_means_over_resumed_sets_are_divided_where_each_set_was_measured_by_one_run():
    usual = [scored("a", "standard", 1, 1, "r1"), scored("b", "standard", 3, 3, "r2")]
    slow = [scored("a", "fine", 1, 6, "r1"), scored("b", "fine", 1, 2, "r2")]
    assert scores.ratio(scores.mean(slow), scores.mean(usual)) == 2
    text = tables.by_switch([*usual, *slow])
    assert cells(text, "ours, fine")[-2:] == ["4.0", "2.00"]
    assert "*" not in tables.notes([*usual, *slow])
    # One of the two sets measured again in another run: no ratio, and a mark.
    mixed = [slow[0], replace(slow[1], runs=("r3",))]
    assert scores.ratio(scores.mean(mixed), scores.mean(usual)) is None
    assert cells(tables.by_switch([*usual, *mixed]), "ours, fine")[-2:] == ["4.0*", "-"]


def test_an_objects_mean_is_over_its_rooms_and_few_pixels_are_named():
    some = [
        scored("blob", "draft", 2.0, 1.0),
        scored("blob", "draft", 4.0, 1.0, room="lamps"),
        scored("duo", "draft", 9.0, 1.0),
    ]
    means = {one.set: one.values["normal"] for one in scores.object_means(some)}
    assert means == {"mean-blob": 3.0, "mean-duo": 9.0}
    metrics = scores.as_metrics(scores.object_means(some), few=True)
    assert {metric.key.partition("/")[0] for metric in metrics} == {
        "mean-blob 200 pixels",
        "mean-duo 100 pixels",
    }


def row(degrees: float, mask=None, what: Method | None = None) -> Row:
    return Row(a_set(), what or method("standard", degrees, 1.0), leaning(degrees, mask), 1.0, False, "now")


def test_scores_are_what_the_surface_is_off():
    (one,) = scores.score([row(3.0)])
    assert one.values["normal"] == pytest.approx(3.0, abs=1e-6)
    assert one.values["albedo"] == pytest.approx(-20 * -1.5228787, abs=1e-4)  # -20 log10(0.03)
    assert one.values["roughness"] == pytest.approx(0.03)
    assert scores.albedo_rmse(one.values["albedo"]) == pytest.approx(0.03)


def test_how_many_normals_are_within_what_they_state_is_told_where_they_state_anything():
    silent, telling = row(3.0), row(3.0)
    half = np.where(np.arange(telling.surface.mask.shape[1]) % 2, 2.0, 1.0) * np.ones(
        telling.surface.mask.shape
    )
    stated = replace(telling.surface, stderr_normal=np.radians(half))
    shrugging = replace(telling.surface, stderr_normal=np.full(half.shape, np.float32(np.pi)))
    without, some, any_will_do = scores.score([
        silent, replace(telling, surface=stated), replace(telling, surface=shrugging),
    ])  # fmt: skip
    assert np.isnan(any_will_do.in_band)
    within = float((half[stated.mask] == 2.0).mean())  # 3 deg lie within 1.73 x 2 deg
    assert some.in_band == pytest.approx(within)
    assert cells(tables.by_switch([some]), "ours, standard")[4] == f"{100 * within:.0f} %"
    assert cells(tables.by_switch([without]), "ours, standard")[4] == "-"
    told = [metric.key.rpartition("/")[2] for metric in scores.as_metrics([without])]
    assert "in_band" not in told


def test_every_row_is_compared_over_the_pixels_that_all_answered():
    part = leaning(0).mask.copy()
    part[: part.shape[0] // 2] = False
    whole, some = scores.score([row(1.0), row(5.0, part)])
    assert whole.pixels == some.pixels == part.sum()


def test_a_scores_bound_is_that_of_the_pixels_compared():
    true = leaning(0).mask
    left = np.arange(true.shape[1]) < true.shape[1] // 2
    known = Bound(true, np.where(left, 1.0, 3.0)[np.nonzero(true)[1]], np.full(int(true.sum()), 0.5))
    (whole,) = scores.score([replace(row(3.0), set=replace(a_set(), bound=known))])
    assert whole.to_bound == pytest.approx(whole.values["normal"] / whole.bound)
    assert 1 < whole.bound < 3
    (half,) = scores.score([replace(row(3.0, true & left), set=replace(a_set(), bound=known))])
    assert (half.bound, half.blur) == (1.0, 0.5)
    assert half.depth_within == pytest.approx(0, abs=1e-6)
    assert np.isnan(scores.score([row(3.0)])[0].bound)


def test_rows_without_a_common_pixel_are_refused():
    top = leaning(0).mask.copy()
    top[top.shape[0] // 2 :] = False
    with pytest.raises(scores.BenchError, match="no pixel"):
        scores.score([row(1.0, top), row(1.0, leaning(0).mask & ~top)])


def test_an_albedo_without_scale_is_matched_first():
    plain = method("uncalibrated", 3.0, 1.0)
    free, bound = (scores.score([row(3.0, None, replace(plain, matched=m))])[0] for m in (True, False))
    assert free.values["albedo"] > bound.values["albedo"] + 3


def test_markdown_lines_are_of_one_length():
    text = markdown([["a", "b"], ["longer", "1"], ["x", "100.25"]])
    assert len({len(line) for line in text.splitlines()}) == 1


POINTS = (
    scored("blob", "draft", 3.0, 2.0), scored("blob", "standard", 2.0, 5.0), scored("blob", "fine", 2.5, 9.0),
    replace(scored("blob", "published", 4.0, 9e3), kind="reference", extrapolated=True),
)  # fmt: skip


def test_the_charts_numbers_say_what_is_on_the_front_and_what_is_extrapolated():
    lines = {line["method"]: line for line in csv.DictReader(io.StringIO(chart.table(POINTS)))}
    assert [key for key, line in lines.items() if "normal_deg" in line["front"]] == ["draft", "standard"]
    assert lines["published"]["extrapolated"] == "yes"
    assert float(lines["draft"]["albedo_rmse"]) == pytest.approx(10**-1.5, rel=1e-5)


def test_the_chart_is_drawn_alike_each_time_with_extrapolated_points_hollow(tmp_path: Path):
    first, second = (chart.write(POINTS, tmp_path / name, "a caption") for name in "ab")
    assert [p.name for p in first] == ["chart.png", "chart.svg", "chart.csv"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    with Image.open(first[0]) as picture:
        assert picture.size == (2160, 900)
    assert "a caption" in first[1].read_text()
    marks = {
        line.get_label(): line.get_markerfacecolor() for line in chart.draw(POINTS, "").axes[0].get_lines()
    }
    assert marks["reference, extrapolated"] == "white"
    assert marks["ours"] != "white"
