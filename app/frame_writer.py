"""Pictures of one size, one after the other, as a video or as numbered PNG files.

Either is written under another name beside its own, and gets its own once it is whole. A video is MP4 with VP9, which
browsers and players show, else MPEG-4.
"""

import shutil
from pathlib import Path
from typing import Any

from jaxtyping import UInt8
from numpy import ascontiguousarray, ndarray

from engine.errors import ExportError

VIDEO = ".mp4"
CODECS = ("vp09", "mp4v")
_REMEDY = "choose another folder or free some space"


class FrameWriter:
    """`to` is a video's file, or the PNG files' folder."""

    def __init__(self, to: Path, per_second: int) -> None:
        """
        Raises:
            ExportError: `to` is something that must not be lost.
        """
        self.to, self._per_second = to, per_second
        self._video = to.suffix.lower() == VIDEO
        self._begun = to.with_name(f".{to.stem}.partial{to.suffix}")
        self._writer: Any = None
        self._count = 0
        if not self._video and to.exists() and not (to.is_dir() and not any(to.iterdir())):
            raise ExportError(f"{to}: holds other files; choose a new name")

    def write(self, image: UInt8[ndarray, "h w c"]) -> None:
        """Blue, green, red, and in PNG files alpha where it is given. Videos have even sizes and no alpha.

        Raises:
            ExportError: it cannot be written.
        """
        import cv2

        if self._video:
            height, width = (size // 2 * 2 for size in image.shape[:2])
            self._writer = self._writer or self._opened(width, height)
            self._writer.write(ascontiguousarray(image[:height, :width, :3]))
        else:
            try:
                self._begun.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ExportError(f"{self.to}: cannot be written ({error.strerror}); {_REMEDY}") from error
            if not cv2.imwrite(str(self._begun / f"{self._count:04d}.png"), image):
                raise ExportError(f"{self.to}: cannot be written; {_REMEDY}")
        self._count += 1

    def _opened(self, width: int, height: int) -> Any:
        import cv2

        for codec in CODECS:
            code = cv2.VideoWriter.fourcc(*codec)
            writer = cv2.VideoWriter(
                str(self._begun), cv2.CAP_FFMPEG, code, self._per_second, (width, height)
            )
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
