"""The charts of switches and of growth: the numbers beside them, the same bytes each time, nothing compared across runs."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from app.bench import ablation_chart, scaling_chart
from app.bench.drawing import short
from app.bench.scaling import Point
from app.bench.scores import Scored

USUAL = Scored(
    "mean", "standard", "ours", "ours", {"normal": 2.0, "albedo": 30.0, "roughness": 0.05}, 8.0, False, 100, ("now",)
)  # fmt: skip
WORSE = replace(
    USUAL, method="no_bounce", title="w/o bounce", values={"normal": 3.0, "albedo": 20.0, "roughness": 0.07},
    seconds=6.0,
)  # fmt: skip
EARLIER = replace(WORSE, method="no_ask", title="w/o asking", runs=("before",), seconds=5.0)
SWITCHES = (USUAL, WORSE, EARLIER)
GROWTH = [("room-ball", Point("pixels", n, 0.1 * n, 10**9, 1000 * n**2, "now")) for n in (100, 200, 400)]
GROWTH += [
    ("room-ball", Point("views", n, 5.0, 10**9, 7000, run)) for n, run in ((10, "now"), (20, "before"))
]


def lines(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_the_ablations_numbers_say_what_a_switch_is_worth() -> None:
    one = {line["method"]: line for line in lines(ablation_chart.table(SWITCHES))}
    assert float(one["no_bounce"]["normal_deg_more"]) == pytest.approx(1.0)
    assert float(one["no_bounce"]["albedo_rmse"]) == pytest.approx(0.1)
    assert float(one["no_bounce"]["seconds_more"]) == pytest.approx(-2.0)
    assert one["no_ask"]["seconds_more"] == "nan"  # of another run


def test_the_growths_numbers_hold_the_fitted_powers_of_one_run() -> None:
    one = {(line["axis"], line["value"]): line for line in lines(scaling_chart.table(GROWTH))}
    assert float(one["pixels", "200"]["seconds_exponent"]) == pytest.approx(1)
    assert float(one["pixels", "200"]["solve_bytes_exponent"]) == pytest.approx(2)
    assert one["views", "10"]["seconds_exponent"] == "nan"


@pytest.mark.parametrize("stem", ["ablation", "scaling"])
def test_a_chart_is_drawn_alike_each_time(tmp_path: Path, stem: str) -> None:
    def write(folder: Path) -> list[Path]:
        if stem == "ablation":
            return ablation_chart.write(SWITCHES, folder, "a caption")
        return scaling_chart.write(GROWTH, "now", folder, "a caption")

    first, second = write(tmp_path / "a"), write(tmp_path / "b")
    assert [p.name for p in first] == [f"{stem}.png", f"{stem}.svg", f"{stem}.csv"]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    with Image.open(first[0]) as picture:
        assert picture.width == 2160
    assert "a caption" in first[1].read_text()


def test_every_switch_has_a_dot_and_seconds_of_another_run_are_hollow() -> None:
    figure = ablation_chart.draw(SWITCHES, "")
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["w/o bounce", "w/o asking"]
    fills = {line.get_label(): line.get_markerfacecolor() for line in figure.axes[-1].get_lines()}
    assert fills["of an earlier run"] == "white"
    assert fills["this switch off"] != "white"
    (dots,) = [line for line in figure.axes[0].get_lines() if line.get_label() == "this switch off"]
    assert list(dots.get_xdata()) == [3.0, 3.0]


def test_the_line_goes_through_what_it_is_fitted_to() -> None:
    axes = scaling_chart.draw(GROWTH, "now", "").axes[1]
    line, dots = axes.get_lines()
    assert list(line.get_xdata()) == [100, 400]
    assert list(line.get_ydata()) == pytest.approx([10.0, 40.0])
    assert list(dots.get_ydata()) == pytest.approx([10.0, 20.0, 40.0])


def test_a_tick_is_named_shortly() -> None:
    assert [short(x) for x in (0.005, 2.0, 1e3, 2e5, 1e6)] == ["0.005", "2", "1k", "200k", "1M"]
