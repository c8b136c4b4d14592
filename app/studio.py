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
from hardware.virtual import studio as virtual

START = datetime.datetime(2024, 6, 1, 10, 0, 0)
BETWEEN_VIEWS_S = 10.0


def simulate(
    out: Path,
    room: str,
    thing: str,
    views: int,
    size: tuple[int, int],
    motion: str,
    seed: int,
    vignetting: float,
    device: str,
    progress: Progress,
) -> None:
    """Write OUT/session and OUT/truth; both appear by renames when everything is done.

    Raises:
        StudioError: unknown names, odd sizes, no views.
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
        _photograph(partial, room, thing, views, size, motion, seed, vignetting, device, progress)
        with sessions.told(out):
            (partial / "truth").rename(out / "truth")
            (partial / "session").rename(out / "session")
    finally:
        shutil.rmtree(partial, ignore_errors=True)
