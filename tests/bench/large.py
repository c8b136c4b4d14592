"""Prints what a solve of a large object costs, and whether it is as right as that of a small one.

    python -m tests.bench.large FOLDER [--by 16] [--preset standard] [--json FILE]

The photographs of a set (study, blob: 48 views of 320 x 240, true poses and mask; FOLDER keeps it) are enlarged so many
times around the object, the truth with them: the studio would take days for 2048 x 2048 pixels of it. Enlarged photographs
hold no new detail: seconds and memory are those of a real one, of the errors only that they stay is shown. The enlarged
solve runs in a process of its own. "Own" memory leaves out photographs that are mapped from disk, which the
system drops when it needs the room; "all" is the highest resident set.
"""

import argparse
import json
import multiprocessing
import resource
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from app import cores
from app.bench import sets
from app.bench.choices import built_in
from app.bench.markdown import markdown
from app.bench.rows import params_of
from app.bench.sizes import SIZES
from app.bench.stored import Stored
from engine.errors import RoomlightError
from engine.io.ground_truth import Truth
from engine.results import metrics
from engine.surface.data.scene import Picture, window
from engine.surface.solve import solve
from engine.types import Frames, Masks
from hardware.errors import StudioError
from tests.bench.inputs import Clock, machine, told

TARGET_PIXELS, TARGET_GB = 2048 * 2048, 6.0
EVERY_S = 0.5


@dataclass(frozen=True, slots=True)
class Row:
    """One solve."""

    title: str
    pixels: int
    together: int
    seconds: float
    own_gb: float  # 1e9 bytes, above what the process held before
    all_gb: float
    normal_deg: float
    albedo_db: float
    roughness: float


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    cores.prepare()
    where = machine()
    try:
        rows = [apart(args.folder, by, args.preset) for by in (1, args.by)]
    except (RoomlightError, StudioError) as fault:
        print(fault, file=sys.stderr)
        return 2
    print(f"study, blob, preset {args.preset}, {where}\n\n{table(rows)}\n\n{verdict(rows)}")
    if args.json:
        content = {"machine": where, "preset": args.preset, "rows": [asdict(row) for row in rows]}
        args.json.write_text(json.dumps(content, indent=1) + "\n")
    return 0


def apart(folder: Path, by: int, preset: str) -> Row:
    """The set enlarged and solved in a new process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measured, (folder, by, preset))


def measured(folder: Path, by: int, preset: str) -> Row:
    """The set enlarged and solved in this process."""
    cores.prepare()
    size = SIZES["small"]
    on = sets.ready(folder, built_in("study"), built_in("blob"), size, size.views, 0, "cpu")
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        given, truth = enlarged(on.stored, on.truth, by, Path(scratch))
        memory, clock = Memory(), Clock()
        what = f"{by} times as large"
        solved = solve(given.captured, params_of(preset), "cpu", 0, told(what))
        surface, report = solved.surface, solved.report
        seconds, _ = clock.read()
        own = memory.read()
    found = metrics.evaluate(surface, truth)
    everything = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9  # Linux counts in KiB
    return Row(
        what, report.pixels, report.together, seconds, own, everything, found.normal_mean_deg,
        found.albedo_psnr_db, found.roughness_mae,
    )  # fmt: skip


def enlarged(given: Stored, truth: Truth, by: int, scratch: Path) -> tuple[Stored, Truth]:
    """Photographs and truth around the object, `by` times as large; the photographs in a file of `scratch`."""
    if by == 1:
        return given, truth
    mask = given.masks.object
    rows, columns = window(mask)
    part = Picture(given.frames, mask, given.poses.camera).part(rows, columns)
    height, width = (side * by for side in part.mask.shape)
    count, k = len(part.frames.names), part.camera

    def larger(values: np.ndarray, how: int) -> np.ndarray:
        return cv2.resize(np.ascontiguousarray(values), (width, height), interpolation=how)

    def whether(flags: np.ndarray) -> np.ndarray:
        return larger(flags.astype(np.uint8), cv2.INTER_NEAREST).astype(bool)

    file = np.lib.format.open_memmap(scratch / "radiance.npy", "w+", np.float32, (count, height, width, 3))
    for view in range(count):
        file[view] = larger(part.frames.radiance[view], cv2.INTER_LINEAR)
    file.flush()
    radiance = np.asarray(np.load(scratch / "radiance.npy", mmap_mode="r")).view(np.ndarray)
    clipped, dark = (
        np.stack([whether(view) for view in views]) for views in (part.frames.clipped, part.frames.dark)
    )
    frames = Frames(part.frames.names, radiance, clipped, dark, part.frames.noise)
    camera = replace(k, width=width, height=height, fx=k.fx * by, fy=k.fy * by, cx=k.cx * by, cy=k.cy * by)
    masks = Masks(whether(part.mask), np.zeros((count, height, width), bool))
    told_maps: dict[str, Any] = {}
    for name in ("normal", "albedo", "roughness", "depth"):
        told_maps[name] = larger(getattr(truth, name)[rows, columns], cv2.INTER_LINEAR)
    normal = told_maps["normal"]
    told_maps["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    inner = cv2.erode(truth.mask[rows, columns].astype(np.uint8), np.ones((3, 3), np.uint8))
    true = replace(truth, mask=larger(inner, cv2.INTER_NEAREST).astype(bool), **told_maps)
    return replace(given, frames=frames, masks=masks, poses=replace(given.poses, camera=camera)), true


class Memory:
    """Watches this process' own memory from the moment it is made."""

    def __init__(self) -> None:
        self._before = self._most = _own_bytes()
        self._over = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while not self._over.wait(EVERY_S):
            self._most = max(self._most, _own_bytes())

    def read(self) -> float:
        """The most so far above what it began with, in 1e9 bytes; watching ends."""
        self._over.set()
        return (max(self._most, _own_bytes()) - self._before) / 1e9


def _own_bytes() -> int:
    """Resident memory that no file holds."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) * 1024
    raise OSError("/proc/self/status names no RssAnon: memory is measured on Linux alone")


def table(rows: Sequence[Row]) -> str:
    lines = [["photographs", "pixels", "solved together", "s", "us a pixel", "own GB", "all GB", "normals deg", "albedo dB",
              "roughness"]]  # fmt: skip
    for row in rows:
        lines.append([
            row.title, str(row.pixels), str(row.together), f"{row.seconds:.0f}", f"{1e6 * row.seconds / row.pixels:.0f}",
            f"{row.own_gb:.2f}", f"{row.all_gb:.2f}", f"{row.normal_deg:.2f}", f"{row.albedo_db:.1f}", f"{row.roughness:.4f}",
        ])  # fmt: skip
    return markdown(lines)


def verdict(rows: Sequence[Row]) -> str:
    largest = max(rows, key=lambda row: row.pixels)
    if largest.pixels < 0.9 * TARGET_PIXELS:
        return f"target: {TARGET_PIXELS} pixels in {TARGET_GB:g} GB; not measured here"
    return (
        f"target: {TARGET_PIXELS} pixels in {TARGET_GB:g} GB; {largest.pixels} took {largest.own_gb:.2f} GB:"
        f" {'met' if largest.own_gb <= TARGET_GB else 'MISSED'}"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="large", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--by", type=int, default=16)
    parser.add_argument("--preset", default="standard")
    parser.add_argument("--json", type=Path)
    return parser


if __name__ == "__main__":
    sys.exit(main())
