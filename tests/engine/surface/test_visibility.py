"""What is convex or flat does not shadow itself: the mesh's facets are no wall."""

import numpy as np
import pytest

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.transport import direction_cells
from engine.surface.visibility import occlusion
from engine.types import Camera

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
CELLS = direction_cells(600)


@pytest.mark.parametrize("noise_deg", [0.0, 3.0])
def test_a_ball_hides_nothing_from_itself_but_at_its_rim(noise_deg: float) -> None:
    ray, centre, radius = rays(CAMERA), np.array([0, 0, 0.6]), 0.2
    along = ray @ centre
    root = along**2 - (centre @ centre - radius**2)
    mask = root > 1e-3
    points = ray * (along - np.sqrt(np.maximum(root, 0)))[..., None]
    normals = (points - centre) / radius
    facing = -(normals * ray).sum(2)
    lean = np.random.default_rng(0).normal(0, np.radians(noise_deg), normals.shape)
    normals = normals + lean  # as solved: not quite those of the mesh
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    share = np.zeros(mask.shape)
    share[mask] = occlusion(points, normals, mask, CELLS, Progress()).share
    inner = mask & (facing > 0.4)
    assert inner.sum() > 0.7 * mask.sum()
    assert share[inner].mean() < 1e-3
    assert share[inner].max() < 0.01 + 0.5 * np.radians(noise_deg)


@pytest.mark.parametrize("slant_deg", [0.0, 45.0, 75.0])
def test_a_plane_hides_nothing_from_itself_however_it_is_seen(slant_deg: float) -> None:
    slant = np.radians(slant_deg)
    normal = np.array([np.sin(slant), 0.0, -np.cos(slant)])
    q = rays(CAMERA)
    q = q / q[..., 2:]
    mask = np.zeros(q.shape[:2], bool)
    mask[8:40, 24:40] = True
    z = np.where(mask, 0.6 * normal[2] / np.where(mask, q @ normal, 1), 0.6)
    points = q * z[..., None]
    normals = np.broadcast_to(normal, q.shape).copy()
    share = occlusion(points, normals, mask, CELLS, Progress()).share
    assert share.max() < 2e-3
