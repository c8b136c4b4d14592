"""What a pose file of any format says, before it is matched to the photographs, and lens terms we lack.

`Camera` has OpenCV's k1, k2, p1, p2. Programs that write k3, k4 or skew are accepted when the terms that
`Camera` has can express the same lens.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.types import Camera

# What folding may move any point of the image by; below what any feature is located to.
LENS_TOLERANCE_PX = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """One file's content before it is matched to the session's views."""

    camera: Camera
    poses: Mapping[str, Float[np.ndarray, "3 4"] | None]  # by name in the file; None: unaligned
    partial: bool  # the format leaves out views that were not aligned
    points: Float[np.ndarray, "m 3"]
    scale: str
    notes: tuple[str, ...]


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
