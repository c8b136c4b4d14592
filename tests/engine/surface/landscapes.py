"""Surfaces in front of a perspective camera whose depth and normals are known by formula."""

import numpy as np

from engine.geometry import unproject
from engine.types import Camera


def camera_of(width: int, height: int) -> Camera:
    """About 50 degrees wide."""
    return Camera(width, height, 1.1 * width, 1.1 * width, width / 2, height / 2)


def blob(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(mask, normals, z) of a bumpy dome in a round mask; smooth, its relief about 12 % of its distance."""
    x, y = _plane(camera)
    z, zx, zy = _dome(x, y)
    return x**2 + y**2 < 0.3**2, _normals(x, y, z, zx, zy), z


def plate(camera: Camera, lean: float = 0.3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same with a tilted plate in front of its middle: a tear all around it, of a height that changes along it."""
    x, y = _plane(camera)
    inside = on_plate(camera)
    z, zx, zy = (
        np.where(inside, *both) for both in zip((0.93 + lean * x, lean, 0), _dome(x, y), strict=True)
    )
    return x**2 + y**2 < 0.3**2, _normals(x, y, z, zx, zy), z


def on_plate(camera: Camera) -> np.ndarray:
    """Where the plate is."""
    x, y = _plane(camera)
    return x**2 + y**2 < 0.12**2


def _plane(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    xy = unproject(camera, np.stack([u, v], -1))
    return xy[..., 0], xy[..., 1]


def _dome(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z and its derivatives on the ideal image plane."""
    z = 1 + 1.2 * (x**2 + y**2) + 0.01 * np.sin(25 * x) * np.cos(20 * y + 0.5)
    zx = 2.4 * x + 0.25 * np.cos(25 * x) * np.cos(20 * y + 0.5)
    zy = 2.4 * y - 0.2 * np.sin(25 * x) * np.sin(20 * y + 0.5)
    return z, zx, zy


def _normals(x: np.ndarray, y: np.ndarray, z: np.ndarray, zx: np.ndarray, zy: np.ndarray) -> np.ndarray:
    """Of the points z (x, y, 1), towards the camera."""
    across = np.stack([z + x * zx, y * zx, zx], -1)
    down = np.stack([x * zy, z + y * zy, zy], -1)
    normal = np.cross(down, across)
    return normal / np.linalg.norm(normal, axis=2, keepdims=True)
