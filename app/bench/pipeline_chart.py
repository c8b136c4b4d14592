"""The chart of a pipeline's seconds: a panel a size of photographs, a bar a way, a colour a stage."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

from app.bench import drawing
from app.bench.pipeline import Way

ROW_IN, AROUND_IN = 0.2, 0.5
"""Height of a bar, and of what stands around those of a panel."""
FOOT_IN = 0.5
COLOURS = {
    "hdr": drawing.SKY, "segment": drawing.PURPLE, "poses": drawing.BLUE, "light": drawing.ORANGE,
    "surface": drawing.VERMILION, "export": drawing.GREEN, "features": "0.35", "matching": "0.5", "mapping": "0.65",
}  # fmt: skip
LEAST_LABELLED = 0.06  # of the longest bar


def table(ways: Sequence[Way]) -> str:
    """The numbers behind the chart as CSV."""
    lines: list[Sequence[object]] = [
        ["photographs", "way", "part", "seconds", "starting", "core_seconds", "peak_bytes"]
    ]
    for way in ways:
        for part in way.parts:
            seconds = [f"{x:.6g}" for x in (part.seconds, part.starting, part.core_seconds)]
            lines.append([way.size, way.name, part.name, *seconds, part.peak_bytes])
    return drawing.csv_of(lines)


def write(ways: Sequence[Way], folder: Path, caption: str) -> list[Path]:
    """pipeline.png, pipeline.svg and pipeline.csv in `folder`.

    Raises:
        BenchError: the disk refuses.
    """
    return drawing.write(draw(ways, caption), folder, "pipeline", table(ways))


def draw(ways: Sequence[Way], caption: str):
    """A matplotlib figure: seconds to the right, stages stacked in their order."""
    from matplotlib.figure import Figure

    sizes = {
        name: [way for way in ways if way.size == name] for name in dict.fromkeys(way.size for way in ways)
    }
    heights = [ROW_IN * len(here) + AROUND_IN for here in sizes.values()]
    height = sum(heights) + FOOT_IN
    figure = Figure(figsize=(drawing.WIDTH_IN, height), dpi=drawing.DPI)
    top = height
    for name, here in sizes.items():
        inches = ROW_IN * len(here)
        axes = figure.add_axes((0.15, (top - 0.2 - inches) / height, 0.81, inches / height))
        _panel(axes, here)
        axes.set_title(name, fontsize=7, loc="left", pad=2)
        top -= inches + AROUND_IN
    figure.axes[-1].set_xlabel("seconds", fontsize=7, labelpad=1)
    used = {part.name for way in ways for part in way.parts}
    handles = [_patch(name) for name in COLOURS if name in used]
    figure.legend(
        handles=handles, loc="lower center", ncols=len(handles), fontsize=6.5, frameon=False,
        bbox_to_anchor=(0.5, 0.13 / height), handlelength=1.0, columnspacing=1.2,
    )  # fmt: skip
    figure.text(0.5, 0.05 / height, caption, ha="center", fontsize=5.5, color="0.35")
    return figure


def _panel(axes, ways: Sequence[Way]) -> None:
    longest = max(way.seconds for way in ways)
    for row, way in enumerate(ways):
        left = 0.0
        for part in way.parts:
            axes.barh(row, part.seconds, left=left, height=0.7, color=COLOURS[part.name], lw=0)
            if part.seconds > LEAST_LABELLED * longest:
                middle = left + part.seconds / 2
                axes.text(
                    middle, row, f"{part.seconds:.0f}", ha="center", va="center", fontsize=5.5, color="white"
                )
            left += part.seconds
        axes.text(left, row, f" {left:.0f} s", ha="left", va="center", fontsize=6)
    axes.set_yticks(range(len(ways)), [textwrap.fill(way.name, 20) for way in ways])
    axes.set_ylim(len(ways) - 0.5, -0.5)
    axes.set_xlim(0, 1.08 * longest)
    drawing.plain(axes)
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)


def _patch(name: str):
    from matplotlib.patches import Patch

    return Patch(color=COLOURS[name], label=name, lw=0)
