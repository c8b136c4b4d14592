"""A scale bar: two points of the object and their true distance, which fix the length of one scene unit.

Light tells shape up to one factor. Points are x, y from the upper left corner of the upright picture, so that the first
pixel's centre is at (0.5, 0.5), as in `engine/geometry.py`. Lengths inside stay in scene units: what a person gets is
scaled where it goes out, as pictures are turned (`engine/orientation.py`).
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from jaxtyping import Float

from engine.errors import SurfaceError
from engine.geometry import unproject
from engine.io import scale_edit
from engine.io.scale_edit import Point, ScaleBar
from engine.types import Camera, Emitters, Gaussians, Lamps, Poses, Surface, part_of

Record = TypeVar("Record")

REMEDY = "choose two points of one part of the object"


def factor(bar: ScaleBar, surface: Surface, camera: Camera) -> float:
    """Metres per scene unit of an upright surface; on any pixel grid over the same picture.

    Raises:
        SurfaceError: the depth between the points is not determined, or they are one.
    """
    (part, end), (other_part, other_end) = (
        on_surface(point, bar.size, surface, camera) for point in bar.points
    )
    if part != other_part or (surface.part is not None and part == 0):
        raise SurfaceError(
            "the scale's points lie on different parts of the depth, whose offset is less certain than the shape of one;"
            f" {REMEDY}"
        )
    apart = float(np.linalg.norm(other_end - end))
    if not apart > 0:
        raise SurfaceError(f"the scale's two points are one; {REMEDY}, far from one another")
    return bar.length_m / apart


def on_surface(
    point: Point, size: tuple[int, int], surface: Surface, camera: Camera
) -> tuple[int, Float[np.ndarray, " 3"]]:
    """The part of the depth at a point of a picture of `size`, and where it is, camera frame.

    Raises:
        SurfaceError: it is off the object.
    """
    # Averaging by a whole factor drops the last columns and rows that do not fill a block.
    at = np.array(point) / max(round(size[0] / camera.width), 1)
    part, depth = _depth(surface, at)
    return part, np.append(unproject(camera, at), 1.0) * depth


def factor_of(folder: Path, surface: Surface, camera: Camera) -> float | None:
    """Metres per scene unit of an upright surface of the session in `folder`; None where its scale is not given.

    Raises:
        SessionError: the file is damaged.
        SurfaceError: the depth between the points is not determined.
    """
    bar = scale_edit.read(folder)
    try:
        return None if bar is None else factor(bar, surface, camera)
    except SurfaceError as error:
        raise SurfaceError(f"{folder / 'edits' / scale_edit.FILE}: {error}, or remove the file") from error


def _depth(surface: Surface, at: Float[np.ndarray, " 2"]) -> tuple[int, float]:
    """The part at a point, and the depth between the pixels of that part around it."""
    height, width = surface.mask.shape
    column, row = (int(x) for x in np.floor(at))
    inside = 0 <= column < width and 0 <= row < height
    if not inside or not surface.mask[row, column] or not surface.depth[row, column] > 0:
        raise SurfaceError(
            f"the scale's point {at[0]:.1f}, {at[1]:.1f} (of {width} x {height}) is off the object; {REMEDY}"
        )
    known, parts = surface.mask & (surface.depth > 0), part_of(surface)
    left, top = (int(x) for x in np.floor(at - 0.5))
    weights, depths = [], []
    for y in (top, top + 1):
        for x in (left, left + 1):
            if 0 <= x < width and 0 <= y < height and known[y, x] and parts[y, x] == parts[row, column]:
                weights.append((1 - abs(at[0] - 0.5 - x)) * (1 - abs(at[1] - 0.5 - y)))
                depths.append(float(surface.depth[y, x]))
    return int(parts[row, column]), float(np.average(depths, weights=weights))


def scaled(record: Record, by: float) -> Record:
    """A stage's record with its lengths in metres, of which a scene unit has `by`; what has no length stays."""
    made: Any = record
    match record:
        case Poses():
            placed = record.cam_from_world.copy()
            placed[..., 3] *= by
            made = replace(record, cam_from_world=placed, points=by * record.points, scale="scale bar")
        case Surface():
            depth, parts = (
                x if x is None else x * np.float32(by) for x in (record.depth, record.stderr_part)
            )
            made = replace(record, depth=depth, stderr_part=parts)
        case Gaussians():
            made = replace(record, means=by * record.means, scales=by * record.scales)
        case Lamps():
            made = replace(record, centres=by * record.centres, radii=by * record.radii)
        case Emitters():
            made = replace(record, gaussians=scaled(record.gaussians, by), lamps=scaled(record.lamps, by))
    return cast(Record, made)
