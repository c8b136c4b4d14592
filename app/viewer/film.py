"""A turn about what the 3D view shows, or the cameras' way through the room, kept as a video or as numbered PNG files."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.frame_writer import FrameWriter
from app.viewer import showing
from app.viewer.events import Picture
from app.viewer.orbit import Orbit
from app.viewer.protocol import Style
from app.viewer.showing import Showing

PICTURES = {"turntable": 72, "path": 192}
A_SECOND = 24


def looks(kind: str, shown: Showing) -> list[tuple[Orbit, Style]]:
    """One of `PICTURES`: all the way around the target, from where the eye is, in even steps; or the cameras' way."""
    count = PICTURES[kind]
    if kind == "path":
        return showing.ride(shown, count)
    start, style = showing.around(shown), shown.style
    return [(replace(start, azimuth=start.azimuth + 2 * math.pi * k / count), style) for k in range(count)]


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
