"""Shots of the bundled session with something wrong: made in their RAW files, as a camera would have written them.

Masks are of the full mosaic. Pictures are changed channel by channel, in counts without black, so that no colour
leaks into another.
"""

import datetime
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from engine.io.raw import read_mosaic
from hardware.virtual import dng, sensor

CAMERA = sensor.Sensor()
WHEN = datetime.datetime(2024, 6, 1, 12, 0, 0)

Change = Callable[
    [np.ndarray, np.ndarray], np.ndarray
]  # one channel (h/2 w/2), its place in the cell -> changed


def rewritten(files: list[Path], to: Path, change: Change) -> list[Path]:
    """The bracket with every channel of every exposure changed."""
    to.mkdir(parents=True)
    out = []
    for file in files:
        mosaic = read_mosaic(file)
        counts = mosaic.counts.astype(np.float32) - mosaic.black[0]
        for y in (0, 1):
            for x in (0, 1):
                counts[y::2, x::2] = change(counts[y::2, x::2].copy(), np.array([y, x]))
        level = np.clip(np.rint(counts + mosaic.black[0]), 0, CAMERA.white).astype(np.uint16)
        out.append(to / file.name)
        write(out[-1], level, mosaic.facts.shutter_s)
    return out


def write(path: Path, counts: np.ndarray, shutter_s: float) -> None:
    dng.write(
        path,
        dng.Photograph(
            counts, CAMERA.black, CAMERA.white, CAMERA.camera_from_xyz, CAMERA.neutral(), shutter_s, 100, 8.0, WHEN
        ),
    )  # fmt: skip


def cells(mask: np.ndarray) -> np.ndarray:
    """A mask on the grid of one channel, as shares."""
    return cv2.resize(mask.astype(np.float32), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def moved(mask: np.ndarray, right_px: float, down_px: float) -> Change:
    """The object elsewhere in the picture; where it was, the room nearby is smeared over."""
    matrix = np.array([[1, 0, right_px / 2], [0, 1, down_px / 2]])
    ours = cells(mask)
    hole = cv2.dilate((ours > 0).astype(np.uint8), np.ones((3, 3), np.uint8))

    def change(channel: np.ndarray, place: np.ndarray) -> np.ndarray:
        size = channel.shape[::-1]
        cover = cv2.warpAffine(ours, matrix, size)
        elsewhere = cv2.warpAffine(
            channel, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
        )
        room = cv2.inpaint(channel, hole, 3, cv2.INPAINT_TELEA)
        return cover * elsewhere + (1 - cover) * room

    return change


def within(mask: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Something done to a part of the picture."""
    ours = cells(mask)
    return lambda channel, place: ours * inside(channel) + (1 - ours) * channel


def out_of_focus(sigma_px: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda channel: cv2.GaussianBlur(channel, (0, 0), sigma_px / 2)


def swept(right_px: int) -> Callable[[np.ndarray], np.ndarray]:
    """Moved sideways by so much while it exposed."""
    return lambda channel: cv2.blur(channel, (max(1, right_px // 2), 1))


def brighter(times: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda channel: channel * np.float32(times)
