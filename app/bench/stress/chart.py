"""Stressed runs on one page: a heat map of ways of going wrong by steps, and a chart for each way.

The map's colour is the mean over the sets of the normals' error over that of the clean set; a letter says what was told. The charts
show the errors themselves, those of other methods beside them, and where each set breaks.
"""

import math
import textwrap
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np

from app.bench import drawing
from app.bench.stress.dials import DIALS
from app.bench.stress.measure import CLEAN, MethodErrors, Stressed
from app.bench.stress.scores import cell, failed, keys, mean_ratio, name_of, was_told

MOST = 8.0  # times the clean error that the darkest colour stands for
ROW_IN, AROUND_IN = 0.24, 1.0
ACROSS, PANEL_IN = 4, 1.35
DASHES = "dotted", "dashed", "dashdot"
SET_COLOURS = drawing.BLUE, drawing.GREEN, drawing.PURPLE, drawing.ORANGE


def write(runs: Sequence[Stressed], folder: Path, caption: str) -> list[Path]:
    """stress.png, stress.svg and stress.csv in `folder`, and the same of the dials one by one.

    Raises:
        BenchError: the disk refuses.
    """
    table = rows(runs)
    return [
        *drawing.write(draw(runs, caption), folder, "stress", table),
        *drawing.write(draw_dials(runs, caption), folder, "stress_dials", table)[:2],
    ]


def rows(runs: Sequence[Stressed]) -> str:
    """Every run as CSV."""
    columns = [name for name in Stressed.__slots__ if name not in ("seconds", "others", "facts")]
    of_others = [(key, name) for key in keys(runs) for name in MethodErrors.__slots__ if name != "seconds"]
    lines: list[Sequence[object]] = [[*columns, *(f"{key}.{name}" for key, name in of_others)]]
    for one in runs:
        theirs = [getattr(one.others.get(key), name, math.nan) for key, name in of_others]
        lines.append([*(getattr(one, name) for name in columns), *theirs])
    return drawing.csv_of(lines)


def draw(runs: Sequence[Stressed], caption: str):
    """A matplotlib figure."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    clean = {one.set: one for one in runs if one.dial == CLEAN}
    dials = list(dict.fromkeys(one.dial for one in runs if one.dial != CLEAN))
    steps = sorted({one.step for one in runs if one.dial != CLEAN})
    height = ROW_IN * len(dials) + AROUND_IN
    figure = Figure(figsize=(drawing.WIDTH_IN, height), dpi=drawing.DPI)
    axes = figure.add_axes((0.46, 0.45 / height, 0.42, ROW_IN * len(dials) / height))
    ratio = np.full((len(dials), len(steps)), np.nan)
    for row, dial in enumerate(dials):
        for column, step in enumerate(steps):
            here = [one for one in runs if (one.dial, one.step) == (dial, step)]
            ratio[row, column] = mean_ratio(here, clean)
            text = cell(here, clean)
            dark = ratio[row, column] > 2.4
            axes.text(
                column, row, text, ha="center", va="center", fontsize=6.5, color="white" if dark else "0.15"
            )
    norm = LogNorm(1, MOST)
    picture = axes.imshow(np.clip(ratio, 1, MOST), cmap="magma_r", norm=norm, aspect="auto")
    axes.set_xticks(range(len(steps)), [f"step {step}" for step in steps])
    axes.set_yticks(range(len(dials)), [_named(dial, steps) for dial in dials])
    axes.tick_params(labelsize=6.5, length=0, labeltop=True, labelbottom=False)
    bar = figure.colorbar(
        picture, cax=figure.add_axes((0.9, 0.45 / height, 0.015, ROW_IN * len(dials) / height))
    )
    drawing.number(bar.ax.yaxis, (1, MOST))
    bar.ax.tick_params(labelsize=6.5)
    bar.set_label("error of normals over the clean set's", fontsize=6.5)
    figure.text(
        0.5, 0.22 / height, "refused: R    warned: w    wrong and not warned: S", ha="center", fontsize=6.5
    )
    figure.text(0.5, 0.06 / height, caption, ha="center", fontsize=5.5, color="0.35")
    return figure


def draw_dials(runs: Sequence[Stressed], caption: str):
    """A matplotlib figure: for every dial the mean error of the normals against how far it is turned."""
    from matplotlib.figure import Figure

    clean = {one.set: one for one in runs if one.dial == CLEAN}
    dials = list(dict.fromkeys(one.dial for one in runs if one.dial != CLEAN))
    down, styles = max(math.ceil(len(dials) / ACROSS), 1), dict(zip(keys(runs), cycle(DASHES), strict=False))
    figure = Figure(figsize=(drawing.WIDTH_IN, PANEL_IN * down + 0.4), dpi=drawing.DPI, layout="constrained")
    panels = figure.subplots(down, ACROSS, squeeze=False).ravel()
    for dial, axes in zip(dials, panels, strict=False):
        for colour, first in zip(SET_COLOURS * len(clean), clean.values(), strict=False):
            turned = [one for one in runs if (one.set, one.dial) == (first.set, dial)]
            line = [first, *sorted(turned, key=lambda one: one.step)]
            at = [one.step for one in line]
            axes.plot(at, [one.normal_deg for one in line], ".-", color=colour, lw=1, ms=4)
            for key, style in styles.items():
                theirs = [one.normal_deg * _times_ours(one, key) for one in line]
                axes.plot(at, theirs, linestyle=style, color=colour, lw=0.8)
            broken = next((one for one in line if failed(one, first)), None)
            if broken is not None:
                mark = "x" if was_told(broken) else "X"
                high = first.normal_deg if broken.refused else broken.normal_deg
                axes.plot(broken.step, high, mark, color=drawing.VERMILION, ms=6, zorder=3)
        axes.set_yscale("log")
        axes.set_ylim(0.3, 90)
        axes.set_xticks(range(6), ["", *(f"{amount:g}" for amount in DIALS[dial].amounts)])
        axes.set_title(textwrap.fill(DIALS[dial].title, 30), fontsize=6)
        drawing.plain(axes)
        drawing.number(axes.yaxis, (0.3, 90))
        axes.tick_params(labelsize=5)
    for axes in panels[len(dials) :]:
        axes.axis("off")
    figure.suptitle(
        "mean error of the normals, degrees (of others: as many times ours as over the pixels that they solved); "
        + "".join(f"{style}: {name_of(key)}; " for key, style in styles.items())
        + "\nx: breaks and is told of, filled X: breaks silently",
        fontsize=6.5,
    )
    figure.supxlabel(caption, fontsize=5.5, color="0.35")
    return figure


def _times_ours(one: Stressed, key: str) -> float:
    """A method's error over ours, of its pixels: a few of them may be harder than the rest."""
    return one.others[key].normal_deg / one.others[key].ours_deg if key in one.others else math.nan


def _named(dial: str, steps: Sequence[int]) -> str:
    amounts = [f"{DIALS[dial].amounts[step - 1]:g}" for step in steps]
    return f"{DIALS[dial].title}: {', '.join(amounts)}"
