"""What is convex or flat does not shadow itself: the mesh's facets are no wall."""

import numpy as np
import pytest

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.rendering.transport import direction_cells
from engine.surface.visibility.ray_visibility import trace_occlusion
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
    share[mask] = trace_occlusion(points, normals, mask, CELLS, Progress()).hidden_share
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
    share = trace_occlusion(points, normals, mask, CELLS, Progress()).hidden_share
    assert share.max() < 2e-3


def groove() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, normals and mask of two walls at right angles."""
    q = rays(Camera(64, 200, 200.0, 200.0, 32.0, 100.0))
    q = q / q[..., 2:]
    mask = np.zeros(q.shape[:2], bool)
    mask[:, 16:48] = True
    depth = 1.0
    side = np.sign(q[..., 0])
    z = depth / (1 + side * q[..., 0])  # z = depth - |x|
    points = q * z[..., None]
    return points, np.stack([-side, np.zeros_like(side), -np.ones_like(side)], -1) / np.sqrt(2), mask


def test_what_hides_is_seen_only_where_its_own_normal_looks_that_way() -> None:
    """A depth that is wrong puts pixels in each other's way that do not see each other."""
    points, normals, mask = groove()
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(mask.sum())
    albedo = np.full((mask.sum(), 3), 0.5)
    known = trace_occlusion(points, normals, mask, CELLS, Progress(), albedo=albedo)
    turned = normals.copy()
    turned[points[..., 0] > 0] = normals[points[..., 0] < 0][0]
    doubted = trace_occlusion(points, turned, mask, CELLS, Progress(), albedo=albedo)
    for pixel in index[100, 21:30:2]:
        hidden = [one.part(np.array([pixel])) for one in (known, doubted)]
        np.testing.assert_array_equal(hidden[0].direction, hidden[1].direction)
        ahead = CELLS[hidden[0].direction] @ normals[mask][pixel] > 0.05
        seen, unknown = (one.occluder[ahead] for one in hidden)
        assert (points[mask][seen, 0] > 0).all()
        assert (unknown == -1).all()


def test_a_groove_hides_from_its_walls_what_the_other_wall_covers() -> None:
    """Two walls at right angles: of the sky over a strip of one the other hides (1 - s / sqrt(s^2 + l^2)) / 2."""
    points, normals, mask = groove()
    found = np.zeros(mask.shape)
    found[mask] = trace_occlusion(points, normals, mask, direction_cells(2000), Progress()).hidden_share
    row = found[100]
    x = np.abs(points[100, :, 0]) * np.sqrt(2)
    length = np.array([x[47], x[16]])  # of the right wall, and of the left
    for columns, other in ((slice(20, 31), length[0]), (slice(33, 44), length[1])):
        told = (1 - x[columns] / np.hypot(x[columns], other)) / 2
        np.testing.assert_allclose(row[columns], told, atol=0.02)
        assert abs((row[columns] - told).mean()) < 0.004
