"""Turns between the sensor's frame, which everything inside keeps, and the upright picture, which people see.

A camera held on its side or upside down says so in its files' Orientation tag (Exif 2.3, 0x0112); programs that
develop them turn the picture, so that masks, poses and maps made there are of the upright picture. What a person gives
is turned back where it comes in, what a person gets is turned where it goes out, and nothing between knows of it: the
object is rigid to the camera, whichever way up both are held.

A `flip` (`engine/conventions.py`) says how the sensor's picture is turned to stand upright. All turns are about the
optical axis: world frames stay as they are.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar, cast

import numpy as np
from jaxtyping import Float

from engine.conventions import QUARTERS
from engine.types import Camera, Frames, Masks, Poses, Surface, ValidationRenders

Record = TypeVar("Record")


def back(flip: int) -> int:
    """The flip that undoes another."""
    return {5: 6, 6: 5}.get(flip, flip)


def size(width_height: tuple[int, int], flip: int) -> tuple[int, int]:
    """(width, height) of the turned picture."""
    width, height = width_height
    return (height, width) if QUARTERS[flip] % 2 else (width, height)


def rotation(flip: int) -> Float[np.ndarray, "3 3"]:
    """turned_from_given of vectors in the camera's frame."""
    cosine, sine = {0: (1, 0), 3: (-1, 0), 5: (0, 1), 6: (0, -1)}[flip]
    return np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]], np.float64)


def turn_picture(picture: np.ndarray, flip: int, rows: int = 0) -> np.ndarray:
    """A view of the turned picture; `rows` is its axis of rows, the columns' is the next."""
    return np.rot90(picture, QUARTERS[flip], (rows, rows + 1)) if flip else picture


def turn_vectors(vectors: Float[np.ndarray, "*batch 3"], flip: int) -> Float[np.ndarray, "*batch 3"]:
    """Vectors of the camera's frame, of any map or list; where they stand in a map is `turn_picture`'s."""
    return vectors @ rotation(flip).T.astype(vectors.dtype) if flip else vectors


def turn_camera(camera: Camera, flip: int) -> Camera:
    """The camera whose picture is the turned one; radial distortion is the same, tangential is a vector (p2, p1)."""
    if not flip:
        return camera
    right, below = camera.width - camera.cx, camera.height - camera.cy
    cx, cy = {3: (right, below), 5: (camera.cy, right), 6: (below, camera.cx)}[flip]
    width, height = size((camera.width, camera.height), flip)
    fx, fy = (camera.fx, camera.fy) if flip == 3 else (camera.fy, camera.fx)
    p2, p1 = (float(term) for term in rotation(flip)[:2, :2] @ [camera.p2, camera.p1])
    return Camera(width, height, fx, fy, cx, cy, camera.k1, camera.k2, p1, p2)


def turn_poses(cam_from_world: Float[np.ndarray, "*batch 3 4"], flip: int) -> Float[np.ndarray, "*batch 3 4"]:
    """Poses of the turned camera; its world is the same."""
    return rotation(flip) @ cam_from_world if flip else cam_from_world


def turned(record: Record, flip: int) -> Record:
    """A stage's record with all that lies in the camera's frame turned; what lies in the world, or in no frame, stays.

    Arrays of pictures become views of what they were: a session's photographs stay on the disk.
    """
    if not flip:
        return record
    made: Any = record
    match record:
        case Camera():
            made = turn_camera(record, flip)
        case Poses():
            placed = turn_poses(record.cam_from_world, flip)
            made = replace(record, camera=turn_camera(record.camera, flip), cam_from_world=placed)
        case Frames():
            made = turn_pictures(record, flip, ("radiance", "clipped", "dark"), 1)
        case ValidationRenders():
            made = turn_pictures(record, flip, ("radiance",), 1)
        case Masks():
            made = Masks(turn_picture(record.object, flip), turn_picture(record.background, flip, 1))
        case Surface():
            made = turn_maps(record, flip, [item.name for item in fields(record)])
    return cast(Record, made)


def turn_pictures(record: Record, flip: int, names: Sequence[str], rows: int = 0) -> Record:
    """A record with some of its pictures turned, but not the vectors in them; those that are None stay so."""
    pictures = {name: getattr(record, name) for name in names}
    moved = {name: turn_picture(one, flip, rows) for name, one in pictures.items() if one is not None}
    return cast(Record, replace(cast(Any, record), **moved))


def turn_maps(record: Record, flip: int, names: Sequence[str]) -> Record:
    """A record of an object's maps with those turned, and its normals with them."""
    made: Any = turn_pictures(record, flip, names)
    return replace(made, normal=turn_vectors(made.normal, flip))
