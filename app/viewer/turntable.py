"""A turn about what the 3D view shows, kept as a video or as numbered PNG files."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.frame_writer import FrameWriter
from app.viewer.events import Picture
from app.viewer.orbit import Orbit

PICTURES = 72
A_SECOND = 24


def eyes(orbit: Orbit) -> list[Orbit]:
    """All the way around the target, from where the eye is, in even steps."""
    return [replace(orbit, azimuth=orbit.azimuth + 2 * math.pi * k / PICTURES) for k in range(PICTURES)]


class Film(FrameWriter):
    """Pictures of the view, one after the other."""

    def __init__(self, to: Path) -> None:
        """
        Raises:
            ExportError: `to` is something that must not be lost.
        """
        super().__init__(to, A_SECOND)

    def add(self, picture: Picture) -> None:
        """
        Raises:
            ExportError: it cannot be written.
        """
        rows = np.frombuffer(picture.pixels, np.uint8).reshape(picture.height, picture.width, 4)
        self.write(np.ascontiguousarray(rows[..., :3]))
