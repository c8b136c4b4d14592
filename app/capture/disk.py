"""Is there room for the rest of a capture? Told before anything moves, and again once the first files are known.

Sizes are bytes. Every photograph lies on the disk once: it is downloaded beside the session's shots and renamed.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

from app.capture.order import CaptureError, Order
from engine.io.session import nearest_existing
from hardware.interfaces import CameraFeatures

# A full-frame camera of 24 to 33 Mpx; lossless compression where the maker has it.
TYPICAL_BYTES = {
    ".dng": 40_000_000, ".cr3": 30_000_000, ".cr2": 30_000_000, ".nef": 35_000_000, ".arw": 40_000_000,
    ".raf": 35_000_000, ".rw2": 30_000_000, ".orf": 22_000_000, ".pef": 40_000_000, ".jpg": 10_000_000,
}  # fmt: skip
UNKNOWN_BYTES = 30_000_000
SPARE_BYTES = 50_000_000  # journal, and what other programs write meanwhile
MARGIN = 1.05  # compressed files differ in size


def typical_bytes(suffix: str) -> int:
    """One photograph, as far as its kind tells."""
    return TYPICAL_BYTES.get(suffix.lower(), UNKNOWN_BYTES)


def free_bytes(folder: Path) -> int:
    """Room on the disk that `folder` lies or will lie on."""
    return shutil.disk_usage(nearest_existing(folder)).free


def check_plan(
    folder: Path, order: Order, poses: int, camera: CameraFeatures, free: Callable[[Path], int] = free_bytes
) -> None:
    """
    Raises:
        CaptureError: so many poses do not fit, as far as the camera and its kind of files tell.
    """
    check(folder, poses * len(order.bracket.stops), camera.file_bytes or typical_bytes(camera.suffix), free)


def check(folder: Path, photographs: int, one_bytes: float, free: Callable[[Path], int] = free_bytes) -> None:
    """
    Raises:
        CaptureError: so many photographs of that size do not fit.
    """
    if not photographs:
        return
    needed = round(photographs * one_bytes * MARGIN) + SPARE_BYTES
    there = free(folder)
    if there < needed:
        raise CaptureError(
            f"{folder}: {photographs} photographs of about {one_bytes / 1e6:.3g} MB need {needed / 1e9:.2f} GB, and"
            f" {there / 1e9:.2f} GB are free; free some space, choose another disk, or plan fewer poses"
        )
