"""A small session of linear images with a given mask: quick to make, real to every part of the application."""

from pathlib import Path

import cv2
import numpy as np

from engine import importing
from tests.engine import folders
from tests.engine.folders import write_exr

VIEWS, WIDTH, HEIGHT = 8, 32, 24


def photographs(folder: Path) -> Path:
    """Eight views in a new folder `renders`, and `mask.png` beside it."""
    place = folder / "renders"
    place.mkdir(parents=True)
    for i in range(VIEWS):
        write_exr(place / f"{i:04d}.exr", folders.scene(i, WIDTH, HEIGHT))
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[8:16, 10:20] = 255
    cv2.imwrite(str(folder / "mask.png"), mask)
    return place


def small(folder: Path, name: str = "a.session") -> Path:
    """A session of them."""
    importing.make_session(photographs(folder), folder / name, mask=folder / "mask.png")
    return folder / name
