"""Depth from normals of shapes whose depth is known, and the parts that nothing but jumps separates."""

import numpy as np
import pytest

from engine.errors import SurfaceError
from engine.geometry import rays
from engine.progress import Progress
from engine.surface.depth import graph_laplacian
from engine.surface.depth.normal_integration import IntegratedDepth, integrate_normals, integrate_parts
from engine.types import Camera
from tests.engine.surface.landscapes import blob, camera_of, on_plate, plate

CAMERA = Camera(160, 120, 150.0, 150.0, 80.0, 60.0)
RAY = rays(CAMERA) / rays(CAMERA)[..., 2:]
SQUARE = np.zeros((120, 160), bool)
SQUARE[20:100, 30:130] = True


def plane(normal, offset):
    """(normals, z) of the plane n . x = offset."""
    n = np.array(normal) / np.linalg.norm(normal)
    return np.broadcast_to(n, RAY.shape).copy(), offset / (RAY @ n)


def sphere(centre, radius):
    r = rays(CAMERA)
    b = r @ centre
    disc = b * b - (centre @ centre - radius**2)
    mask = disc > 1e-4
    points = r * (b - np.sqrt(np.maximum(disc, 0)))[..., None]
    return mask, np.where(mask[..., None], (points - centre) / radius, 0.0), points[..., 2]


def off(depth, z, mask):
    """How far log depth is from the truth's, their median offset aside."""
    apart = np.log(depth[mask] / z[mask])
    return np.abs(apart - np.median(apart))


def integrated(normals, mask, mean=1.0) -> IntegratedDepth:
    return integrate_parts(CAMERA, normals, mask, mean, Progress())


@pytest.mark.parametrize("normal", [(0, 0, -1), (0.3, -0.2, -0.9), (0.9, 0.2, -0.4)])
def test_a_plane_is_exact_to_rounding(normal):
    normals, z = plane(normal, -0.5)
    depth = integrate_normals(CAMERA, normals, SQUARE, 0.7, Progress())
    np.testing.assert_allclose(depth[SQUARE], z[SQUARE] * 0.7 / z[SQUARE].mean(), rtol=1e-9)
    assert not depth[~SQUARE].any()


def test_the_crease_between_two_planes_is_exact():
    left, right = plane((0.5, 0, -0.8), -0.5), plane((-0.5, 0, -0.8), -0.5)
    side = RAY[..., 0] < 0
    normals, z = (
        np.where(side.reshape(side.shape + (1,) * (x.ndim - 2)), x, y)
        for x, y in zip(left, right, strict=True)
    )
    found = integrated(normals, SQUARE)
    assert off(found.depth, z, SQUARE).max() < 1e-9
    assert (found.part[SQUARE] == 1).all()


def test_a_sphere_comes_back_within_a_tenth_of_a_pixel():
    mask, normals, z = sphere(np.array([0.02, 0.01, 0.6]), 0.18)
    error = off(integrate_normals(CAMERA, normals, mask, 1.0, Progress()), z, mask) * CAMERA.fx
    assert np.median(error) < 0.02
    assert error.mean() < 0.1


def test_a_smooth_relief_is_one_part_exact_to_half_a_per_mille():
    camera = camera_of(160, 132)
    mask, normals, z = blob(camera)
    assert off(integrate_normals(camera, normals, mask, 1.0, Progress()), z, mask).max() < 5e-4


def test_what_a_jump_separates_are_two_parts_right_in_themselves():
    ball, ball_normals, ball_z = sphere(np.array([0.0, 0.0, 0.5]), 0.08)
    normals, z = plane((0.1, 0.1, -0.9), -0.72)
    normals[ball], z[ball] = ball_normals[ball], ball_z[ball]
    found = integrated(normals, SQUARE)
    sides = SQUARE & ball, SQUARE & ~ball
    largest = [np.bincount(found.part[side]).argmax() for side in sides]
    assert largest == [2, 1]
    assert found.shares[:2] == tuple((found.part == k).sum() / SQUARE.sum() for k in (1, 2))
    for side, part in zip(sides, largest, strict=True):
        assert (found.part[side] == part).mean() > 0.9
        assert off(found.depth, z, side & (found.part == part)).mean() * CAMERA.fx < 0.2
    assert not found.part[~SQUARE].any()


def test_a_step_does_not_bend_what_lies_on_its_two_sides() -> None:
    """How high it is, normals do not say; here they agree across a little of its edge, and the two are one part."""
    camera = camera_of(160, 132)
    mask, normals, z = plate(camera)
    depth = integrate_normals(camera, normals, mask, 1.0, Progress())
    for side in (mask & on_plate(camera), mask & ~on_plate(camera)):
        assert off(depth, z, side).mean() < 1e-3


def test_noise_bends_the_depth_no_more_than_it_tilts_normals():
    mask, normals, z = sphere(np.array([0.02, 0.01, 0.6]), 0.18)
    noise = np.random.default_rng(5).normal(0, np.radians(2), normals.shape)
    noisy = normals + noise
    noisy /= np.linalg.norm(noisy, axis=2, keepdims=True)
    error = off(integrate_normals(CAMERA, noisy, mask, 1.0, Progress()), z, mask) * CAMERA.fx
    assert np.median(error) < 0.2


def test_normals_that_lean_away_or_are_missing_leave_the_depth_finite_and_the_rest_right():
    normals, z = plane((0.2, 0.1, -0.9), -0.5)
    bad = np.zeros_like(SQUARE)
    bad[30:90:12, 40:120:12] = True
    for wrong in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)):
        normals[bad] = wrong
        depth = integrate_normals(CAMERA, normals, SQUARE, 1.0, Progress())
        assert np.isfinite(depth).all()
        assert off(depth, z, SQUARE & ~bad).max() < 1e-3


@pytest.mark.parametrize("size", [1, 2])
def test_a_pixel_alone_is_as_far_as_it_is_said_to_be(size):
    mask = np.zeros((120, 160), bool)
    mask[7, 9 : 9 + size] = True
    normals, _ = plane((0, 0, -1), -1)
    found = integrated(normals, mask, 2.0)
    np.testing.assert_allclose(found.depth[mask], 2.0)
    assert (found.part[mask] == 1).all()


def test_each_island_keeps_its_own_mean_and_is_a_part():
    mask = np.zeros((120, 160), bool)
    mask[10:50, 10:50] = mask[60:110, 80:150] = mask[2, 3] = True
    normals, _ = plane((0.3, 0.1, -0.9), -1)
    found = integrated(normals, mask, 2.0)
    for island in (np.s_[10:50, 10:50], np.s_[60:110, 80:150], np.s_[2:3, 3:4]):
        assert found.depth[island].mean() == pytest.approx(2.0, rel=1e-9)
        assert np.ptp(found.part[island]) == 0
    assert [found.part[place] for place in ((60, 80), (10, 10), (2, 3))] == [1, 2, 0]  # the last is too small


def test_pixels_that_touch_at_a_corner_hang_together():
    mask = np.zeros((120, 160), bool)
    mask[20:40, 20:40] = mask[40:60, 40:60] = True
    normals, z = plane((0.3, 0.1, -0.9), -1)
    assert off(integrate_normals(CAMERA, normals, mask, 1.0, Progress()), z, mask).max() < 1e-9


def test_the_same_normals_give_the_same_bits():
    normals = np.random.default_rng(3).normal(0, 0.3, RAY.shape) - [0, 0, 1]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    small = np.zeros_like(SQUARE)
    small[20:60, 30:80] = True
    one, other = (integrated(normals, small) for _ in range(2))
    assert (one.depth == other.depth).all()
    assert (one.part == other.part).all()


def test_an_empty_mask_is_refused():
    with pytest.raises(SurfaceError, match="empty"):
        integrate_normals(CAMERA, np.zeros((120, 160, 3)), np.zeros((120, 160), bool), 1.0, Progress())


@pytest.mark.parametrize("shape", [blob, plate])
def test_multigrid_and_the_factorisation_find_the_same_depth(monkeypatch: pytest.MonkeyPatch, shape) -> None:
    camera = camera_of(96, 80)
    mask, normals, _ = shape(camera)
    direct = integrate_normals(camera, normals, mask, 1.0, Progress())
    monkeypatch.setattr(graph_laplacian, "DIRECT_SOLVE_PIXELS", int(mask.sum()) - 1)
    large = integrate_normals(camera, normals, mask, 1.0, Progress())
    np.testing.assert_allclose(large[mask], direct[mask], rtol=1e-4)


def test_multigrid_that_does_not_settle_is_an_error_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = camera_of(96, 80)
    mask, normals, _ = blob(camera)
    monkeypatch.setattr(graph_laplacian, "DIRECT_SOLVE_PIXELS", 0)
    monkeypatch.setattr(graph_laplacian, "ITERATIONS", 1)
    with pytest.raises(SurfaceError, match=r"did not converge .*after 1 iterations.*long_edge_px"):
        integrate_normals(camera, normals, mask, 1.0, Progress())
