"""Walls that no pixel shows: found where a depth jumps and nowhere else, cut up along the rim, painted as the rim is."""

import numpy as np

from engine.geometry import rays
from engine.surface.visibility.depth_mesh import depth_mesh
from engine.surface.visibility.hidden_surfaces import HiddenSurfacesConfig, patches
from tests.engine.surface.rendering.test_object_pixels import CAMERA, ball

MASK = np.ones((48, 64), bool)
UP, DOWN = 0.5, 0.56
UPPER = np.arange(64) < 32
"""Columns of the upper of two planes that face the camera; between them a wall stands that no pixel shows."""


def step() -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of the two planes."""
    q = rays(CAMERA)
    points = q / q[..., 2:] * np.where(UPPER, UP, DOWN)[None, :, None]
    return points, np.tile([0.0, 0.0, -1.0], (48, 64, 1))


def cut(points, normals, mask, albedo):
    mesh = depth_mesh(points, mask)
    return mesh.pixels, patches(mesh, normals[mask], albedo, mask)


def painted(mask: np.ndarray = MASK) -> np.ndarray:
    """The upper plane bright, the lower one dark."""
    return np.where(UPPER[None, :, None], 0.7, 0.2)[..., [0, 0, 0]].repeat(48, 0)[mask]


def test_a_wall_stands_between_the_columns_where_the_depth_jumps_and_nowhere_else():
    points, normals = step()
    triangles, found = cut(points, normals, MASK, painted())
    column = triangles % 64
    bridges = (column.min(1) == 31) & (column.max(1) == 32)
    np.testing.assert_array_equal((found.of >= 0).all(1), bridges)
    np.testing.assert_array_equal((found.of >= 0).any(1), bridges)


def test_a_wall_looks_away_from_the_solid_across_the_view_and_is_of_the_rims_paint():
    points, normals = step()
    _, found = cut(points, normals, MASK, painted())
    assert (found.normals[:, 0] > 0.99).all()
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1)
    across = (found.normals * found.points).sum(1) / np.linalg.norm(found.points, axis=1)
    assert np.abs(across).max() < 0.05
    np.testing.assert_allclose(found.albedo, 0.7)


def test_patches_lie_on_the_wall_in_bands_from_the_rim_to_the_foot():
    points, normals = step()
    triangles, found = cut(points, normals, MASK, painted())
    walls = found.of[found.of[:, 0] >= 0]
    bands = HiddenSurfacesConfig().bands
    for band in range(bands):
        z = found.points[walls[:, band], 2]
        assert (z >= UP + (DOWN - UP) * band / bands).all()
        assert (z <= UP + (DOWN - UP) * (band + 1) / bands).all()
    # Every patch has members, is in one part, and stands near the triangles that it stands for.
    assert (np.unique(walls) == np.arange(len(found.points))).all()
    np.testing.assert_array_equal(np.sort(np.concatenate(found.parts)), np.arange(len(found.points)))
    middle = points[MASK][triangles[found.of[:, 0] >= 0]].mean(1)
    off = np.abs(found.points[walls[:, 0]] - middle)[:, 1]
    assert off.max() < 3 * DOWN / CAMERA.fx


def test_walls_back_to_back_share_no_patch():
    points, normals = step()
    q = rays(CAMERA)
    ridge = np.isin(np.arange(64), (30, 31))
    points = q / q[..., 2:] * np.where(ridge, UP, DOWN)[None, :, None]
    _, found = cut(points, normals, MASK, painted())
    assert set(np.sign(found.normals[:, 0])) == {-1, 1}
    assert np.abs(found.normals[:, 0]).min() > 0.99


def test_a_ball_has_no_walls():
    mask, normals, points = ball()
    _, found = cut(points, normals, mask, np.full((int(mask.sum()), 3), 0.5))
    assert not len(found.points)
    assert (found.of == -1).all()


def test_rounding_and_more_picture_around_the_object_cut_the_same_patches():
    """A view that is rendered again has stored depth and the whole picture; the solver had neither."""
    points, normals = step()
    mask = MASK.copy()
    mask[:4], mask[44:], mask[:, :5], mask[:, 59:] = False, False, False, False
    _, found = cut(points, normals, mask, painted(mask))
    part = np.s_[4:44, 5:59]
    rounded = points.astype(np.float32).astype(float)
    _, cropped = cut(rounded[part], normals[part], mask[part], painted(mask))
    np.testing.assert_array_equal(found.of, cropped.of)
    np.testing.assert_allclose(cropped.points, found.points, atol=1e-6)
    np.testing.assert_allclose(cropped.normals, found.normals, atol=1e-4)
