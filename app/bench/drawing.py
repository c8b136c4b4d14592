"""What the benchmark's charts have in common: their files, the look of their axes, and numbers along them.

Colours: Okabe and Ito 2008, told apart by the colour-blind.
"""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from app import places
from app.bench.record import BenchError

WIDTH_IN = 7.2  # across both columns of a paper
DPI = 300
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"


def csv_of(lines: Iterable[Sequence[object]]) -> str:
    """The numbers behind a chart, its heads first."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def write(figure, folder: Path, stem: str, table: str) -> list[Path]:
    """STEM.png, STEM.svg and, of `table`, STEM.csv in `folder`; the same figure gives the same bytes.

    Raises:
        BenchError: the disk refuses.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    paths = [folder / f"{stem}.{kind}" for kind in ("png", "svg", "csv")]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        FigureCanvasAgg(figure).print_png(paths[0], metadata={"Software": None})
        # Fixed ids and no date: a chart that says the same is the same file. Letters stay letters.
        with matplotlib.rc_context({"svg.hashsalt": "roomlight", "svg.fonttype": "none"}):
            FigureCanvasSVG(figure).print_svg(paths[1], metadata={"Date": None})
        places.keep(paths[2], table)
    except OSError as error:
        raise BenchError(
            f"{folder}: cannot be written ({error.strerror or error}); name another --out"
        ) from error
    return paths


def plain(axes) -> None:
    """Small ticks, a faint grid, no box."""
    axes.tick_params(labelsize=6.5, length=2.5)
    axes.grid(True, which="major", lw=0.3, color="0.88")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def number(axis, limits: tuple[float, float]) -> None:
    """Plain numbers along a logarithmic axis, some between the decades where there are few of those."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    span = limits[1] / limits[0]
    between = (1.0, 2.0, 3.0, 5.0, 7.0) if span < 10 else (1.0, 2.0, 5.0) if span < 100 else (1.0,)
    axis.set_major_locator(LogLocator(subs=between, numticks=20))
    axis.set_major_formatter(FuncFormatter(lambda value, place: short(value)))
    axis.set_minor_formatter(NullFormatter())


def short(value: float) -> str:
    """A tick's label, narrow enough to stand at the very end of an axis: 0.5, 20, 100k, 1M."""
    for unit, letter in ((1e6, "M"), (1e3, "k")):
        if value >= unit:
            return f"{value / unit:g}{letter}"
    return f"{value:g}"
