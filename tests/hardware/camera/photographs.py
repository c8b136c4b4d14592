"""Small photographs that say of themselves what they are told to."""

import datetime
from pathlib import Path

import numpy as np

from hardware.virtual import dng, sensor

NOON = datetime.datetime(2024, 6, 1, 12, 0, 0)


def write(
    path: Path,
    shutter_s: float = 1 / 60,
    iso: int = 100,
    seconds: float = 0.0,
    model: str = dng.MODEL,
    seed: int = 0,
) -> Path:
    """A DNG of 32 x 24 pixels, taken `seconds` after noon; each seed has other pixels."""
    chip = sensor.Sensor()
    counts = np.random.default_rng(seed).integers(512, 16383, (24, 32)).astype(np.uint16)
    when = NOON + datetime.timedelta(seconds=seconds)
    dng.write(
        path,
        dng.Photograph(
            counts,
            chip.black,
            chip.white,
            chip.camera_from_xyz,
            chip.neutral(),
            shutter_s,
            iso,
            8.0,
            when,
            model=model,
        ),
    )
    return path
