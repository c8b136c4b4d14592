"""Sweeps the light's resolution and count of Gaussians, and charts what each setting makes of the irradiance.

    python -m tests.bench.light_sweep SESSION [--widths 128,256] [--counts 4000,8000,...] [--out FOLDER]

SESSION lies in a set with its truth (of `roomlight simulate` or `roomlight bench`) and has its poses done; it is only
read. The last row is what the settings are where nobody sets them. Irradiance: `irradiance.py`.
Core-seconds are CPU time of the process, all threads. Writes light_sweep.svg, .png and .csv: two panels, the error
against core-seconds and against the number of Gaussians that are left in the end.
"""

import argparse
import csv
import io
import itertools
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from app import places
from app.bench.markdown import markdown
from engine.errors import RoomlightError
from engine.light.fitting.fit import fit
from engine.light.fitting.params import LightParams
from engine.progress import Progress
from hardware.errors import StudioError
from tests.bench import irradiance
from tests.bench.inputs import Clock, Inputs, inputs, machine, warm

COLOURS, MARKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7"), ("o", "s", "^", "D")  # Okabe and Ito 2008
USUAL = LightParams()


@dataclass(frozen=True, slots=True)
class Row:
    """One setting, and what came out."""

    width: int
    asked: int  # Gaussians at most
    count: int
    core_seconds: float
    seconds: float
    log_l1: float  # of kept-out views
    mean: float  # irradiance error, percent of the mean irradiance
    p95: float


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    widths, counts = ([int(word) for word in text.split(",")] for text in (args.widths, args.counts))
    try:
        given, lit = inputs(args.session), irradiance.beside(args.session)
    except (RoomlightError, StudioError) as fault:
        print(fault, file=sys.stderr)
        return 2
    where, rows = machine(), []
    warm(given)
    settings = [
        LightParams(max_image_width=width, max_gaussians=count)
        for width, count in itertools.product(widths, counts)
    ]
    for setting in [*settings, USUAL]:
        rows.append(measured(given, lit, setting))
        print(table(rows[-1:]).splitlines()[-1], file=sys.stderr, flush=True)
    title = args.session.resolve().parent.name
    print(f"{title}: {len(given[0].names)} views, {where}\n\n{table(rows)}")
    write(rows, args.out, f"{title.split('-studio')[0]}; the light as it was fitted")
    return 0


def measured(given: Inputs, lit: irradiance.Lit, setting: LightParams) -> Row:
    """One fit, scored."""
    clock = Clock()
    gaussians, lamps, report = fit(*given, setting, 0, Progress())
    seconds, cores = clock.read()
    found = irradiance.off(lit, gaussians, lamps)
    return Row(
        setting.max_image_width, setting.max_gaussians, report.count, cores, seconds,
        report.heldout_log_l1, found.mean, found.p95,
    )  # fmt: skip


def table(rows: Sequence[Row]) -> str:
    """A Markdown table."""
    lines = [
        ["px", "Gaussians asked", "Gaussians", "core-s", "s", "held-out log-L1",
         "irradiance off %", "p95 %"]
    ]  # fmt: skip
    for row in rows:
        lines.append([
            str(row.width), str(row.asked), str(row.count),
            f"{row.core_seconds:.1f}", f"{row.seconds:.0f}", f"{row.log_l1:.4f}", f"{row.mean:.2f}", f"{row.p95:.2f}",
        ])  # fmt: skip
    return markdown(lines)


def as_csv(rows: Sequence[Row]) -> str:
    """The numbers behind the chart."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(Row)]
    writer.writerow(names)
    writer.writerows([f"{getattr(row, name):.6g}" for name in names] for row in rows)
    return text.getvalue()


def write(rows: Sequence[Row], folder: Path, caption: str) -> None:
    """light_sweep.png, .svg and .csv; the same rows give the same bytes."""
    figure = draw(rows, caption)
    folder.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(folder / "light_sweep.png", metadata={"Software": None})
    with matplotlib.rc_context({"svg.hashsalt": "roomlight", "svg.fonttype": "none"}):
        FigureCanvasSVG(figure).print_svg(folder / "light_sweep.svg", metadata={"Date": None})
    places.keep(folder / "light_sweep.csv", as_csv(rows))


def draw(rows: Sequence[Row], caption: str) -> Figure:
    """Two panels with one line per width over the counts, and a star at what is asked where nobody sets it."""
    figure = Figure(figsize=(7.2, 3.2), dpi=300)
    grid = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.075, right=0.985, top=0.97, bottom=0.3, wspace=0.08)
    panels = (("core_seconds", "core-seconds of the fit"), ("count", "Gaussians"))
    widths = sorted({row.width for row in rows})
    for axes, (key, label) in zip(grid, panels, strict=True):
        for i, width in enumerate(widths):
            line = sorted((row for row in rows if row.width == width), key=lambda row: row.asked)
            axes.plot(
                [getattr(row, key) for row in line], [row.mean for row in line], color=COLOURS[i % len(COLOURS)],
                marker=MARKS[i % len(MARKS)], ms=3.5, lw=0.8, label=f"{width} px",
            )  # fmt: skip
        for row in rows:
            if (row.width, row.asked) == (USUAL.max_image_width, USUAL.max_gaussians):
                axes.plot(
                    [getattr(row, key)], [row.mean], "*", color="#000000", ms=9, zorder=4, ls="none", mfc="#F0E442",
                    mew=0.9, label="where nobody sets it",
                )  # fmt: skip
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
        axes.xaxis.set_major_formatter(FuncFormatter(_plain))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(label, fontsize=7, labelpad=1)
        axes.set_ylim(0, 1.12 * max(row.mean for row in rows))
        axes.tick_params(labelsize=6.5, length=2.5)
        axes.grid(True, which="major", lw=0.3, color="0.88")
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    grid[0].set_ylabel("irradiance error, % of the mean", fontsize=7)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=3, fontsize=7, frameon=False, bbox_to_anchor=(0.5, 0.05)
    )
    figure.text(0.5, 0.02, caption, ha="center", fontsize=5.5, color="0.35")
    return figure


def _plain(value: float, place: int) -> str:
    return f"{value:g}" if value < 1e3 else f"{value / 1e3:g}k"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="light_sweep", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--widths", default="128,256")
    parser.add_argument("--counts", default="2000,4000,8000,16000,32000")
    parser.add_argument("--out", type=Path, default=Path("docs/bench"))
    return parser


if __name__ == "__main__":
    sys.exit(main())
