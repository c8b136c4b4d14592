"""Photograph a virtual object in a virtual room: OUT/session as a camera and a rig would leave it, OUT/truth.

The studio (hardware) gives radiance, the sensor turns it into RAW files, the session (engine) takes them in.
The truth lies outside of the session, where no stage looks.
"""

import datetime
import shutil
import tempfile
from collections.abc import Callable, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR

from app import places
from engine.errors import SessionError
from engine.io import session as sessions
from engine.progress import Progress
from hardware.virtual import dng, sensor
from hardware.virtual.studio import shoot as virtual
from hardware.virtual.studio.order import Order

START = datetime.datetime(2024, 6, 1, 10, 0, 0)
BETWEEN_VIEWS_S = 10.0


def simulate(
    out: Path, order: Order, vignetting: float, progress: Progress, files: str = "raw", enlarged: int = 1,
    panoramas: bool = True,
) -> tuple[str, ...]:  # fmt: skip
    """Write OUT/session and OUT/truth; both appear by renames when everything is done. What was simplified, in words.

    Args:
        files: "raw": brackets by a camera; or "linear": the radiance itself, one EXR of floats a view, by no camera.
        enlarged: RAW files are so many times as wide and high as what is drawn, with noise of their own; the truth is not.
        panoramas: the truth holds the light at the object, view by view.

    Raises:
        StudioError: what was ordered cannot be built, or no lens loses such a share of light.
        SessionError: OUT holds something already, or the disk refuses.
    """
    for name in ("session", "truth"):
        if (out / name).exists():
            raise SessionError(f"{out / name}: exists already; choose another folder or remove it first")
    partial = out / ".simulate.partial"
    with sessions.told(out):
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
    try:
        camera = sensor.Sensor(vignetting=vignetting)
        notes = _photograph(partial, order, camera, files, enlarged, panoramas, progress)
        with sessions.told(out):
            (partial / "truth").rename(out / "truth")
            (partial / "session").rename(out / "session")
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return notes


def _photograph(
    partial: Path, order: Order, camera: sensor.Sensor, kind: str, enlarged: int, panoramas: bool, progress: Progress
) -> tuple[str, ...]:  # fmt: skip
    """Fill `partial` with a session and the truth beside it."""
    # What each takes; photographs that are enlarged take most to write.
    built_at, shot_at, written_at, end = accumulate((0.4, 0.45, 0.05 * enlarged**2, 0.1))
    built = virtual.build(order, places.cache() / "studio", progress.part(0, built_at / end).step)
    pictures = list(built.shoot(progress.part(built_at / end, shot_at / end).step))
    writing = progress.part(shot_at / end, written_at / end)
    geometry = built.journey.geometry
    rig = {"kind": order.motion, "geometry": geometry} if geometry is not None else None
    model = {"make": dng.MAKE, "model": dng.MODEL} if kind == "raw" else {"model": None}
    lens = {**model, "width": enlarged * order.width, "height": enlarged * order.height}
    session = sessions.create(partial / "session", kind, lens, rig)
    write = _brackets(pictures, camera, order.seed, enlarged) if kind == "raw" else _as_it_is
    with tempfile.TemporaryDirectory(dir=partial) as scratch:
        for view in pictures:
            files, facts = write(view, Path(scratch))
            sessions.add_shot(session, f"view{view.index:04d}", files, facts, view.rig)
            for path in files:
                path.unlink()
            writing.step((view.index + 1) / order.views, "writing photographs")
    built.truth(progress.part(written_at / end, 1.0).step, panoramas).save(partial / "truth")
    return built.notes


Written = tuple[list[Path], list[dict[str, Any]]]
"""One view's files, and what is known of how each was exposed."""


def _brackets(
    pictures: Sequence[virtual.View], camera: sensor.Sensor, seed: int, enlarged: int
) -> Callable[[virtual.View, Path], Written]:
    """Writes a view into a folder as RAW files, metered over all; views in their order, or noise is another."""
    shutter_s = sensor.meter(np.stack([view.radiance for view in pictures]), camera)
    rng = np.random.default_rng(seed)

    def write(view: virtual.View, folder: Path) -> Written:
        start = START + datetime.timedelta(seconds=BETWEEN_VIEWS_S * view.index)
        files, facts = [], []
        # Bilinear: a wider filter would undershoot beside lamps, and no light is negative.
        radiance = cv2.resize(view.radiance, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_LINEAR)
        for k, photograph in enumerate(sensor.bracket(radiance, shutter_s, camera, start, rng)):
            path = folder / f"view{view.index:04d}_e{k}.dng"
            dng.write(path, photograph)
            files.append(path)
            facts.append(
                {
                    "source": path.name,
                    "shutter_s": photograph.shutter_s,
                    "iso": photograph.iso,
                    "aperture": photograph.aperture,
                    "time": photograph.time.isoformat(),
                }
            )
        return files, facts

    return write


def _as_it_is(view: virtual.View, folder: Path) -> Written:
    """Write a view's radiance as one file of floats."""
    path = folder / f"view{view.index:04d}.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(view.radiance, np.float32)}) as file:
        file.write(str(path))
    return [path], [{"source": path.name}]
