"""A turn about what the 3D view shows, kept as a video or as numbered PNG files.

Either is written under another name beside its own, and gets its own once it is whole. A video is MP4 with VP9, which
browsers and players show, else MPEG-4.
"""

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from app.viewer.events import Picture
from app.viewer.orbit import Orbit
from engine.errors import ExportError

PICTURES = 72
A_SECOND = 24
VIDEO = ".mp4"
CODECS = ("vp09", "mp4v")
_REMEDY = "choose another folder or free some space"


def eyes(orbit: Orbit) -> list[Orbit]:
    """All the way around the target, from where the eye is, in even steps."""
    return [replace(orbit, azimuth=orbit.azimuth + 2 * math.pi * k / PICTURES) for k in range(PICTURES)]


class Film:
    """Pictures of one size, one after the other; `to` is a video's file, or the PNG files' folder."""

    def __init__(self, to: Path) -> None:
        """
        Raises:
            ExportError: `to` is something that must not be lost.
        """
        self.to = to
        self._video = to.suffix.lower() == VIDEO
        self._begun = to.with_name(f".{to.stem}.partial{to.suffix}")
        self._writer: Any = None
        self._count = 0
        if not self._video and to.exists() and not (to.is_dir() and not any(to.iterdir())):
            raise ExportError(f"{to}: holds other files; choose a new name")

    def add(self, picture: Picture) -> None:
        """
        Raises:
            ExportError: it cannot be written.
        """
        import cv2

        rows = np.frombuffer(picture.pixels, np.uint8).reshape(picture.height, picture.width, 4)
        # Videos have even sizes.
        image = np.ascontiguousarray(rows[: picture.height // 2 * 2, : picture.width // 2 * 2, :3])
        if self._video:
            self._writer = self._writer or self._opened(picture.width // 2 * 2, picture.height // 2 * 2)
            self._writer.write(image)
        else:
            self._begun.mkdir(exist_ok=True)
            if not cv2.imwrite(str(self._begun / f"{self._count:04d}.png"), image):
                raise ExportError(f"{self.to}: cannot be written; {_REMEDY}")
        self._count += 1

    def _opened(self, width: int, height: int) -> Any:
        import cv2

        for codec in CODECS:
            code = cv2.VideoWriter.fourcc(*codec)
            writer = cv2.VideoWriter(str(self._begun), code, A_SECOND, (width, height))
            if writer.isOpened():
                return writer
        raise ExportError(f"{self.to}: cannot be written; {_REMEDY}")

    def finish(self) -> None:
        """
        Raises:
            ExportError: pictures are missing, as where the disk is full.
        """
        import cv2

        if self._video:
            self._writer.release()
            # Its writer does not say when the disk refuses.
            if int(cv2.VideoCapture(str(self._begun)).get(cv2.CAP_PROP_FRAME_COUNT)) != self._count:
                raise ExportError(f"{self.to}: cannot be written whole; {_REMEDY}")
        self._begun.replace(self.to)

    def drop(self) -> None:
        """Leave nothing behind."""
        if self._video:
            if self._writer is not None:
                self._writer.release()
            self._begun.unlink(missing_ok=True)
        else:
            shutil.rmtree(self._begun, ignore_errors=True)
