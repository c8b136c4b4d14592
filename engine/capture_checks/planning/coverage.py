"""Which directions of the room have been seen: unclipped, clipped only, or not at all.

Directions are counted as if the room were far away, on a Fibonacci sphere of the world in which `Turned` says how
the camera stood; the object hides what is behind it. A direction matters as much as it lights the side of the object
that the camera sees, over all shots: for a ball that is Lambert's phase law, Lambert (1760), by the angle between
the direction and the way to the camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, UInt8
from scipy.spatial import KDTree

from engine.geometry import fibonacci_sphere

DIRECTIONS = 2000  # 4.5 degrees apart
UNSEEN, CLIPPED, SEEN = 0, 1, 2
COMMON_DOWN = 0.4  # length of the mean of the cameras' "down", below which they have none in common
# Colours of the panorama: where nobody looked, and where every look was clipped.
UNSEEN_RGB, CLIPPED_RGB = (58, 44, 84), (214, 70, 48)


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What a camera sees of a room, without where it stands; on a small grid over its picture."""

    focal: float  # in widths of the picture
    free: Bool[np.ndarray, "h w"]  # the object does not hide the room here


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What one shot showed, on the grid of `Sight`."""

    clipped: Bool[np.ndarray, "h w"]
    light: Float32[np.ndarray, "h w"]  # luminance, any unit common to all shots


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """The room as the shots have shown it, in their world."""

    directions: Float64[np.ndarray, "d 3"]  # unit, world
    state: UInt8[np.ndarray, " d"]  # UNSEEN, CLIPPED or SEEN
    shots: UInt8[np.ndarray, " d"]  # how many saw it, up to 255
    light: Float32[np.ndarray, " d"]  # mean over those, NaN unseen; lower bounds where CLIPPED
    weight: Float64[np.ndarray, " d"]  # how much it matters to the object; sums to 1
    placed: int  # shots counted
    left_out: int  # shots that could not be placed among them

    @property
    def share(self) -> float:
        """Of the whole sphere: seen, clipped or not."""
        return float((self.state != UNSEEN).mean())

    @property
    def share_unclipped(self) -> float:
        return float((self.state == SEEN).mean())


def sight(focal: float, object_mask: Bool[np.ndarray, "h w"]) -> Sight:
    """From a mask on any grid; a margin is kept, for nobody knows the outline exactly."""
    grown = cv2.dilate(object_mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    return Sight(focal, grown == 0)


def seen_by(
    sight: Sight, cam_from_world: Float[np.ndarray, "3 3"], directions: Float[np.ndarray, "d 3"]
) -> tuple[Bool[np.ndarray, " d"], np.ndarray, np.ndarray]:
    """Which directions a camera turned so sees, and the row and column where (of those seen)."""
    h, w = sight.free.shape
    x, y, z = cam_from_world @ directions.T
    with np.errstate(divide="ignore", invalid="ignore"):
        column = np.floor(w * (sight.focal * x / z + 0.5))
        row = np.floor(w * sight.focal * y / z + h / 2)
    inside = (z > 0) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
    row, column = row[inside].astype(int), column[inside].astype(int)
    free = sight.free[row, column]
    inside[inside] = free
    return inside, row[free], column[free]


def need(
    cam_from_world: Float[np.ndarray, "n 3 3"], directions: Float[np.ndarray, "d 3"]
) -> Float64[np.ndarray, " d"]:
    """How much each direction lights what the camera sees of a ball, summed over shots; sums to 1."""
    total = np.zeros(len(directions))
    for turn in cam_from_world:
        # The way back to the camera is -z; alpha is the phase angle.
        cosine = np.clip(-(directions @ turn[2]), -1, 1)
        alpha = np.arccos(cosine)
        total += (np.sqrt(1 - cosine**2) + (np.pi - alpha) * cosine) / np.pi
    return total / total.sum() if len(cam_from_world) else np.full(len(directions), 1 / len(directions))


def cover(
    sight: Sight, looks: Sequence[Look], cam_from_world: Float[np.ndarray, "n 3 3"], left_out: int = 0
) -> Coverage:
    """The union of what some shots showed, each at its own turn."""
    directions = fibonacci_sphere(DIRECTIONS)
    state = np.zeros(DIRECTIONS, np.uint8)
    shots = np.zeros(DIRECTIONS, np.int64)
    light = np.zeros(DIRECTIONS, np.float32)
    for look, turn in zip(looks, cam_from_world, strict=True):
        seen, row, column = seen_by(sight, turn, directions)
        clear = np.where(look.clipped[row, column], CLIPPED, SEEN).astype(np.uint8)
        state[seen] = np.maximum(state[seen], clear)
        light[seen] += look.light[row, column]
        shots[seen] += 1
    mean = np.where(shots > 0, light / np.maximum(shots, 1), np.nan).astype(np.float32)
    weight = need(cam_from_world, directions)
    return Coverage(
        directions, state, np.minimum(shots, 255).astype(np.uint8), mean, weight, len(looks), left_out
    )


def upright(cam_from_world: Float[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "3 3"] | None:
    """level_from_world: y down on average, z where the first shot looks; None for cameras held every way up."""
    if not len(cam_from_world):
        return None
    down = cam_from_world[:, 1].mean(axis=0)
    size = float(np.linalg.norm(down))
    if size < COMMON_DOWN:
        return None
    down = down / size
    ahead = max(cam_from_world[:, 2], key=lambda z: bool(np.linalg.norm(np.cross(down, z)) > 0.3))
    right = np.cross(down, ahead)
    if np.linalg.norm(right) < 1e-6:
        return None
    right = right / np.linalg.norm(right)
    return np.stack([right, down, np.cross(right, down)])


def panorama(
    coverage: Coverage, level_from_world: Float[np.ndarray, "3 3"], height: int = 180
) -> UInt8[np.ndarray, "h w 3"]:
    """The coverage as a picture: the room in grey where seen, two colours where not or only clipped.

    Equirectangular, axes as in `types.Panorama`: the middle column looks along +z of the level world, up is up.
    """
    v, u = np.mgrid[:height, : 2 * height]
    theta, phi = np.pi * (v + 0.5) / height, np.pi * (u + 0.5) / height - np.pi
    level = np.stack([np.sin(theta) * np.sin(phi), -np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)
    nearest = KDTree(coverage.directions).query(level @ level_from_world)[1]
    known = coverage.light[coverage.state != UNSEEN]
    middle = float(np.median(known)) if len(known) and np.median(known) > 0 else 1.0
    light = np.nan_to_num(np.maximum(coverage.light, 0)) / middle
    grey = np.rint(255 * light / (light + 1.0)).astype(np.uint8)
    colours = np.repeat(grey[:, None], 3, axis=1)
    colours[coverage.state == UNSEEN] = UNSEEN_RGB
    colours[coverage.state == CLIPPED] = CLIPPED_RGB
    return colours[nearest]
