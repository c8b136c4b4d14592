"""The photographs' pyramids of sight: their corners, and which one a pixel of the view means.

World frame, scene units; pixels as in orbit.
"""

import numpy as np
from jaxtyping import Bool, Float

from app.viewer.orbit import Orbit, project

EDGES = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1))
"""Pairs of a pyramid's five corners: the apex first, then the picture's corners, clockwise from the upper left."""
REACH_PX = 7.0


def corners(
    cam_from_world: Float[np.ndarray, "n 3 4"], aspect: float, fov: float, depth: float
) -> Float[np.ndarray, "n 5 3"]:
    """Of cameras with vertical field of view `fov` (radians), cut off at `depth`."""
    half = np.tan(fov / 2)
    ends = np.array(
        [[0, 0, 0], *([x * aspect * half, y * half, 1] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))]
    )
    rotation, shift = cam_from_world[:, :, :3], cam_from_world[:, :, 3]
    return np.einsum("ncd,nkc->nkd", rotation, depth * ends - shift[:, None])


def size(cam_from_world: Float[np.ndarray, "n 3 4"], object_depth: float | None) -> float:
    """How long to draw the pyramids: told apart from their neighbours, and a tenth of the way to the object, which they would hide."""
    if len(cam_from_world) == 0:
        return 1.0
    places = -np.einsum("nij,ni->nj", cam_from_world[:, :, :3], cam_from_world[:, :, 3])
    spread = float(np.linalg.norm(np.ptp(places, axis=0)))
    apart = spread / max(len(places) ** 0.5, 1.0)
    length = 0.6 * apart if apart > 0 else 0.25 * (object_depth or 1.0)
    return min(length, 0.1 * object_depth) if object_depth else length


def picked(
    orbit: Orbit,
    pyramids: Float[np.ndarray, "n 5 3"],
    shown: Bool[np.ndarray, " n"],
    x: float,
    y: float,
    width: int,
    height: int,
) -> int | None:
    """The pyramid with an edge at the pixel, else the nearest one that the pixel lies inside of; None: neither."""
    if not shown.any():
        return None
    flat = project(orbit, pyramids, width, height)
    front = shown & (flat[..., 2] > 0).all(1)
    if not front.any():
        return None
    point = np.array([x, y])
    first, last = (flat[:, [edge[end] for edge in EDGES], :2] for end in (0, 1))
    along = last - first
    length = np.maximum((along**2).sum(-1), 1e-12)
    share = np.clip(((point - first) * along).sum(-1) / length, 0, 1)
    away = np.linalg.norm(first + share[..., None] * along - point, axis=-1).min(1)
    away = np.where(front, away, np.inf)
    depth = flat[..., 2].mean(1)
    if away.min() <= REACH_PX:
        # Of several lines as good as equally near, the one in front.
        near = np.nonzero(away <= away.min() + 2)[0]
        return int(near[depth[near].argmin()])
    inside = np.nonzero(front & _holds(flat[:, 1:, :2], point))[0]
    return int(inside[depth[inside].argmin()]) if len(inside) else None


def _holds(quads: Float[np.ndarray, "n 4 2"], point: Float[np.ndarray, " 2"]) -> Bool[np.ndarray, " n"]:
    """Whether convex quadrangles hold a point, whichever way round they run."""
    sides = np.roll(quads, -1, axis=1) - quads
    offset = point - quads
    turn = sides[..., 0] * offset[..., 1] - sides[..., 1] * offset[..., 0]
    return np.asarray((turn >= 0).all(1) | (turn <= 0).all(1))
