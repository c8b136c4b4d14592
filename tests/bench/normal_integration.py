"""Prints what integrating normals to depth costs and how exact it is, at the sizes of the promise.

    python -m tests.bench.normal_integration [--sizes 512,2048] [--shapes blob,plate]

Maps of N x N with a round object that fills two thirds of the width: `blob` is smooth, `plate` is the same with a
tilted plate in front of it, torn off all around. Target at 512: 20 s and 0.2 % of depth. The error is the mean of
|log(z / true z)| on either side of the tear, each up to its own median: how high the step is, normals do not say.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np

from app.bench.markdown import markdown
from engine.progress import Progress
from engine.surface.depth.graph_laplacian import DIRECT_SOLVE_PIXELS
from engine.surface.depth.normal_integration import integrate_normals
from tests.engine.surface.landscapes import blob, camera_of, on_plate, plate

SHAPES = {"blob": blob, "plate": plate}


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="normal_integration", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", default="512,2048")
    parser.add_argument("--shapes", default="blob,plate")
    parser.add_argument("--one", nargs=2, metavar=("SHAPE", "SIZE"), help="measure one in this process")
    args = parser.parse_args(argv)
    if args.one:
        print(*measure(args.one[0], int(args.one[1])))
        return 0
    lines = [
        [
            "map",
            "shape",
            "object pixels",
            "solver",
            "seconds",
            "of the CPU",
            "error, % of depth",
            "peak MB above",
        ]
    ]
    for size in map(int, args.sizes.split(",")):
        for shape in args.shapes.split(","):
            # In a process of its own: the peak of its memory is its own.
            words = [sys.executable, "-m", "tests.bench.normal_integration", "--one", shape, str(size)]
            done = subprocess.run(words, capture_output=True, text=True)
            if done.returncode:
                failed = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
                lines.append([f"{size} x {size}", shape, "-", "-", "-", "-", failed, "-"])
                continue
            pixels, seconds, busy, error, memory = map(float, done.stdout.split())
            solver = "factorisation" if pixels <= DIRECT_SOLVE_PIXELS else "multigrid"
            told = [f"{pixels:.0f}", solver, f"{seconds:.1f}", f"{busy:.1f}"]
            told += [f"{100 * error:.3f}", f"{memory / 1e6:.0f}"]
            lines.append([f"{size} x {size}", shape, *told])
            print(f"{size} {shape}: {seconds:.1f} s", file=sys.stderr)
    print(markdown(lines))
    return 0


def measure(shape: str, size: int) -> tuple[int, float, float, float, int]:
    """(object pixels, seconds, seconds of the processor, mean relative error, bytes of peak memory above what was held before)."""
    camera = camera_of(size, size)
    mask, normals, z = SHAPES[shape](camera)
    before = _peak()
    begin, busy = time.perf_counter(), time.process_time()
    depth = integrate_normals(camera, normals, mask, float(z[mask].mean()), Progress())
    seconds, busy = time.perf_counter() - begin, time.process_time() - busy
    sides = (on_plate(camera), ~on_plate(camera)) if shape == "plate" else (np.ones_like(mask),)
    off = [np.log(depth[mask & side] / z[mask & side]) for side in sides]
    error = float(np.mean(np.concatenate([np.abs(x - np.median(x)) for x in off])))
    return int(mask.sum()), seconds, busy, error, _peak() - before


def _peak() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    sys.exit(main())
