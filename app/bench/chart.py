"""The chart of error against seconds: one panel each for normal, albedo and roughness, with the Pareto front.

Log-log; the albedo's PSNR is drawn as the root mean square error that it says, so that down is better in every
panel. Hollow points are extrapolated; maps computed elsewhere are lines, as their seconds are not known. Kinds are
told apart by colour and by shape.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.bench import drawing
from app.bench.front import pareto
from app.bench.scores import Scored, albedo_rmse

HEIGHT_IN = 3.0
KINDS = {
    "ours": ("ours", drawing.BLUE, "o"),
    "reference": ("reference", drawing.VERMILION, "s"),
    "baseline": ("baselines", drawing.GREEN, "^"),
}
SIDES = (
    ("left", "bottom", 3, 2), ("right", "top", -3, -3), ("left", "top", 3, -3), ("right", "bottom", -3, 2),
    ("center", "bottom", 0, 8), ("center", "top", 0, -8), ("left", "bottom", 6, 10), ("left", "top", 6, -10),
    ("right", "bottom", -6, 10), ("right", "top", -6, -10),
)  # fmt: skip
"""Where a name may stand beside its point: alignments, and offsets in points."""


@dataclass(frozen=True, slots=True)
class Panel:
    """One error of a row, as drawn."""

    key: str
    title: str
    error: Callable[[Scored], float]


PANELS = (
    Panel("normal_deg", "Normal: mean angular error (deg)", lambda one: one.values["normal"]),
    Panel("albedo_rmse", "Albedo: RMS error", lambda one: albedo_rmse(one.values["albedo"])),
    Panel("roughness_mae", "Roughness: mean absolute error", lambda one: one.values["roughness"]),
)


def table(points: Sequence[Scored]) -> str:
    """The numbers behind the chart as CSV; `front` lists the panels on whose Pareto front the point lies."""
    fronts = {panel.key: set(front(points, panel)) for panel in PANELS}
    heads = [panel.key for panel in PANELS]
    lines: list[Sequence[object]] = [
        ["method", "title", "kind", "seconds", *heads, "albedo_psnr_db", "extrapolated", "run", "front"]
    ]
    for i, one in enumerate(points):
        on = " ".join(panel.key for panel in PANELS if i in fronts[panel.key])
        errors = [f"{panel.error(one):.6g}" for panel in PANELS]
        lines.append([
            one.method, one.title, one.kind, f"{one.seconds:.6g}", *errors, f"{one.values['albedo']:.6g}",
            "yes" if one.extrapolated else "no", one.runs[0] if len(set(one.runs)) == 1 else "several", on,
        ])  # fmt: skip
    return drawing.csv_of(lines)


def front(points: Sequence[Scored], panel: Panel) -> list[int]:
    """Indices of the points that no other beats in this panel."""
    return pareto([one.seconds for one in points], [panel.error(one) for one in points])


def write(points: Sequence[Scored], folder: Path, caption: str) -> list[Path]:
    """chart.png, chart.svg and chart.csv in `folder`.

    Raises:
        BenchError: the disk refuses.
    """
    return drawing.write(draw(points, caption), folder, "chart", table(points))


def draw(points: Sequence[Scored], caption: str):
    """A matplotlib figure of the three panels, a legend and a caption under them."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(drawing.WIDTH_IN, HEIGHT_IN), dpi=drawing.DPI)
    grid = figure.subplots(1, len(PANELS))
    figure.subplots_adjust(left=0.065, right=0.99, top=0.91, bottom=0.3, wspace=0.28)
    for axes, panel in zip(grid, PANELS, strict=True):
        _panel(axes, panel, points)
        _name(axes, panel, points)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="lower center",
        ncols=len(labels),
        fontsize=7,
        frameon=False,
        bbox_to_anchor=(0.5, 0.055),
    )
    figure.text(0.5, 0.02, caption, ha="center", fontsize=5.5, color="0.35")
    return figure


def _panel(axes, panel: Panel, points: Sequence[Scored]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    best = front(points, panel)
    x, y = [points[i].seconds for i in best], [panel.error(points[i]) for i in best]
    axes.plot(x, y, color="0.6", lw=1.0, drawstyle="steps-post", zorder=1, label="Pareto front")
    for kind, (name, colour, mark) in KINDS.items():
        for hollow in (False, True):
            these = [one for one in points if one.kind == kind and one.extrapolated == hollow]
            if these:
                axes.plot(
                    [one.seconds for one in these], [panel.error(one) for one in these], mark, color=colour, ms=4.5,
                    mfc="white" if hollow else colour, mew=1.0, ls="none", zorder=3,
                    label=f"{name}, extrapolated" if hollow else name,
                )  # fmt: skip
    for one in points:
        if one.kind == "maps" and not math.isnan(panel.error(one)):
            axes.axhline(panel.error(one), color=drawing.PURPLE, lw=1.0, ls=":", zorder=2, label=one.title)
    axes.margins(x=0.18, y=0.15)
    axes.set_title(panel.title, fontsize=7.5)
    axes.set_xlabel("seconds", fontsize=7, labelpad=1)
    drawing.number(axes.xaxis, axes.get_xlim())
    drawing.number(axes.yaxis, axes.get_ylim())
    drawing.plain(axes)


def _name(axes, panel: Panel, points: Sequence[Scored]) -> None:
    """Name the points of the front and the published reference, where each name covers the fewest others."""
    from matplotlib.transforms import Bbox

    drawn = [(one.seconds, panel.error(one)) for one in points if math.isfinite(one.seconds)]
    marks = axes.transData.transform([at for at in drawn if math.isfinite(at[1])])
    around = 3 * drawing.DPI / 72  # a mark's half width
    taken = [Bbox.from_extents(x - around, y - around, x + around, y + around) for x, y in marks]
    best = set(front(points, panel))
    for i, one in enumerate(points):
        if i not in best and one.title != "reference as published":
            continue
        name = one.title.removeprefix("ours, ").removeprefix("reference ").removeprefix("at ")
        text = axes.annotate(
            name, (one.seconds, panel.error(one)), (0, 0), textcoords="offset points", fontsize=5.5, color="0.25",
        )  # fmt: skip
        x, y = axes.transData.transform((one.seconds, panel.error(one)))
        taken.append(_stand(text, axes.bbox, taken, [box for box in taken if not box.contains(x, y)]))


def _stand(text, within, taken, others):
    """Put a name on the side where it covers the fewest of the boxes `taken` and stays `within`; its own box.

    Of sides alike one away from the `others`, or the name seems to be another point's.
    """

    def put(side: tuple[str, str, int, int]):
        across, up, x, y = side
        text.set(ha=across, va=up)
        text.set_position((x, y))
        return text.get_window_extent()

    def cost(side: tuple[str, str, int, int]) -> tuple[int, int]:
        box = put(side)
        outside = not all(within.contains(*corner) for corner in box.corners())
        return box.count_overlaps(taken) + outside, box.padded(2 * drawing.DPI / 72).count_overlaps(others)

    return put(min(SIDES, key=cost))
