"""The heat map of stressed runs: ways of going wrong as rows, steps as columns.

Colour is the mean over the sets of the normals' error over that of the clean set; a letter says what was told.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from app.bench import drawing
from app.bench.stress.dials import DIALS
from app.bench.stress.measure import CLEAN, Stressed
from app.bench.stress.scores import cell, mean_ratio

MOST = 8.0  # times the clean error that the darkest colour stands for
ROW_IN, AROUND_IN = 0.24, 1.0


def write(runs: Sequence[Stressed], folder: Path, caption: str) -> list[Path]:
    """stress.png, stress.svg and stress.csv in `folder`.

    Raises:
        BenchError: the disk refuses.
    """
    return drawing.write(draw(runs, caption), folder, "stress", rows(runs))


def rows(runs: Sequence[Stressed]) -> str:
    """Every run as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([field for field in Stressed.__slots__ if field != "seconds"])
    for one in runs:
        writer.writerow([value for field, value in asdict(one).items() if field != "seconds"])
    return text.getvalue()


def draw(runs: Sequence[Stressed], caption: str):
    """A matplotlib figure."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    clean = {one.set: one for one in runs if one.dial == CLEAN}
    dials = list(dict.fromkeys(one.dial for one in runs if one.dial != CLEAN))
    steps = sorted({one.step for one in runs if one.dial != CLEAN})
    height = ROW_IN * len(dials) + AROUND_IN
    figure = Figure(figsize=(drawing.WIDTH_IN, height), dpi=drawing.DPI)
    axes = figure.add_axes((0.38, 0.45 / height, 0.5, ROW_IN * len(dials) / height))
    ratio = np.full((len(dials), len(steps)), np.nan)
    for row, dial in enumerate(dials):
        for column, step in enumerate(steps):
            here = [one for one in runs if (one.dial, one.step) == (dial, step)]
            ratio[row, column] = mean_ratio(here, clean)
            text = cell(here, clean)
            dark = ratio[row, column] > 3
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


def _named(dial: str, steps: Sequence[int]) -> str:
    amounts = [f"{DIALS[dial].amounts[step - 1]:g}" for step in steps]
    return f"{DIALS[dial].title}: {', '.join(amounts)}"
