"""The chart of our switches: what each costs or brings when it is off, in error and in seconds.

A row a switch; the line is ours with all of them on, the dot is ours with that one off, so that a dot to the right of
the line says what the switch is worth. The albedo's PSNR is drawn as the root mean square error that it says.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.bench import drawing
from app.bench.chart import PANELS
from app.bench.scores import Scored

ROW_IN, AROUND_IN = 0.17, 0.9
"""Height of a row, and of what stands above and below all of them."""
WIDE = 4.0
"""Ratio of the largest to the smallest number from which on a panel is logarithmic."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One number of a row, as drawn."""

    key: str
    title: str
    value: Callable[[Scored], float]
    decimals: int


DRAWN = (
    *(Panel(p.key, p.title.replace(": ", "\n"), p.error, d) for p, d in zip(PANELS, (2, 4, 4), strict=True)),
    Panel("seconds", "Time\nseconds", lambda one: one.seconds, 1),
)


def table(points: Sequence[Scored]) -> str:
    """The numbers behind the chart as CSV, each with what it has more than ours with every switch on."""
    usual = points[0]
    keys = [panel.key for panel in DRAWN]
    lines: list[Sequence[object]] = [
        ["method", "title", *keys, *(f"{key}_more" for key in keys), "albedo_psnr_db", "run"]
    ]
    for one in points:
        values = [panel.value(one) for panel in DRAWN]
        more = [panel.value(one) - panel.value(usual) for panel in DRAWN]
        if one.runs != usual.runs:
            more[-1] = math.nan  # seconds of different runs do not compare
        numbers = [f"{value:.6g}" for value in (*values, *more, one.values["albedo"])]
        lines.append([one.method, one.title, *numbers, one.runs[0] if len(set(one.runs)) == 1 else "several"])
    return drawing.csv_of(lines)


def write(points: Sequence[Scored], folder: Path, caption: str) -> list[Path]:
    """ablation.png, ablation.svg and ablation.csv in `folder`.

    Raises:
        BenchError: the disk refuses.
    """
    return drawing.write(draw(points, caption), folder, "ablation", table(points))


def draw(points: Sequence[Scored], caption: str):
    """A matplotlib figure: switches as rows, four panels, a legend and a caption under them."""
    from matplotlib.figure import Figure

    usual, *off = points
    height = ROW_IN * len(off) + AROUND_IN
    figure = Figure(figsize=(drawing.WIDTH_IN, height), dpi=drawing.DPI)
    grid = figure.subplots(1, len(DRAWN), sharey=True)
    figure.subplots_adjust(left=0.325, right=0.985, top=1 - 0.4 / height, bottom=0.5 / height, wspace=0.12)
    for axes, panel in zip(grid, DRAWN, strict=True):
        _panel(axes, panel, usual, off)
    grid[0].set_yticks(range(len(off)), [_name(one) for one in off])
    grid[0].set_ylim(len(off) - 0.4, -0.6)
    handles, labels = grid[-1].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=len(labels), fontsize=6.5, frameon=False,
        bbox_to_anchor=(0.5, 0.11 / height),
    )  # fmt: skip
    figure.text(0.5, 0.05 / height, caption, ha="center", fontsize=5.5, color="0.35")
    return figure


def _panel(axes, panel: Panel, usual: Scored, off: Sequence[Scored]) -> None:
    base = panel.value(usual)
    values = [panel.value(one) for one in off]
    known = [value for value in (base, *values) if math.isfinite(value) and value > 0]
    if max(known) / min(known) > WIDE:
        axes.set_xscale("log")
    axes.axvline(base, color=drawing.BLUE, lw=1.0, zorder=1, label="every switch on")
    for place, value in enumerate(values):
        axes.plot([base, value], [place, place], color="0.75", lw=1.0, zorder=2)
    for same in (True, False):
        # Seconds of another run than ours are no comparison: hollow.
        here = [k for k, one in enumerate(off) if (panel.key != "seconds" or one.runs == usual.runs) == same]
        if here:
            axes.plot(
                [values[k] for k in here], here, "o", color=drawing.VERMILION, ms=4,
                mfc=drawing.VERMILION if same else "white", mew=1.0, ls="none", zorder=3,
                label="this switch off" if same else "of an earlier run",
            )  # fmt: skip
    axes.margins(x=0.12)
    axes.set_title(panel.title, fontsize=7, linespacing=1.2, pad=10)
    axes.annotate(
        f"{base:.{panel.decimals}f}", (base, 1), (0, 1.5), xycoords=("data", "axes fraction"),
        textcoords="offset points", ha="center", va="bottom", fontsize=5.5, color=drawing.BLUE,
    )  # fmt: skip
    drawing.plain(axes)
    axes.tick_params(axis="y", length=0, labelsize=5.8)
    if axes.get_xscale() == "log":
        drawing.number(axes.xaxis, axes.get_xlim())
    else:
        axes.locator_params(axis="x", nbins=3)
        axes.xaxis.set_major_formatter("{x:g}")


def _name(one: Scored) -> str:
    return one.title.removeprefix("ours, ")
