"""What the photographs showed of the room, asked per place: was this point in any view's background?

Gaussians stretch and float where no photograph looked; their opacity there proves nothing. A point counts
as shown if it falls on a background pixel of at least one registered view. Furniture between is ignored.
World frame.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from engine.light.fitting.training_views import partly_marked, pinhole_of, project_point, shown_background
from engine.types import Masks, Poses

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """The registered views' backgrounds, small, on an ideal pinhole."""

    cam_from_world: Float[np.ndarray, "n 3 4"]
    lens: Float[np.ndarray, " 4"]  # fx fy cx cy of the small pictures
    shown: Bool[np.ndarray, "n h w"]


def coverage_of(
    masks: Masks, poses: Poses, width: int = 128, without: Bool[np.ndarray, "n h w"] | None = None
) -> Coverage:
    """What the registered views showed, on pictures of about `width` pixels; less what `without` touches in a view."""
    lens, _, _ = pinhole_of(poses.camera, width)
    views = np.nonzero(poses.registered)[0]
    shown = np.stack([shown_background(masks.background[i], poses.camera, width) for i in views])
    if without is not None:
        shown &= ~np.stack([partly_marked(without[i], poses.camera, width) for i in views])
    return Coverage(np.ascontiguousarray(poses.cam_from_world[views]), lens, shown)


@njit(**_FLAGS)
@no_type_check
def _covered(cam_from_world, lens, shown, points, out):
    views, height, width = shown.shape
    recent = 0  # neighbours are mostly shown by the same view
    for p in range(points.shape[0]):
        out[p] = 0.0
        for turn in range(views):
            i = (recent + turn) % views
            u, v, _ = project_point(cam_from_world[i], lens, points[p, 0], points[p, 1], points[p, 2])
            if u < 0 or u >= width or v < 0 or v >= height:
                continue
            if shown[i, int(v), int(u)]:
                out[p] = 1.0
                recent = i
                break


def covered(coverage: Coverage, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, " p"]:
    """1 where some view showed the point, else 0."""
    out = np.empty(len(points))
    _covered(coverage.cam_from_world, coverage.lens, coverage.shown, np.ascontiguousarray(points), out)
    return out
