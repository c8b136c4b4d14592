"""Where the room is empty: in front of what several views are sure to see.

A place is voted free by a view that surely sees farther through it, and supported by a view that sees a
surface about there. The cameras and the rig swept through a ball around each camera that reaches most of
the way to the nearest surface; nothing of the room can be there. World frame; depths are z of their view.
"""

from dataclasses import dataclass, replace
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit
from scipy.ndimage import minimum_filter
from scipy.spatial import KDTree

from engine.light.fitting.training_views import Photographs, camera_centres, project_point

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
_SURE = 0.5
_THROUGH, _ABOUT = 0.85, 1.15  # of the seen depth: nearer is free, between the two is the surface
DOUBTED = 0.95
"""Share of a swept depth up to which a view looks that is not sure of it: one in thirty is a fifth off."""


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """Depths that views are sure of, and the radius around each camera in which nothing stands."""

    cam_from_world: Float[np.ndarray, "n 3 4"]
    lens: Float[np.ndarray, " 4"]
    depth: Float[np.ndarray, "n h w"]  # NaN off the background
    sure: Float[np.ndarray, "n h w"]
    centres: Float[np.ndarray, "n 3"]
    radii: Float[np.ndarray, " n"]
    votes: int  # views that must look through a place for it to be free


@njit(**_FLAGS)
@no_type_check
def _votes(poses, lens, depth, sure, points, free, support):
    views, height, width = depth.shape
    for p in range(points.shape[0]):
        for i in range(views):
            u, v, z = project_point(poses[i], lens, points[p, 0], points[p, 1], points[p, 2])
            if u < 0 or v < 0 or u >= width or v >= height:
                continue
            seen = depth[i, int(v), int(u)]
            if not seen > 0 or sure[i, int(v), int(u)] < _SURE:
                continue
            if z < _THROUGH * seen:
                free[p] += 1
            elif z < _ABOUT * seen:
                support[p] += 1


def unsupported(free_space: FreeSpace, points: Float[np.ndarray, "p 3"]) -> np.ndarray:
    """Which places views look through, and hardly any supports."""
    free, support = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    _votes(
        free_space.cam_from_world, free_space.lens, free_space.depth, free_space.sure,
        np.ascontiguousarray(points, dtype=np.float64), free, support,
    )  # fmt: skip
    return (free >= free_space.votes) & (free > 2 * support)


def inside_free_space(
    free_space: FreeSpace, points: Float[np.ndarray, "p 3"], reach: Float[np.ndarray, " p"]
) -> np.ndarray:
    """Which spheres touch the swept volume: the ball around any camera."""
    inside = np.zeros(len(points), bool)
    for centre, radius in zip(free_space.centres, free_space.radii, strict=True):
        inside |= ((points - centre) ** 2).sum(1) < (radius + reach) ** 2
    return inside


def free_depth(free_space: FreeSpace, photographs: Photographs) -> Float[np.ndarray, "n h w"]:
    """The z up to which every pixel of other pictures of the same views is sure to look (float32).

    That is the swept depth where the view was sure, and DOUBTED of it where not; at the edge of something near
    a coarse pixel holds two depths, and the nearest around is taken. 0 off the background.
    """
    reach = np.where(free_space.sure >= _SURE, free_space.depth, DOUBTED * free_space.depth)
    known = np.isfinite(reach)
    nearest = minimum_filter(np.where(known, reach, np.inf), (1, 3, 3))
    nearest = np.where(known, nearest, 0).astype(np.float32)
    return upsampled(nearest, photographs)


def upsampled(
    values: Float[np.ndarray, "n h w"], photographs: Photographs
) -> Float[np.ndarray, "n big_h big_w"]:
    """Values of the pixels of small pictures at those of other pictures of the same views: the nearest one's."""
    _, height, width = photographs.weight.shape
    rows = (np.arange(height) * values.shape[1]) // height
    columns = (np.arange(width) * values.shape[2]) // width
    return np.ascontiguousarray(values[:, rows[:, None], columns])


def free_space_of(
    photographs: Photographs,
    depth: Float[np.ndarray, "n h w"],
    sure: Float[np.ndarray, "n h w"],
    surface: Float[np.ndarray, "m 3"],
    keep_out: float | None,
    votes: int,
) -> FreeSpace:
    """The empty parts of the room, from swept depths and points believed to lie on its surfaces.

    A sweep that had no SfM points to lean on (`votes` 2) needs a second view's word. `keep_out` fixes the radius
    around every camera; None derives each camera's own.
    """
    centres = camera_centres(photographs)
    radii = np.full(len(centres), keep_out or 0.0)
    free_space = FreeSpace(photographs.cam_from_world, photographs.lens, depth, sure, centres, radii, votes)
    if keep_out is not None:
        return free_space
    solid = surface[~unsupported(free_space, surface)]
    solid = solid if len(solid) >= 30 else surface
    # The nearest thousandth may be wrong depths; the ball reaches six tenths of the way to the rest.
    rank = max(3, len(solid) // 1000)
    return replace(free_space, radii=0.6 * KDTree(solid).query(centres, k=[rank])[0][:, 0])
