"""Prints how right the light at the object is, against the studio's incident panoramas: one row per set.

    python -m tests.bench.light FOLDER [--only WORDS] [--json FILE] [--pictures FOLDER]

FOLDER holds sets named ROOM-OBJECT, each with the `session` and `truth` of `roomlight simulate`, or sets of `roomlight
bench`, whose light may lie in `given.session`: poses and masks are the true ones there. Of every session the newest
finished light is scored, as the surface solver reads it: Gaussians at a probe where the panoramas were taken, unseen
directions filled, lamps added. Rows called "refined" are the same light under the gains that the surface found from the
object's shading. The targets are for the light as it was fitted; where lamps are clipped in every view that is a lower
bound, and irradiance and peaks are judged of the refined row alone. Nothing is processed.
"""

import argparse
import json
import os
import platform
import statistics
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from app.bench.markdown import markdown
from engine.errors import RoomlightError
from engine.geometry import fibonacci_sphere
from engine.io.images import read_radiance
from hardware.errors import StudioError
from tests.bench import emitters, incident, incident_pictures, light_sets

CELLS = 4096  # of 3.2 degrees
NORMALS = 642
BRIGHTEST = 0.01  # of the sphere
TARGETS = "targets: irradiance <= 4 % mean, <= 10 % at p95; brightest 1 % within 5 %; lamps within 1 degree"
MEAN, P95, PEAK, LAMP_DEG = 4.0, 10.0, 5.0, 1.0

# Heading, score, decimals.
COLUMNS = (
    ("irradiance off %", "irradiance_mean", 2),
    ("p95 %", "irradiance_p95", 2),
    ("of itself %", "irradiance_own_mean", 2),
    ("its p95 %", "irradiance_own_p95", 2),
    ("brightest 1 % ours/true", "brightest", 3),
    ("off %", "brightest_off", 1),
    ("in the true place", "brightest_in_place", 3),
    ("all ours/true", "total", 3),
    ("lamps found", "lamps_found", 0),
    ("of", "lamps_true", 0),
    ("false", "lamps_false", 0),
    ("lamps deg", "lamps_mean_deg", 2),
    ("worst deg", "lamps_worst_deg", 2),
    ("not photographed %", "guessed", 1),
    ("filled %", "filled", 1),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One set's scores by name, averaged over views, and its emitters."""

    name: str
    refined: bool
    version: int  # of the light stage
    views: int
    scores: dict[str, float | None]
    emitters: tuple[emitters.Emitter, ...]

    def title(self) -> str:
        return f"{self.name}, refined" if self.refined else self.name


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    sets = sorted(
        p
        for p in args.folder.glob("*")
        if (p / "truth").is_dir() and (p / "session").is_dir() and args.only in p.name
    )
    if not sets:
        print(
            f"{args.folder}: no sets in it; make some: `roomlight simulate {args.folder}/study-blob --room study"
            " --object blob`",
            file=sys.stderr,
        )
        return 2
    lacking = [path / "session" for path in sets if light_sets.session_of(path) is None]
    for session in lacking:
        print(
            f"{session}: no finished light; run `roomlight process {session} --until light`", file=sys.stderr
        )
    if lacking:
        return 2
    rows = []
    try:
        for folder in sets:
            rows += score(light_sets.read(folder), args.pictures)
            print(table(rows[-1:]).splitlines()[-1], file=sys.stderr)
    except (RoomlightError, StudioError) as fault:
        print(fault, file=sys.stderr)
        return 2
    print(f"{len(sets)} sets, {os.cpu_count()} cores, {platform.machine()}\n")
    print(f"{table(rows)}\n\n{TARGETS}\n")
    print("\n".join(judged(rows)))
    for row in rows:
        print(
            f"\n{row.title()}, light version {row.version}, {row.views} views\n\n{emitters.told(row.emitters)}"
        )
    if args.json:
        args.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return 0


def score(s: light_sets.Set, pictures: Path | None) -> list[Row]:
    """Compare the light in every registered view: as fitted, and as the surface refined it if it did."""
    directions, normals = fibonacci_sphere(CELLS), fibonacci_sphere(NORMALS)
    onto = incident.binning(directions, len(read_radiance(s.panoramas[0])))
    solid_angle = incident.probe_solid_angle(directions, 2 * light_sets.FACE)
    true, guessed = light_sets.true_energy(s, onto), float(100 * (1 - light_sets.photographed(s).mean()))
    rows = []
    for light in light_sets.lights(s):
        ours, opaque = light_sets.our_energy(s, light, directions)
        found = emitters.emitters_of(s, light, ours, true, directions)
        scores: dict[str, float | None] = {**energy_scores(ours, true, solid_angle, onto, normals)}
        scores |= lamp_scores(found, len(light.lamps.radii)) | {
            "guessed": guessed,
            "filled": float(100 * (1 - opaque.mean())),
        }
        rows.append(Row(s.name, light.refined, s.version, len(s.views), scores, found))
        if pictures is not None:
            chosen = [len(s.views) * k // 6 for k in (1, 3, 5)]
            radiance = true[chosen] / onto.solid_angle[:, None], ours[chosen] / solid_angle[:, None]
            name = f"{s.name}-refined.png" if light.refined else f"{s.name}.png"
            incident_pictures.write(pictures / name, s.views[chosen], directions, *radiance)
    return rows


def energy_scores(
    ours: np.ndarray, true: np.ndarray, solid_angle: np.ndarray, onto: incident.Binning, normals: np.ndarray
) -> dict[str, float]:
    """Irradiance, peaks and sums of energies [n d 3], averaged over the n views; `solid_angle` is of our cells."""
    views = list(zip(ours, true, strict=True))
    errors = [incident.irradiance_error(a, b, onto.directions, normals) for a, b in views]
    peaks = []
    for a, b in views:
        top = incident.brightest(b, onto.solid_angle, BRIGHTEST)
        own = incident.brightest(a, solid_angle, BRIGHTEST)
        peaks.append((a[own].sum() / b[top].sum(), a[top].sum() / b[top].sum()))
    ratios, in_place = np.array(peaks).T
    means = {
        f"irradiance_{key}": statistics.fmean(getattr(e, key) for e in errors) for key in asdict(errors[0])
    }
    return means | {
        "brightest": float(ratios.mean()),
        "brightest_off": float(100 * np.abs(ratios - 1).mean()),
        "brightest_in_place": float(in_place.mean()),
        "total": float((ours.sum((1, 2)) / true.sum((1, 2))).mean()),
    }


def lamp_scores(found: Sequence[emitters.Emitter], ours: int) -> dict[str, float | None]:
    """Globes among `ours`, our lamps, and how far those are off as seen from the corners of the object's box."""
    lamps = [e.lamp for e in found if e.lamp is not None]
    return {
        "lamps_found": len(lamps),
        "lamps_true": sum(e.kind == "globe" for e in found),
        "lamps_false": ours - len(lamps),
        "lamps_mean_deg": statistics.fmean(lamp.corners_mean_deg for lamp in lamps) if lamps else None,
        "lamps_worst_deg": max((lamp.corners_worst_deg for lamp in lamps), default=None),
    }


def table(rows: Sequence[Row]) -> str:
    """A Markdown table: the sets, and their mean."""
    lines = [["set", *(heading for heading, *_ in COLUMNS)]]
    for row in rows:
        lines.append([row.title(), *(_shown(row.scores[key], decimals) for _, key, decimals in COLUMNS)])
    for title, refined in (("mean", False), ("mean, refined", True)):
        alike = [row for row in rows if row.refined == refined]
        if len(alike) < 2:
            continue
        cells = []
        for _, key, decimals in COLUMNS:
            known = [value for row in alike if (value := row.scores[key]) is not None]
            cells.append(_shown(statistics.fmean(known) if known else None, decimals))
        lines.append([title, *cells])
    return markdown(lines)


def judged(rows: Sequence[Row]) -> list[str]:
    """A line per set: which of its rows the targets are for, and whether they are met."""
    lines = []
    for fitted in (row for row in rows if not row.refined):
        refined = next((row for row in rows if row.refined and row.name == fitted.name), None)
        clipped = sum(e.lamp is not None and e.lamp.clipped for e in fitted.emitters)
        row, said = fitted, "irradiance and peaks of the row as fitted"
        if clipped:
            row, said = (
                refined,
                f"{clipped} lamps clipped, a lower bound as fitted: irradiance and peaks of the refined row",
            )
        if row is None:
            said += ", which there is none of: process on to the surface"
        else:
            said += f", mean {_word(row.scores['irradiance_mean'], MEAN)}, p95 {_word(row.scores['irradiance_p95'], P95)}"
            said += f", brightest {_word(row.scores['brightest_off'], PEAK)}"
        worst, missing = fitted.scores["lamps_worst_deg"], _missing(fitted)
        if worst is not None:
            said += f"; lamps as fitted {_word(worst, LAMP_DEG)}"
        if missing:
            said += f", {missing} not found"
        lines.append(f"{fitted.name}: {said}")
    return lines


def _missing(row: Row) -> int:
    return sum(e.kind == "globe" and e.lamp is None for e in row.emitters)


def _word(value: float | None, limit: float) -> str:
    return "unknown" if value is None else "met" if value <= limit else "MISSED"


def _shown(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="light", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="sets whose name holds this")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--pictures", type=Path, help="writes one picture per set: true, ours, log ratio")
    return parser


if __name__ == "__main__":
    sys.exit(main())
