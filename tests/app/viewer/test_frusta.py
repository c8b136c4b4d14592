"""The cameras' pyramids, and which one a click means."""

import numpy as np
import pytest

from app.viewer import frusta, orbit
from app.viewer.orbit import Orbit

EYE = Orbit((0.0, 0.0, 0.0), 4.0)
WIDTH, HEIGHT = 800, 600


def at(x: float, z: float = 0.0) -> np.ndarray:
    """cam_from_world of a camera at (x, 0, z) that looks along +z."""
    return np.concatenate([np.eye(3), [[-x], [0], [-z]]], axis=1)


def pixel(point: np.ndarray) -> tuple[float, float]:
    x, y, _ = orbit.project(EYE, point, WIDTH, HEIGHT)
    return float(x), float(y)


def test_corners_are_where_a_pinhole_has_them() -> None:
    (pyramid,) = frusta.corners(at(1.0)[None], aspect=2.0, fov=np.radians(90), depth=0.5)
    np.testing.assert_allclose(
        pyramid,
        [[1, 0, 0], [0, -0.5, 0.5], [2, -0.5, 0.5], [2, 0.5, 0.5], [0, 0.5, 0.5]],
        atol=1e-12,
    )


def test_a_click_on_an_edge_finds_its_camera() -> None:
    pyramids = frusta.corners(np.stack([at(-1.0), at(1.0)]), 1.5, 0.8, 0.5)
    shown = np.array([True, True])
    for view in (0, 1):
        x, y = pixel((pyramids[view, 0] + pyramids[view, 2]) / 2)
        assert frusta.picked(EYE, pyramids, shown, x + 3, y, WIDTH, HEIGHT) == view


def test_a_click_inside_finds_the_nearest_camera() -> None:
    pyramids = frusta.corners(np.stack([at(0.0, 1.0), at(0.0, -1.0)]), 1.5, 0.8, 0.5)
    x, y = pixel(np.array([0.12, 0.0, -0.5]))
    for order, nearest in (((0, 1), 1), ((1, 0), 0)):
        assert (
            frusta.picked(EYE, pyramids[list(order)], np.array([True, True]), x, y, WIDTH, HEIGHT) == nearest
        )


def test_a_click_beside_finds_none() -> None:
    pyramids = frusta.corners(at(0.0)[None], 1.5, 0.8, 0.5)
    assert frusta.picked(EYE, pyramids, np.array([True]), 20, 20, WIDTH, HEIGHT) is None
    assert frusta.picked(EYE, pyramids[:0], np.zeros(0, bool), 20, 20, WIDTH, HEIGHT) is None


def test_cameras_behind_the_eye_or_not_there_are_not_found() -> None:
    pyramids = frusta.corners(np.stack([at(0.0, -9.0), at(0.0)]), 1.5, 0.8, 0.5)
    x, y = pixel(np.array([0.1, 0.04, 0.5]))
    assert frusta.picked(EYE, pyramids, np.array([True, False]), x, y, WIDTH, HEIGHT) is None


def test_pyramids_end_well_before_the_object() -> None:
    poses = np.stack([at(x) for x in np.linspace(-5, 5, 10)])
    assert frusta.size(poses, 0.3) == pytest.approx(0.03)
    assert frusta.size(poses, None) < 5
    assert frusta.size(poses[:1], 2.0) > 0
    assert frusta.size(poses[:0], None) > 0
