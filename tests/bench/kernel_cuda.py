"""Seconds of one view forward and backward on CUDA and on the CPU, and how far their answers are apart.

    python -m tests.bench.kernel_cuda [--size 512] [--count 50000] [--wide 2] [--repeats 10]

A Markdown table; the median of the repeats, projection and lists (always on the CPU) included and also by
themselves. Without a CUDA device it says so and exits with 2. Agreement is the size of the difference over
that of the CPU's answer: 1e-4 forward and 1e-3 backward is what the tests ask on small scenes.
"""

import argparse
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from numba import config
from numba import cuda as numba_cuda

from engine.light import on_cuda
from engine.light.gaussians import radiance_towards
from engine.light.rasterise import Gradients, Pinhole, Run, project, push_back, render, shapes, workers
from engine.types import Gaussians
from tests.engine.light import clouds


def scene(count: int, size: int, wide: float) -> tuple[Gaussians, Pinhole]:
    """Gaussians all over a square view, 1 to 4 away, about `wide` pixels each."""
    gaussians, view = clouds.scattered(count), clouds.view(size, size)
    gaussians.scales[:] *= wide / view.lens[0] * gaussians.means[:, 2:] / 0.2
    return gaussians, view


def timed(work: Callable[[], object], repeats: int) -> float:
    """Median seconds; the first time, which may compile, does not count."""
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Size of the difference relative to the CPU's."""
    return float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, default=512, help="pixels along an edge")
    parser.add_argument("--count", type=int, default=50_000, help="Gaussians")
    parser.add_argument("--wide", type=float, default=2.0, help="a Gaussian's scale in pixels, about")
    parser.add_argument("--repeats", type=int, default=10)
    args = parser.parse_args()
    if not on_cuda.available():
        print("numba finds no CUDA device on this machine: nothing was measured", file=sys.stderr)
        return 2

    gaussians, view = scene(args.count, args.size, args.wide)
    geometry, colours = shapes(gaussians), radiance_towards(gaussians, view.origin)
    rng, square = np.random.default_rng(0), (args.size, args.size)
    target = rng.uniform(0, 2, (*square, 3)).astype(np.float32)
    weights, bounds = np.ones(square, np.float32), rng.random(square) < 0.02
    surface = np.full(square, 2.0, np.float32)

    def forward(run: Run) -> np.ndarray:
        return render(geometry, colours, view, 0.0, run)

    def both(run: Run) -> tuple[np.ndarray, Gradients]:
        return push_back(geometry, colours, view, 0.0, target, weights, bounds, 0.5, 0.1, surface, run)

    _, _, (tile_start, *_) = project(geometry, colours, view)
    listing = timed(lambda: project(geometry, colours, view), args.repeats)
    with workers() as cpu, workers(device="cuda") as cuda:
        rows = [
            (name, timed(lambda: forward(run), args.repeats), timed(lambda: both(run), args.repeats))  # noqa: B023
            for name, run in (("CPU", cpu), ("CUDA", cuda))
        ]
        (theirs_image, theirs), (image, ours), (_, again) = both(cpu), both(cuda), both(cuda)

    print(f"{args.size} x {args.size}, {args.count} Gaussians, {tile_start[-1]} entries of tiles' lists;")
    name = "numba's simulator" if config.ENABLE_CUDASIM else numba_cuda.get_current_device().name
    print(f"{os.cpu_count()} cores, {platform.machine()}; {name!s}; projection and lists {listing:.4f} s\n")
    print("| where | forward s | forward and backward s |\n|---|---|---|")
    for name, once, whole in rows:
        print(f"| {name} | {once:.4f} | {whole:.4f} |")
    print(f"| CPU / CUDA | {rows[0][1] / rows[1][1]:.1f} | {rows[0][2] / rows[1][2]:.1f} |")
    print(f"\napart: image {apart(image, theirs_image):.1e}", end="")
    for name in ("means", "turn", "log_scales", "density", "colours"):
        print(f", {name} {apart(getattr(ours, name), getattr(theirs, name)):.1e}", end="")
    same = all(
        getattr(ours, n).tobytes() == getattr(again, n).tobytes() for n in ("means", "turn", "colours")
    )
    print(f"; a second run gives {'the same' if same else 'OTHER'} bits")
    return 0


if __name__ == "__main__":
    sys.exit(main())
