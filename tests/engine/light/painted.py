"""A room that is a painted sphere around the origin, and views of it by a camera that looks about near the middle."""

from collections.abc import Callable

import numpy as np

from engine.geometry import rays
from engine.types import Camera
from tests.engine.box_room import look

CAMERA = Camera(64, 48, 45.0, 45.0, 32.0, 24.0)
RADIUS, VIEWS = 3.0, 40


def clouds(points: np.ndarray) -> np.ndarray:
    """Radiance of a wall of coloured clouds."""
    phases = np.array([0.0, 1.0, 2.0])
    waves = np.sin(1.3 * points[..., :1] + phases) + np.cos(1.7 * points[..., 1:2] - points[..., 2:] + phases)
    return 0.5 * np.exp(0.6 * waves)


def poses() -> np.ndarray:
    """All around, up and down, from places 0.2 from the middle (standard deviation)."""
    rng = np.random.default_rng(0)
    return np.stack(
        [
            look(4 * np.pi * i / VIEWS, 0.6 * np.sin(2.4 * i), 0.0, 0.2 * rng.normal(size=3))
            for i in range(VIEWS)
        ]
    )


def photographed(
    cam_from_world: np.ndarray, paint: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Radiance in every view (float32), and the wall's z."""
    directions = rays(CAMERA)
    radiance, depth = [], []
    for pose in cam_from_world:
        d, origin = directions @ pose[:, :3], -pose[:, :3].T @ pose[:, 3]
        along = d @ origin
        reach = -along + np.sqrt(along**2 + RADIUS**2 - origin @ origin)
        radiance.append(paint(origin + reach[..., None] * d))
        depth.append(reach * directions[..., 2])
    return np.stack(radiance).astype(np.float32), np.stack(depth)
