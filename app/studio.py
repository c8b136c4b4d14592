"""Photograph a virtual object in a virtual room: OUT/session as a camera and a rig would leave it, OUT/truth.

The studio (hardware) gives radiance, the sensor turns it into RAW files, the session (engine) takes them in.
The truth lies outside of the session, where no stage looks.
"""

import datetime
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np

from engine import session as sessions
from engine.errors import SessionError
from engine.progress import Progress
from hardware.virtual import dng, sensor
from hardware.virtual.studio import shoot as virtual
from hardware.virtual.studio.shoot import Order

START = datetime.datetime(2024, 6, 1, 10, 0, 0)
BETWEEN_VIEWS_S = 10.0


def simulate(out: Path, order: Order, vignetting: float, progress: Progress) -> tuple[str, ...]:
    """Write OUT/session and OUT/truth; both appear by renames when everything is done. What was simplified, in words.

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
        notes = _photograph(partial, order, sensor.Sensor(vignetting=vignetting), progress)
        with sessions.told(out):
            (partial / "truth").rename(out / "truth")
            (partial / "session").rename(out / "session")
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return notes


def _photograph(partial: Path, order: Order, camera: sensor.Sensor, progress: Progress) -> tuple[str, ...]:
    """Fill `partial` with a session of RAW brackets and the truth beside it."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "roomlight" / "studio"
    built = virtual.build(order, cache, progress.part(0, 0.4).step)
    pictures = list(built.shoot(progress.part(0.4, 0.85).step))
    shutter_s = sensor.meter(np.stack([view.radiance for view in pictures]), camera)
    geometry = built.journey.geometry
    rig = {"kind": order.motion, "geometry": geometry} if geometry is not None else None
    facts = {"make": dng.MAKE, "model": dng.MODEL, "width": order.width, "height": order.height}
    session = sessions.create(partial / "session", "raw", facts, rig)
    rng = np.random.default_rng(order.seed)
    with tempfile.TemporaryDirectory(dir=partial) as scratch:
        for view in pictures:
            start = START + datetime.timedelta(seconds=BETWEEN_VIEWS_S * view.index)
            files, exposures = [], []
            for k, photograph in enumerate(sensor.bracket(view.radiance, shutter_s, camera, start, rng)):
                path = Path(scratch) / f"view{view.index:04d}_e{k}.dng"
                dng.write(path, photograph)
                files.append(path)
                exposures.append(
                    {
                        "source": path.name,
                        "shutter_s": photograph.shutter_s,
                        "iso": photograph.iso,
                        "aperture": photograph.aperture,
                        "time": photograph.time.isoformat(),
                    }
                )
            sessions.add_shot(session, f"view{view.index:04d}", files, exposures, view.rig)
            for path in files:
                path.unlink()
            progress.step(0.85 + 0.05 * view.index / order.views, "writing RAW files")
    built.truth(progress.part(0.9, 1.0).step).save(partial / "truth")
    return built.notes
