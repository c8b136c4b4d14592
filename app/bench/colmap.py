"""One of COLMAP's own routes to poses with its default options, in a process of its own; prints JSON.

python -m app.bench.colmap FRAMES ROUTE SCRATCH

FRAMES is the folder of a finished stage hdr; its photographs are written as a screen would show them, by one tone curve.
"""

import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from app.bench.point import memory
from engine.color import luminance
from engine.io.images import tone_map
from engine.pipeline import artifacts
from engine.sfm.features import view_name
from engine.sfm.mapping import placed
from engine.types import Frames


def main(argv: Sequence[str]) -> int:
    folder, route, scratch = Path(argv[0]), argv[1], Path(argv[2])
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    images, database, models = scratch / "images", scratch / "colmap.db", scratch / "models"
    images.mkdir(parents=True)
    models.mkdir()
    frames = artifacts.load(folder, "frames", Frames)
    anchor = float(np.median(luminance(frames.radiance[:, ::4, ::4])))
    for i, radiance in enumerate(frames.radiance):
        cv2.imwrite(str(images / view_name(i)), tone_map(radiance, anchor)[..., ::-1])
    compare = {"exhaustive": pycolmap.match_exhaustive, "sequential": pycolmap.match_sequential}[route]
    found: dict[int, pycolmap.Reconstruction] = {}
    parts = [
        _timed("features", lambda: pycolmap.extract_features(database, images)),
        _timed("matching", lambda: compare(database)),
        _timed("mapping", lambda: found.update(pycolmap.incremental_mapping(database, images, models))),
    ]
    poses = np.full((len(frames.names), 3, 4), np.nan)
    if found:
        poses = placed(max(found.values(), key=lambda model: model.num_reg_images()), len(frames.names))
    print(json.dumps({"parts": parts, "cam_from_world": poses.tolist()}))
    return 0


def _timed(name: str, work: Callable[[], object]) -> dict[str, str | float]:
    start, cpu = time.perf_counter(), time.process_time()
    work()
    seconds, core_seconds = time.perf_counter() - start, time.process_time() - cpu
    return {"name": name, "seconds": seconds, "core_seconds": core_seconds, "peak_bytes": memory("VmHWM:")}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
