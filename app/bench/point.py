"""One point of `bench scaling`, in a process of its own so that its peak memory is nobody else's; prints JSON.

python -m app.bench.point SESSION AXIS VALUE DEVICE SEED
"""

import contextlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from app import cores
from app.bench.measured import warm_up
from app.bench.rows import OURS, params_of
from app.bench.stored import Stored, fewer_gaussians, fewer_pixels, fewer_views, load
from engine.progress import Progress
from engine.surface.params import SurfaceParams
from engine.surface.solve import solve

AXES = ("views", "pixels", "gaussians", "directions")


def main(argv: Sequence[str]) -> int:
    cores.prepare()
    session, axis, value, device, seed = argv
    given, params = part(load(Path(session)), axis, int(value), int(seed))
    warm_up(given, device)
    before = memory("VmRSS:")
    with contextlib.suppress(OSError):  # a kernel that keeps the mark: the warming up was the smaller solve
        Path("/proc/self/clear_refs").write_text("5")
    start = time.perf_counter()
    solve(given.captured, params, device, int(seed), Progress())
    seconds = time.perf_counter() - start
    peak = memory("VmHWM:")
    # Pages of the photographs that are first read by the solve count as its own.
    print(json.dumps({"seconds": seconds, "peak_bytes": peak, "solve_bytes": max(peak - before, 1)}))
    return 0


def part(stored: Stored, axis: str, value: int, seed: int) -> tuple[Stored, SurfaceParams]:
    """The input and the parameters of one point."""
    params = params_of(OURS)
    if axis == "views":
        return fewer_views(stored, value), params
    if axis == "pixels":
        return fewer_pixels(stored, value), params
    if axis == "gaussians":
        return fewer_gaussians(stored, value, seed), params
    return stored, replace(params, directions=value)


def memory(key: str) -> int:
    """Bytes, of this process alone: getrusage's peak is inherited from whoever started it."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
