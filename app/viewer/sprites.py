"""Dots and glows over a picture that has depth, and the ground behind it: what a renderer of meshes does badly.

Pixels are rows from the top; a depth of 0 is nothing there. Dots are hidden by what is nearer and hide what is
further away, one another too. Colours blue green red unused, 0 to 255.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, UInt8
from numba import njit

from app.viewer.parts import Dots, Glows
from app.viewer.protocol import Colour

FADE = 0.35  # strength of a glow in its middle
_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy"}


def grounded(
    colour: Float[np.ndarray, "h w 3"], depth: Float[np.ndarray, "h w"], top: Colour, bottom: Colour
) -> UInt8[np.ndarray, "h w 4"]:
    """A picture (0 to 1) with the ground's gradient where nothing is."""
    image = np.empty((*depth.shape, 4), np.uint8)
    _ground(
        np.ascontiguousarray(colour, np.float32), depth, np.array(top, np.float32),
        np.array(bottom, np.float32), image,
    )  # fmt: skip
    return image


def dot(
    image: UInt8[np.ndarray, "h w 4"],
    depth: Float[np.ndarray, "h w"],
    dots: Dots,
    cam_from_world: Float[np.ndarray, "3 4"],
    focal: float,
    centre: tuple[float, float],
    usual_px: float,
    near: float,
) -> None:
    """Draw dots beyond depth `near` into a picture and its depth."""
    _dots(
        image, depth, dots.points, dots.colours, dots.size, dots.least, dots.most,
        cam_from_world.astype(np.float32), np.float32(focal), np.float32(centre[0]), np.float32(centre[1]),
        np.float32(usual_px), np.float32(near),
    )  # fmt: skip


def glow(
    image: UInt8[np.ndarray, "h w 4"],
    depth: Float[np.ndarray, "h w"],
    glows: Glows,
    cam_from_world: Float[np.ndarray, "3 4"],
    focal: float,
    centre: tuple[float, float],
    least_px: float,
) -> None:
    """Add light around lamps, not in front of what is nearer than they are."""
    for point, colour, reach in zip(glows.points, glows.colours, glows.reach, strict=True):
        x, y, z = cam_from_world[:, :3] @ point + cam_from_world[:, 3]
        if z > 1e-6:
            radius = min(max(focal * reach / z, least_px), 0.75 * image.shape[0])
            u, v = focal * x / z + centre[0], focal * y / z + centre[1]
            _glow(image, depth, colour, np.float32(z - reach), u, v, radius, np.float32(FADE))


def prepare() -> None:
    """Compile, or fetch what an earlier run compiled: seconds that no picture should wait for."""
    depth = np.zeros((4, 4), np.float32)
    image = grounded(np.zeros((4, 4, 3), np.float32), depth, (0, 0, 0), (0, 0, 0))
    points, colours, ones = np.ones((1, 3)), np.zeros((1, 3), np.uint8), np.ones(1, np.float32)
    dots = Dots(points.astype(np.float32), colours, ones, ones, ones)
    dot(image, depth, dots, np.eye(3, 4), 1.0, (2.0, 2.0), 1.0, 0.1)
    glow(image, depth, Glows(points, colours, np.ones(1)), np.eye(3, 4), 1.0, (2.0, 2.0), 1.0)


@njit(**_FLAGS)
@no_type_check
def _ground(colour, depth, top, bottom, image):
    height, width = depth.shape
    for y in range(height):
        share = np.float32((y + 0.5) / height)
        # Half a level to and fro, so that the slow gradient shows no bands.
        for x in range(width):
            if depth[y, x] > 0:
                for c in range(3):
                    image[y, x, 2 - c] = np.uint8(min(colour[y, x, c] * 255 + 0.5, 255))
            else:
                grain = np.float32(((x * 7 + y * 13) ^ (x * y)) & 7) / 8
                for c in range(3):
                    image[y, x, 2 - c] = np.uint8(top[c] + (bottom[c] - top[c]) * share + grain)
            image[y, x, 3] = 255


@njit(**_FLAGS)
@no_type_check
def _dots(image, depth, points, colours, size, least, most, pose, focal, cx, cy, usual, near):
    height, width = depth.shape
    for i in range(len(points)):
        p0, p1, p2 = points[i, 0], points[i, 1], points[i, 2]
        z = pose[2, 0] * p0 + pose[2, 1] * p1 + pose[2, 2] * p2 + pose[2, 3]
        if z <= near:
            continue
        u = focal * (pose[0, 0] * p0 + pose[0, 1] * p1 + pose[0, 2] * p2 + pose[0, 3]) / z + cx
        v = focal * (pose[1, 0] * p0 + pose[1, 1] * p1 + pose[1, 2] * p2 + pose[1, 3]) / z + cy
        radius = min(max(focal * size[i] / z, least[i] * usual), most[i] * usual)
        if u < -radius or v < -radius or u > width + radius or v > height + radius:
            continue
        first_x, last_x = max(int(np.ceil(u - radius - 0.5)), 0), min(int(u + radius - 0.5), width - 1)
        first_y, last_y = max(int(np.ceil(v - radius - 0.5)), 0), min(int(v + radius - 0.5), height - 1)
        for y in range(first_y, last_y + 1):
            dy = y + np.float32(0.5) - v
            for x in range(first_x, last_x + 1):
                dx = x + np.float32(0.5) - u
                if dx * dx + dy * dy <= radius * radius and (depth[y, x] <= 0 or depth[y, x] > z):
                    depth[y, x] = z
                    image[y, x, 0] = colours[i, 2]
                    image[y, x, 1] = colours[i, 1]
                    image[y, x, 2] = colours[i, 0]


@njit(**_FLAGS)
@no_type_check
def _glow(image, depth, colour, near, u, v, radius, strength):
    height, width = depth.shape
    for y in range(max(int(v - radius), 0), min(int(v + radius) + 1, height)):
        for x in range(max(int(u - radius), 0), min(int(u + radius) + 1, width)):
            if 0 < depth[y, x] < near:
                continue
            away2 = ((x + 0.5 - u) ** 2 + (y + 0.5 - v) ** 2) / (radius * radius)
            if away2 < 1:
                share = strength * (1 - away2) ** 3
                for c in range(3):
                    before = image[y, x, c]
                    image[y, x, c] = np.uint8(before + (255 - before) * share * (colour[2 - c] / 255.0))
