"""Marks on the surface, between the picture that they are points of and the space that the 3D view shows.

A mark is x and y from the picture's upper left corner, in its widths. Space is the world of the contents, in which the surface
stands where it was in the view whose `pose` (cam_from_world) is given.
"""

import contextlib
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from app.inspect.maps import Maps
from engine.errors import SurfaceError
from engine.geometry import project
from engine.scale_bar import on_surface

Mark = tuple[float, float]


def in_picture(shown: Maps, pose: Float[np.ndarray, "3 4"], point: Float[np.ndarray, " 3"]) -> Mark | None:
    """The mark of a point in space; None where the photographs cannot show it."""
    if shown.camera is None:
        return None
    x, y = project(shown.camera, pose[:, :3] @ point + pose[:, 3]) / shown.camera.width
    return (float(x), float(y)) if np.isfinite(x) else None


def in_space(shown: Maps, pose: Float[np.ndarray, "3 4"], marks: Sequence[Mark]) -> Float[np.ndarray, "n 3"]:
    """Where the marks are that lie on the surface."""
    camera, points = shown.camera, []
    if camera is None:
        return np.empty((0, 3))
    height, width = shown.surface.mask.shape
    for x, y in marks:
        with contextlib.suppress(SurfaceError):
            _, point = on_surface((x * width, y * width), (width, height), shown.surface, camera)
            points.append((shown.metres * point - pose[:, 3]) @ pose[:, :3])
    return np.array(points).reshape(-1, 3)
