"""Prints what fitting a session's light costs, and how near to a much longer run it comes on views it never saw.

    python -m tests.bench.fit SESSION [--longer 10] [--json FILE]

SESSION has its stages hdr, segment and poses done (`roomlight process SESSION --until poses`); it is only read. Each
fit runs in a process of its own, kernels compiled beforehand, so that memory is that of one fit: the highest resident
set from a fresh interpreter to the end, mapped photographs included. "Longer" has so many times the passes; 0 leaves
it out.
"""

import argparse
import json
import multiprocessing
import resource
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from app.bench.markdown import markdown
from engine.errors import RoomlightError
from engine.light.fitting.fit import fit
from engine.light.fitting.params import LightParams
from tests.bench.inputs import Clock, inputs, machine, told

WITHIN = 0.03  # of the longer run's log-L1
LARGE, LARGE_S, LARGE_GB = (150, 512, 512), 300.0, 4.0  # views, width, height
SMALL, SMALL_S = (96, 176), 60.0  # views, width


@dataclass(frozen=True, slots=True)
class Size:
    """What was fitted to."""

    views: int  # of the session
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Row:
    """One fit."""

    passes: tuple[int, ...]
    gaussians: int
    seconds: float
    core_seconds: float
    peak_gb: float  # 1e9 bytes
    heldout_log_l1: float
    views_heldout: int


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    try:
        frames, *_ = inputs(args.session)
    except RoomlightError as error:
        print(error, file=sys.stderr)
        return 2
    views, height, width, _ = frames.radiance.shape
    size, where = Size(views, width, height), machine()
    ours = LightParams()
    apart(args.session, replace(ours, max_gaussians=500, max_image_width=32, epochs=(1,)), "compiling")
    rows = [apart(args.session, ours, "as it is")]
    if args.longer:
        longer = replace(ours, epochs=tuple(args.longer * count for count in ours.epochs))
        rows.append(apart(args.session, longer, f"{args.longer} times the passes"))
    print(f"{args.session.name}: {views} views of {width} x {height}, {where}\n\n{table(rows)}\n")
    print("\n".join(verdicts(size, rows)))
    if args.json:
        content = {"size": asdict(size), "machine": where, "rows": [asdict(row) for row in rows]}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def apart(session: Path, params: LightParams, what: str) -> Row:
    """One fit in a new process."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, fresh) as pool:
        return pool.submit(fitted, session, params, what).result()


def fitted(session: Path, params: LightParams, what: str) -> Row:
    """One fit in this process."""
    given, clock = inputs(session), Clock()
    gaussians, _, report = fit(*given, params, 0, told(what))
    seconds, cores = clock.read()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9  # Linux counts in KiB
    return Row(
        params.epochs, len(gaussians.means), seconds, cores, peak, report.heldout_log_l1, report.views_heldout
    )


def table(rows: Sequence[Row]) -> str:
    """A Markdown table, one row per fit."""
    lines = [["passes", "Gaussians", "s", "core-s", "peak GB", "held-out log-L1"]]
    for row in rows:
        lines.append([
            " + ".join(map(str, row.passes)), str(row.gaussians), f"{row.seconds:.1f}", f"{row.core_seconds:.1f}",
            f"{row.peak_gb:.2f}", f"{row.heldout_log_l1:.4f}",
        ])  # fmt: skip
    return markdown(lines)


def verdicts(size: Size, rows: Sequence[Row]) -> list[str]:
    """The targets beside what they are measured by; those of another size are not judged."""
    first, here = rows[0], f"{size.views} views of {size.width} x {size.height}"
    is_large = (size.views, size.width, size.height) == LARGE
    said = [
        _verdict(f"{LARGE[0]} views of {LARGE[1]} x {LARGE[2]} <= {LARGE_S:g} s", first.seconds, LARGE_S, "s", is_large),
        _verdict("the same <= 4 GB", first.peak_gb, LARGE_GB, "GB", is_large),
        _verdict(
            f"{SMALL[0]} views at {SMALL[1]} px <= {SMALL_S:g} s", first.seconds, SMALL_S, "s",
            (size.views, size.width) == SMALL,
        ),
    ]  # fmt: skip
    if len(rows) > 1 and first.views_heldout:
        over = 100 * (first.heldout_log_l1 / rows[1].heldout_log_l1 - 1)
        said.append(
            _verdict("held-out log-L1 <= 3 % over the longer run's", over, 100 * WITHIN, f"% on {here}", True)
        )
    return said


def _verdict(target: str, measured: float, limit: float, unit: str, judged: bool) -> str:
    if not judged:
        return f"target: {target}; not measured here"
    return f"target: {target}; measured {measured:.3g} {unit}: {'met' if measured <= limit else 'MISSED'}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="fit", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--longer", type=int, default=10)
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
