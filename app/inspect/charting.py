"""The charts of a session as plain numbers: errors against time, residual of each view, what light was seen.

A chart says what its axes are, with units, and holds its series; drawing it is the view's business, its numbers as
CSV are made here. Sources: the stages' record.json and report.json, and the photographs held against re-renderings.
"""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from app.inspect import maps, runs
from app.inspect.maps import Maps
from app.inspect.runs import Run
from app.parameters import STAGES
from app.relight.lights import Light
from app.words import QT_TRANSLATE_NOOP
from engine.errors import TruthError
from engine.geometry import angle_between
from engine.io.ground_truth import REQUIRED, Truth
from engine.orientation import turn_maps

FLOOR = 0.02
"""Of the object's median radiance: the least that an error is taken relative to, as in the solver."""


@dataclass(frozen=True, slots=True)
class Series:
    """Numbers that belong together."""

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    labels: tuple[str, ...] = ()  # one a point, told when it is pointed at
    kind: str = "points"  # "points", "line" (with points), "bars", "mark" (one vertical line)
    colour: int = 0  # of the theme's series
    upper: tuple[float, ...] = ()  # ends of whiskers upwards from y


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """What is drawn, and what is said about it."""

    key: str
    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    said: str = ""  # a sentence under the title, with places for `facts`
    facts: Mapping[str, object] = field(default_factory=dict)
    log_x: bool = False
    log_y: bool = False
    ticks: Mapping[float, str] = field(default_factory=dict)  # of the x axis, in place of numbers
    stacked: bool = False  # bars of one place stand on one another
    lying: bool = False  # bars go to the right, places stand below one another
    x_range: tuple[float, float] | None = None
    # A panorama: azimuth -180..180, polar angle 0..180 degrees.
    image: UInt8[np.ndarray, "h w 4"] | None = None
    missing: str = ""  # why there is nothing yet
    lacking: bool = False  # a child could work more of it out


TITLES = {
    "errors": QT_TRANSLATE_NOOP("maps", "Error against time"),
    "times": QT_TRANSLATE_NOOP("maps", "Time of the stages"),
    "views": QT_TRANSLATE_NOOP("maps", "Residual of each view"),
    "coverage": QT_TRANSLATE_NOOP("maps", "Coverage of the light"),
    "settling": QT_TRANSLATE_NOOP("maps", "Convergence"),
    "distance": QT_TRANSLATE_NOOP("maps", "Distance of the object"),
    "exposures": QT_TRANSLATE_NOOP("maps", "Exposure of each view"),
}
"""The charts there are, in the order they are offered."""

ERRORS = {
    "held_out_error": (
        QT_TRANSLATE_NOOP("maps", "Error of validation views, median"), "% of the radiance", 100.0,
    ),
    "residual": (QT_TRANSLATE_NOOP("maps", "Residual of the fit, median"), "times the expected noise", 1.0),
    "stderr_normal_deg": (QT_TRANSLATE_NOOP("maps", "Standard error of the normal, median"), "degrees", 1.0),
    "truth": (QT_TRANSLATE_NOOP("maps", "Error of the normal against the truth, mean"), "degrees", 1.0),
}  # fmt: skip
"""What may stand on the error axis: title, unit, factor from what the report holds."""


def errors(found: Sequence[Run], key: str, truth: Truth | None = None) -> Chart:
    """Each run's error against the time of all its stages."""
    title, unit, factor = ERRORS[key]
    points = []
    for run, name in zip(found, runs.names(found), strict=True):
        value = _truth_error(run, truth) if key == "truth" else run.reported("surface").get(key, math.nan)
        if isinstance(value, int | float) and math.isfinite(value):
            points.append((run.seconds, factor * value, name))
    points.sort()
    x, y, labels = zip(*points, strict=True) if points else ((), (), ())
    why = ""
    if not points:
        why = (
            QT_TRANSLATE_NOOP("maps", "no truth of this session is known; choose one")
            if key == "truth"
            else QT_TRANSLATE_NOOP("maps", "no run tells this")
        )
    return Chart(
        "errors",
        TITLES["errors"],
        QT_TRANSLATE_NOOP("maps", "time of all stages [s]"),
        f"{title} [{unit}]",
        (Series("runs", x, y, labels, "line"),),
        QT_TRANSLATE_NOOP("maps", "Each point is one run of this session; further left and lower is better."),
        missing=why,
    )


def stage_times(found: Sequence[Run]) -> Chart:
    """Where each run's time went."""
    names = runs.names(found)
    series = []
    for i, stage in enumerate(runs.STAGES[:-1]):
        seconds = tuple(
            float(run.records[stage]["seconds"]) if stage in run.records else 0.0 for run in found
        )
        title = STAGES[stage][0]
        # The labels of one bar are told in a row, and its name once.
        labels = tuple(
            f"{title} {second:.1f} s" if i else f"{name}: {title} {second:.1f} s"
            for name, second in zip(names, seconds, strict=True)
        )
        series.append(Series(title, tuple(map(float, range(len(found)))), seconds, labels, "bars", i))
    return Chart(
        "times",
        TITLES["times"],
        "",
        QT_TRANSLATE_NOOP("maps", "time [s]"),
        tuple(series),
        QT_TRANSLATE_NOOP("maps", "Wall time of each stage; runs that share a stage paid for it once."),
        ticks={float(i): name for i, name in enumerate(names)},
        stacked=True,
        lying=True,
        missing="" if found else QT_TRANSLATE_NOOP("maps", "no run tells this"),
    )


def view_residuals(shown: Maps) -> Chart:
    """Photograph against re-rendering, view by view: median and 95 % of the pixels."""
    rows: dict[bool, list[tuple[int, float, float]]] = {True: [], False: []}
    mask = shown.surface.mask
    for view in range(len(shown.names)):
        made = maps.rendering(shown, view)
        if made is None or shown.frames is None:
            continue
        true = shown.frames.radiance[view][mask]
        error = np.abs(made[mask] - true) / np.maximum(true, FLOOR * np.median(true))
        rows[view in shown.held_out].append(
            (view, 100 * float(np.median(error)), 100 * float(np.percentile(error, 95)))
        )
    series = []
    for held, name, colour in (
        (False, QT_TRANSLATE_NOOP("maps", "views of the fit"), 0),
        (True, QT_TRANSLATE_NOOP("maps", "validation views"), 1),
    ):
        if rows[held]:
            view, y, upper = zip(*rows[held], strict=True)
            labels = tuple(
                f"{shown.names[i]}: median {middle:.1f} %, 95 % below {most:.0f} %"
                for i, middle, most in zip(view, y, upper, strict=True)
            )
            series.append(Series(name, tuple(map(float, view)), y, labels, "bars", colour, upper))
    registered, known = int(shown.registered.sum()), sum(map(len, rows.values()))
    return Chart(
        "views",
        TITLES["views"],
        QT_TRANSLATE_NOOP("maps", "view"),
        QT_TRANSLATE_NOOP("maps", "relative error [%]"),
        tuple(series),
        QT_TRANSLATE_NOOP(
            "maps",
            "Bars: median of |re-rendered - photographed| / photographed over the object; whiskers: 95 % below."
            " {known} of {registered} views are re-rendered.",
        ),
        {"known": known, "registered": registered},
        x_range=(-0.8, len(shown.names) - 0.2),
        missing="" if series else QT_TRANSLATE_NOOP("maps", "no view is re-rendered yet"),
        lacking=known < registered,
    )


def settling(run: Run) -> Chart:
    """How the misfit fell, iteration by iteration."""
    report = run.reported("surface")
    # Until version 46 a report had the coarse iterations alone.
    turns = [one["residual"] for one in report.get("history", ()) if one["residual"] is not None]
    turns = turns or report.get("rough_residuals", [])
    x = tuple(float(i + 1) for i in range(len(turns)))
    return Chart(
        "settling",
        TITLES["settling"],
        QT_TRANSLATE_NOOP("maps", "iteration"),
        QT_TRANSLATE_NOOP("maps", "residual [times the expected noise]"),
        (Series("residual", x, tuple(map(float, turns)), kind="line"),),
        QT_TRANSLATE_NOOP(
            "maps",
            "Median spread of the residuals after each iteration; 1 is what noise and the model's error explain.",
        ),
        ticks={at: f"{at:.0f}" for at in x},
        missing="" if turns else QT_TRANSLATE_NOOP("maps", "this run reported no iterations"),
    )


def distance(run: Run, shown: Maps) -> Chart:
    """How well the light's parallax told the object's distance."""
    found = run.reported("surface").get("distance", {})
    factor, unit = shown.unit_factor, shown.unit
    tried = tuple(factor * z for z in found.get("tried", ()))
    misfit = tuple(map(float, found.get("misfit", ())))
    value, error = float(found.get("value", math.nan)), float(found.get("stderr", math.nan))
    relative = error / value
    value *= factor
    series: tuple[Series, ...] = ()
    if tried:
        series = (
            Series("first look", tried, misfit, kind="line"),
            Series(f"settled at {value:.4g}", (value,), (min(misfit),), kind="mark", colour=1),
        )
    return Chart(
        "distance",
        TITLES["distance"],
        f"distance [{unit}]",
        QT_TRANSLATE_NOOP("maps", "misfit"),
        series,
        QT_TRANSLATE_NOOP("maps", "Camera to object along the viewing axis: {value}{spread}, from {source}."),
        {
            "value": f"{value:.4g} {unit}",
            "spread": f" \u00b1 {100 * relative:.2g} %" if 0 < relative < math.inf else "",
            "source": found.get("source", "?"),
        },
        log_x=True,
        log_y=True,
        missing="" if tried else QT_TRANSLATE_NOOP("maps", "the distance was given, not searched"),
    )


def exposures(shown: Maps) -> Chart:
    """Share of each photograph that no exposure recorded: clipped in all, or lost in the dark."""
    if shown.frames is None:
        return Chart(
            "exposures",
            TITLES["exposures"],
            "",
            "",
            (),
            missing=QT_TRANSLATE_NOOP("maps", "the photographs' results are gone"),
        )
    series = []
    x = tuple(map(float, range(len(shown.names))))
    for colour, name, bits in ((5, "clipped", shown.frames.clipped), (6, "dark", shown.frames.dark)):
        share = tuple(100 * float(view.mean()) for view in bits)
        labels = tuple(
            f"{view}: {value:.2g} % {name}" for view, value in zip(shown.names, share, strict=True)
        )
        series.append(Series(name, x, share, labels, "bars", colour))
    return Chart(
        "exposures",
        TITLES["exposures"],
        QT_TRANSLATE_NOOP("maps", "view"),
        QT_TRANSLATE_NOOP("maps", "share of the pixels [%]"),
        tuple(series),
        QT_TRANSLATE_NOOP(
            "maps", "Pixels saturated in every exposure, and pixels below the noise in every exposure."
        ),
        stacked=True,
        x_range=(-0.8, len(shown.names) - 0.2),
    )


def coverage(light: Light | None) -> Chart:
    """The light around the object: photographed, only clipped, guessed; by solid angle and by energy."""
    if light is None:
        why = QT_TRANSLATE_NOOP("maps", "not worked out yet; it takes some ten seconds")
        return Chart("coverage", TITLES["coverage"], "", "", (), missing=why, lacking=True)
    series = tuple(
        Series(
            name,
            (0.0, 1.0),
            (100 * sphere, 100 * energy),
            (f"{name}: {100 * sphere:.1f} % of the sphere", f"{name}: {100 * energy:.1f} % of the light"),
            "bars",
            colour,
        )
        for (name, (sphere, energy)), colour in zip(light.shares().items(), (2, 5, 7), strict=True)
    )
    return Chart(
        "coverage",
        TITLES["coverage"],
        "",
        QT_TRANSLATE_NOOP("maps", "share [%]"),
        series,
        QT_TRANSLATE_NOOP(
            "maps",
            "What arrives at the object in view {view}, logarithmic. Red: clipped in every photograph that shows it,"
            " inferred from the object. Hatched: never photographed, a smooth guess.",
        ),
        {"view": light.view},
        ticks={
            0.0: QT_TRANSLATE_NOOP("maps", "of the sphere"),
            1.0: QT_TRANSLATE_NOOP("maps", "of the light"),
        },
        stacked=True,
        lying=True,
        image=light.picture(),
    )


def as_csv(chart: Chart) -> str:
    """The chart's numbers: one row a point."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    x_label = chart.x_label or "place"
    writer.writerow(["series", x_label, chart.y_label, "upper", "label"])
    for series in chart.series:
        for i, (x, y) in enumerate(zip(series.x, series.y, strict=True)):
            upper = f"{series.upper[i]:.9g}" if series.upper else ""
            label = series.labels[i] if series.labels else ""
            writer.writerow([series.name, chart.ticks.get(x, f"{x:.9g}"), f"{y:.9g}", upper, label])
    return out.getvalue()


def known_truth(session: Path) -> Path | None:
    """The truth that a virtual studio wrote beside its session."""
    path = session.parent / "truth" / "truth.npz"
    return path if path.is_file() else None


def _truth_error(run: Run, truth: Truth | None) -> float:
    """Mean degrees between the run's normals and the true ones, where both have a pixel."""
    if truth is None:
        return math.nan
    shown, truth = maps.load(run).surface, turn_maps(truth, run.flip, REQUIRED)
    if shown.mask.shape != truth.mask.shape:
        sizes = " and ".join(f"{mask.shape[1]} x {mask.shape[0]}" for mask in (shown.mask, truth.mask))
        raise TruthError(f"result and truth are {sizes} pixels; choose the truth of the same photographs")
    both = shown.mask & truth.mask
    if not both.any():
        return math.nan
    return float(np.degrees(angle_between(shown.normal[both], truth.normal[both])).mean())
