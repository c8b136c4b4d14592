"""A surface known in closed form: a sphere in front of a tilted wall, seen by a pinhole."""

import numpy as np

from engine.geometry import rays
from engine.types import Camera, Surface

CAMERA = Camera(64, 48, 70.0, 70.0, 31.0, 25.0)
CENTRE = np.array([0.02, -0.01, 1.0])
RADIUS = 0.25


def ball(camera: Camera = CAMERA, wall: bool = False) -> Surface:
    """The sphere; with `wall` also a plane 0.6 behind its centre, so that depth steps at the outline."""
    ray = rays(camera)
    along = ray @ CENTRE
    root = along**2 - CENTRE @ CENTRE + RADIUS**2
    mask = root > 0
    points = (along - np.sqrt(np.maximum(root, 0)))[..., None] * ray
    normal = (points - CENTRE) / RADIUS
    if wall:
        facing = np.array([0.2, 0.3, -1.0]) / np.linalg.norm([0.2, 0.3, -1.0])
        reach = (CENTRE + np.array([0, 0, 0.6])) @ facing / (ray @ facing)
        points = np.where(mask[..., None], points, reach[..., None] * ray)
        normal = np.where(mask[..., None], normal, facing)
        mask = np.ones_like(mask)
    row, column = np.indices(mask.shape)
    albedo = np.stack([0.2 + 0.6 * column / camera.width, 0.8 - 0.6 * row / camera.height, 0.3 + 0 * row], -1)
    keep = mask[..., None]
    return Surface(
        mask=mask,
        normal=np.where(keep, normal, 0),
        albedo=np.where(keep, albedo, 0),
        roughness=np.where(mask, 0.2 + 0.5 * column / camera.width, 0),
        depth=np.where(mask, points[..., 2], 0),
        stderr_normal=np.where(mask, 0.02, 0),
        stderr_albedo=np.where(mask, 0.01, 0),
        stderr_roughness=np.where(mask, 0.03, 0),
        residual=np.where(mask, 0.05, 0),
        flags=np.where(mask & ((normal * ray).sum(-1) > -0.2), 1, 0).astype(np.uint8),
    )
