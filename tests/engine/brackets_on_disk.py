"""RAW brackets of a made-up scene for tests, written by the studio's own sensor and DNG writer."""

import dataclasses
import datetime
from pathlib import Path

import cv2
import numpy as np

from engine.io.raw import Bracket
from hardware.virtual import dng, sensor

CAMERA = sensor.Sensor()
START = datetime.datetime(2024, 5, 6, 7, 8, 9, 123000)


def scene(h: int, w: int, seed: int, lamp: float = 0.0) -> np.ndarray:
    """Smooth coloured clouds, and a disc of radiance `lamp`."""
    rng = np.random.default_rng(seed)
    grey = cv2.resize(rng.lognormal(0, 0.6, (8, 8)), (w, h), interpolation=cv2.INTER_CUBIC)
    tint = cv2.resize(rng.uniform(0.6, 1.0, (3, 3, 3)), (w, h), interpolation=cv2.INTER_CUBIC)
    radiance = np.clip(grey, 0.05, None)[..., None] * np.clip(tint, 0.3, None)
    if lamp:
        cv2.circle(radiance, (w // 3, h // 3), 7, (lamp, lamp, lamp), -1)
    return radiance


def write(
    folder: Path, name: str, radiance: np.ndarray, shutter_s: float, seed: int = 0, misstate: float = 1.0
) -> Bracket:
    """Three files; the last one's shutter time is written `misstate` times too long."""
    rng = np.random.default_rng(seed)
    paths = []
    for i, photograph in enumerate(sensor.bracket(radiance, shutter_s, CAMERA, START, rng)):
        path = folder / f"{name}_{i}.dng"
        stated_s = photograph.shutter_s * (misstate if i == 2 else 1.0)
        dng.write(path, dataclasses.replace(photograph, shutter_s=stated_s))
        paths.append(path)
    return Bracket(name, tuple(paths))


def in_session_scale(radiance: np.ndarray, shutter_s: float) -> np.ndarray:
    """What the merge should answer: 1 fills a green site in the middle exposure."""
    return radiance * CAMERA.electrons_per_radiance_s() * shutter_s / CAMERA.full_electrons
