"""Prints how good results are over simulated sets: one row per room and object, one column per score.

    python -m tests.bench.table FOLDER [--preset standard] [--json FILE] [--true-poses-and-masks]
    python -m tests.bench.table FOLDER --rooms study,lamps,window --objects vase,relief,duo

FOLDER holds sets named ROOM-OBJECT, each with the `session` and the `truth` that `roomlight simulate` writes;
with --rooms and --objects those alone, and the missing ones are made first. Every set is processed by the command
line in a process of its own (what is done already is not done again) and held against its truth. With
--true-poses-and-masks a second session, imported with the truth's poses and mask, is processed instead.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from app import results
from app.bench.given import give_truth
from app.bench.markdown import markdown, shown

GIVEN = "given.session"

# Heading, group of scores, score, factor, decimals, and whether the worst is the largest or the smallest.
COLUMNS = (
    ("normal mean deg", "surface", "normal_mean_deg", 1, 2, max),
    ("median deg", "surface", "normal_median_deg", 1, 2, max),
    ("charged deg", "surface", "normal_mean_charged_deg", 1, 2, max),
    ("albedo dB", "surface", "albedo_psnr_db", 1, 1, min),
    ("matched dB", "surface", "albedo_psnr_matched_db", 1, 1, min),
    ("roughness MAE", "surface", "roughness_mae", 1, 3, max),
    ("depth % of relief", "surface", "depth_relief_median", 100, 2, max),
    ("coverage %", "surface", "coverage", 100, 1, min),
    ("in band %", "surface", "normal_in_band", 100, 0, min),
    ("albedo in band %", "surface", "albedo_in_band", 100, 0, min),
    ("roughness in band %", "surface", "roughness_in_band", 100, 0, min),
    ("mask IoU", "mask", "iou", 1, 3, min),
    ("boundary px", "mask", "boundary_mean_px", 1, 2, max),
    ("registered %", "poses", "registered_share", 100, 1, min),
    ("rotation deg", "poses", "rotation_median_deg", 1, 3, max),
    ("position %", "poses", "position_median_percent", 1, 2, max),
)


@dataclass(frozen=True, slots=True)
class Row:
    """One set's scores, by group and name, and what each stage cost."""

    name: str
    scores: dict[str, dict[str, float | int | None]]
    seconds: dict[str, float]
    peak_memory_bytes: int


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    names = make_sets(args)
    sets = sorted(
        path
        for path in args.folder.iterdir()
        if (path / "truth").is_dir() and (path / "session").is_dir() and (not names or path.name in names)
    )
    if not sets:
        print(f"{args.folder}: no sets in it; name --rooms and --objects to make some", file=sys.stderr)
        return 2
    rows = []
    for folder in sets:
        session = folder / "session"
        if args.true_poses_and_masks:
            session = folder / GIVEN
            if not session.exists():
                give_truth(folder / "session", folder / "truth", session)
        roomlight("process", session, "--preset", args.preset, "--device", args.device)
        rows.append(row(folder.name, session, folder / "truth"))
        print(table(rows[-1:]).splitlines()[-1], file=sys.stderr)
    inputs = "true poses and masks given" if args.true_poses_and_masks else "poses and masks estimated"
    print(f"preset {args.preset}, {inputs}, {os.cpu_count()} cores, {platform.machine()}, {args.device}\n")
    print(table(rows))
    print("\n" + times(rows))
    if args.json:
        content = {
            "preset": args.preset,
            "inputs": inputs,
            "cores": os.cpu_count(),
            "rows": [asdict(r) for r in rows],
        }
        args.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def make_sets(args: argparse.Namespace) -> set[str]:
    """Simulate the sets of --rooms and --objects that are not there yet; the names of all that were asked for."""
    args.folder.mkdir(parents=True, exist_ok=True)
    names = set()
    for room in filter(None, args.rooms.split(",")):
        for thing in filter(None, args.objects.split(",")):
            out = args.folder / f"{room}-{thing}"
            names.add(out.name)
            if not (out / "session").is_dir():
                roomlight(
                    "simulate", out, "--room", room, "--object", thing, "--views", args.views,
                    "--size", *args.size, "--motion", args.motion, "--seed", args.seed,
                )  # fmt: skip
    return names


def roomlight(*words: object) -> None:
    """Run the command line in a process of its own; its complaint ends the benchmark."""
    subprocess.run([sys.executable, "-m", "app.cli", *map(str, words)], check=True, stdout=sys.stderr)


def row(name: str, session: Path, truth: Path) -> Row:
    """Score a processed session and read what its stages cost."""
    records = {
        step.stage.name: json.loads((step.folder / "record.json").read_bytes())
        for step in results.steps_of(session)
        if step.done
    }
    return Row(
        name,
        results.evaluate(session, truth),
        {stage: record["seconds"] for stage, record in records.items()},
        max((record["peak_memory_bytes"] for record in records.values()), default=0),
    )


def table(rows: Sequence[Row]) -> str:
    """A Markdown table: the sets, their mean, and the worst of each column."""
    lines = [["set", *(column[0] for column in COLUMNS), "s"]]
    columns = [[_value(r, group, score, factor) for r in rows] for _, group, score, factor, _, _ in COLUMNS]
    totals = [sum(r.seconds.values()) for r in rows]
    for index, r in enumerate(rows):
        cells = [shown(column[index], COLUMNS[k][4]) for k, column in enumerate(columns)]
        lines.append([r.name, *cells, f"{totals[index]:.0f}"])
    if len(rows) > 1:
        for title, of in (("mean", None), ("worst", max)):
            cells = []
            for k, column in enumerate(columns):
                known = [value for value in column if value is not None]
                pick = statistics.fmean if of is None else COLUMNS[k][5]
                cells.append(shown(pick(known) if known else None, COLUMNS[k][4]))
            cells.append(f"{statistics.fmean(totals) if of is None else max(totals):.0f}")
            lines.append([title, *cells])
    return markdown(lines)


def times(rows: Sequence[Row]) -> str:
    """A Markdown table: seconds of each stage, and the peak memory."""
    stages = list(dict.fromkeys(stage for r in rows for stage in r.seconds))
    lines = [["set", *(f"{stage} s" for stage in stages), "all s", "peak GB"]]
    for r in rows:
        cells = [shown(r.seconds.get(stage), 1) for stage in stages]
        lines.append([r.name, *cells, f"{sum(r.seconds.values()):.1f}", f"{r.peak_memory_bytes / 1e9:.2f}"])
    return markdown(lines)


def _value(r: Row, group: str, score: str, factor: float) -> float | None:
    value = r.scores.get(group, {}).get(score)
    return None if value is None else factor * value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="table", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", default="standard")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--true-poses-and-masks", action="store_true")
    parser.add_argument("--rooms", default="", help="comma-separated; sets that are missing are simulated")
    parser.add_argument("--objects", default="")
    parser.add_argument("--views", type=int, default=96)
    parser.add_argument("--size", type=int, nargs=2, default=(512, 384))
    parser.add_argument("--motion", default="handheld")
    parser.add_argument("--seed", type=int, default=0)
    return parser


if __name__ == "__main__":
    sys.exit(main())
