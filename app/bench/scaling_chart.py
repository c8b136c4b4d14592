"""The chart of growth: seconds and memory against views, pixels, Gaussians and directions, each with its fitted power.

Log-log, so that a power is a straight line and linear growth climbs a decade per decade. Lines are fitted to the points
of one run alone; points whose seconds are of an earlier run are hollow.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.bench import drawing
from app.bench.point import AXES
from app.bench.scaling import Point, fit

HEIGHT_IN = 3.5
LOOKS = tuple(
    zip(
        (drawing.BLUE, drawing.VERMILION, drawing.GREEN, drawing.PURPLE, drawing.ORANGE, drawing.SKY), "os^Dvp",
        strict=True,
    )
)  # fmt: skip
ROWS = (("seconds", "seconds", 1.0), ("solve_bytes", "solve's memory, MB", 1e6))
"""What of a point, its name, and by what it is divided."""
NARROWEST = 3.0
"""Ratio of the ends of an axis at least: what hardly changes must not look as if it did."""


def table(points: Sequence[tuple[str, Point]]) -> str:
    """The numbers behind the chart as CSV, each with the power fitted to its set and axis."""
    powers = [f"{what}_{fact}" for what, _, _ in ROWS for fact in ("exponent", "exponent_stderr")]
    lines: list[Sequence[object]] = [
        ["set", "axis", "value", "seconds", "peak_bytes", "solve_bytes", "run", *powers]
    ]
    for name, p in points:
        here = [other for of, other in points if of == name and other.axis == p.axis]
        told = [f"{number:.4g}" for what, _, _ in ROWS for number in fit(here, what)]
        lines.append([name, p.axis, p.value, f"{p.seconds:.6g}", p.peak_bytes, p.solve_bytes, p.run, *told])
    return drawing.csv_of(lines)


def write(points: Sequence[tuple[str, Point]], run: str, folder: Path, caption: str) -> list[Path]:
    """scaling.png, scaling.svg and scaling.csv in `folder`; points come with their sets' names.

    Raises:
        BenchError: the disk refuses.
    """
    return drawing.write(draw(points, run, caption), folder, "scaling", table(points))


def draw(points: Sequence[tuple[str, Point]], run: str, caption: str):
    """A matplotlib figure: seconds above, memory below, an axis a column; a legend where there are several sets."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(drawing.WIDTH_IN, HEIGHT_IN), dpi=drawing.DPI)
    grid = figure.subplots(len(ROWS), len(AXES), sharex="col", sharey="row")
    figure.subplots_adjust(left=0.07, right=0.985, top=0.97, bottom=0.19, wspace=0.1, hspace=0.12)
    names = list(dict.fromkeys(name for name, _ in points))
    for row, (what, title, unit) in enumerate(ROWS):
        for column, axis in enumerate(AXES):
            axes = grid[row][column]
            for k, name in enumerate(names):
                here = [p for of, p in points if of == name and p.axis == axis]
                _series(axes, here, what, unit, run, name, k)
            if row + 1 == len(ROWS):
                axes.set_xlabel(axis.capitalize(), fontsize=7.5, labelpad=1)
        grid[row][0].set_ylabel(title, fontsize=7.5, labelpad=2)
    for axes in grid.ravel():
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.margins(x=0.12, y=0.25)
    for axes in grid.ravel():
        _widened(axes)
        drawing.plain(axes)
        drawing.number(axes.xaxis, axes.get_xlim())
        drawing.number(axes.yaxis, axes.get_ylim())
    if len(names) > 1:
        handles, labels = grid[0][0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="lower center", ncols=min(len(labels), 6), fontsize=6.5, frameon=False,
            bbox_to_anchor=(0.5, 0.035),
        )  # fmt: skip
    figure.text(0.5, 0.02, caption, ha="center", fontsize=5.5, color="0.35")
    return figure


def _series(axes, here: Sequence[Point], what: str, unit: float, run: str, name: str, k: int) -> None:
    """One set's points on one axis, the line fitted to them, and its power in words."""
    colour, mark = LOOKS[k % len(LOOKS)]
    power, spread = fit(here, what)
    if not math.isnan(power):
        x = np.array([p.value for p in here], float)
        y = np.array([getattr(p, what) for p in here], float) / unit
        ends = np.array([x.min(), x.max()])
        level = np.exp(np.log(y).mean() - power * np.log(x).mean())
        axes.plot(ends, level * ends**power, color=colour, lw=1.0, alpha=0.7, zorder=2)
        told = f"$\\propto n^{{{power:.2f}}}$" + ("" if math.isnan(spread) else f" (±{spread:.2f})")
        axes.annotate(
            told, (0.97, 0.04), (0, 8 * k), xycoords="axes fraction", textcoords="offset points", ha="right",
            va="bottom", fontsize=6.5, color=colour,
        )  # fmt: skip
    for now in (True, False):
        these = [p for p in here if (p.run == run or what != "seconds") == now]
        if these:
            axes.plot(
                [p.value for p in these], [getattr(p, what) / unit for p in these], mark, color=colour, ms=4.5,
                mfc=colour if now else "white", mew=1.0, ls="none", zorder=3,
                label=name if now else f"{name}, earlier run",
            )  # fmt: skip


def _widened(axes) -> None:
    """At least `NARROWEST` from bottom to top."""
    low, high = axes.get_ylim()
    if high / low < NARROWEST:
        stretch = math.sqrt(NARROWEST * low / high)
        axes.set_ylim(low / stretch, high * stretch)
