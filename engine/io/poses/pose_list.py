"""What a pose file of any format says, by name: names at once, camera and pose of an image when they are asked for.

So only what belongs to the session's photographs is checked. Also lens terms we lack: `Camera` has OpenCV's k1, k2,
p1, p2, and programs that write k3, k4 or skew are accepted when those can express the same lens.
"""

import codecs
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.types import Camera

# What folding may move any point of the image by; below what any feature is located to.
LENS_TOLERANCE_PX = 0.1


@dataclass(frozen=True, slots=True)
class Image:
    """One image of a pose file. Its two functions raise PoseError, or what a damaged number raises in Python."""

    name: str
    camera: Callable[[], Camera]
    pose: Callable[[], Float[np.ndarray, "3 4"]]  # cam_from_world, not yet checked to be rigid
    unplaced: str = ""  # why it has no pose; then neither function is to be called


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """One file's content before it is matched to the session's views."""

    images: tuple[Image, ...]  # as they stand in the file; a name may come twice
    points: Float[np.ndarray, "m 3"]
    scale: str


def text_of(path: Path) -> str:
    """A text file as programs of any system write it: UTF-8 with or without byte order mark, or UTF-16 with one."""
    data = path.read_bytes()
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return data.decode("utf-16" if wide else "utf-8-sig", errors="replace")


def affine(matrix: Any, name: str) -> Float[np.ndarray, "3 4"]:
    """The upper rows of a 4 x 4 matrix whose last row is 0 0 0 1; that row may be left out.

    Raises:
        ValueError: another shape, or another last row, as a matrix written column by column has.
    """
    values = np.array(matrix, dtype=np.float64)
    if values.shape not in ((3, 4), (4, 4)):
        raise ValueError(f"the matrix of {name} is not 4 x 4")
    if not np.allclose(values[3:], [0, 0, 0, 1], rtol=0, atol=1e-6):
        raise ValueError(f"the last row of {name}'s matrix is not 0 0 0 1; is it written by columns?")
    return values[:3]


def folded_lens(camera: Camera, radial: Sequence[float], skew: float, name: str) -> Camera:
    """`camera` with its k1, k2 refitted to a longer radial polynomial (k1, k2, k3, ...) over the image."""
    radial = [*radial, *[0.0] * (2 - len(radial))]
    exact = replace(camera, k1=radial[0], k2=radial[1])
    if not any(radial[2:]) and not skew:
        return exact
    corner_x = max(camera.cx, camera.width - camera.cx) / camera.fx
    corner_y = max(camera.cy, camera.height - camera.cy) / camera.fy
    r = np.linspace(0, math.hypot(corner_x, corner_y), 200)
    wanted = sum(k * r ** (2 * i + 3) for i, k in enumerate(radial))
    basis = np.stack([r**3, r**5], axis=1)
    (k1, k2), *_ = np.linalg.lstsq(basis, wanted, rcond=None)
    off = float(np.abs(basis @ [k1, k2] - wanted).max() * camera.fx + abs(skew) * corner_y)
    if off > LENS_TOLERANCE_PX:
        raise PoseError(
            f"{name}: the lens needs more terms (k3, k4 or skew) than k1, k2, p1, p2: leaving them out would"
            f" move pixels by {off:.2g}; calibrate with k1, k2, p1, p2 only, or undistort the photographs"
        )
    return replace(camera, k1=float(k1), k2=float(k2))
