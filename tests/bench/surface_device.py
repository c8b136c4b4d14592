"""Prints what the surface costs on a CUDA device and on the processor, and whether both find the same.

    python -m tests.bench.surface_device SESSION [--devices cpu,cuda] [--preset NAME] [--json FILE]

SESSION has its light done (`roomlight process SESSION --until light`); it is only read. Every device solves twice, one after the
other, and the second time counts: kernels are compiled then. With the truth beside the session (`roomlight simulate`)
errors are told too. "apart" is between the first device's normals and each other's.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from app import cores
from app.bench.markdown import markdown
from app.bench.rows import params_of
from app.bench.stored import load
from engine.errors import RoomlightError
from engine.geometry import angle_between
from engine.io.ground_truth import read_truth
from engine.surface.solve import solve
from tests.bench.inputs import Clock, machine, told


@dataclass(frozen=True, slots=True)
class Row:
    """One device."""

    device: str
    first_seconds: float
    seconds: float
    normal_deg: float | None
    apart_mean_deg: float
    apart_median_deg: float
    apart_99_deg: float


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    cores.prepare()
    try:
        given = load(args.session)
        there = args.session.parent / "truth"
        truth = read_truth(there) if there.exists() else None
        where, params, rows, first = machine(), params_of(args.preset), [], None
        for device in args.devices.split(","):
            seconds = []
            for time in ("first", "second"):
                clock = Clock()
                surface = solve(given.captured, params, device, 0, told(f"{device}, {time} time")).surface
                seconds.append(clock.read()[0])
            first = first or surface
            apart = np.degrees(angle_between(first.normal[first.mask], surface.normal[first.mask]))
            error = None
            if truth is not None:
                both = surface.mask & truth.mask
                error = float(np.degrees(angle_between(surface.normal[both], truth.normal[both])).mean())
            rows.append(
                Row(
                    device, seconds[0], seconds[1], error, float(apart.mean()), float(np.median(apart)),
                    float(np.percentile(apart, 99)),
                )
            )  # fmt: skip
    except RoomlightError as error:
        print(error, file=sys.stderr)
        return 2
    pixels, views = int(given.masks.object.sum()), len(given.frames.names)
    print(f"{args.session}: {pixels} pixels, {views} views, preset {args.preset}, {where}\n")
    lines = [["device", "first s", "s", "normals deg", "apart mean deg", "median", "99 %"]]
    for row in rows:
        error = "" if row.normal_deg is None else f"{row.normal_deg:.4f}"
        apart = (row.apart_mean_deg, row.apart_median_deg, row.apart_99_deg)
        lines.append(
            [
                row.device,
                f"{row.first_seconds:.1f}",
                f"{row.seconds:.1f}",
                error,
                *(f"{x:.4f}" for x in apart),
            ]
        )
    print(markdown(lines))
    if args.json:
        args.json.write_text(
            json.dumps({"machine": where, "rows": [asdict(row) for row in rows]}, indent=1) + "\n"
        )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="surface_device", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--devices", default="cpu,cuda")
    parser.add_argument("--preset", default="standard")
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
