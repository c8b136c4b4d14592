"""Depths of a painted sphere by plane sweep: right where views agree, doubted where nothing tells."""

from dataclasses import replace

import numpy as np
import pytest

import engine.light.fitting.plane_sweep
from engine.light.fitting.plane_sweep import sweep
from engine.light.fitting.training_views import Photographs, camera_centres
from engine.light.gaussians.rasterize import thread_pool
from tests.engine.light.painted import CAMERA, RADIUS, clouds, photographed, poses

LENS = np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])
NO_POINTS = np.zeros((0, 3))


def freckled(points: np.ndarray) -> np.ndarray:
    """Clouds with freckles, so that every patch is like no other."""
    freckles = np.sin(9 * points[..., :1]) * np.sin(11 * points[..., 1:2]) * np.sin(10 * points[..., 2:])
    return clouds(points) * np.exp(0.8 * freckles)


def grey(points: np.ndarray) -> np.ndarray:
    return np.full((*points.shape[:-1], 3), 0.7)


def views(paint, path: float = 1.0) -> tuple[Photographs, np.ndarray]:
    """Photographs with a masked object in the middle, and the wall's z; the cameras' path is so many times as long."""
    cam_from_world = poses()
    cam_from_world[:, :, 3] *= path
    radiance, depth = photographed(cam_from_world, paint)
    weight = np.ones(depth.shape, np.float32)
    weight[:, 14:34, 22:42] = 0
    radiance[weight == 0] = 400
    return Photographs(cam_from_world, LENS, radiance, weight, np.zeros(depth.shape, bool)), depth


def swept(photographs: Photographs, points: np.ndarray = NO_POINTS) -> tuple[np.ndarray, np.ndarray]:
    with thread_pool() as run:
        return sweep(photographs, points, 40, run)


def on_the_wall(count: int) -> np.ndarray:
    directions = np.random.default_rng(1).normal(size=(count, 3))
    return RADIUS * directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def room() -> tuple[Photographs, np.ndarray]:
    return views(freckled)


def test_depths_are_right_where_they_are_sure_and_unbiased(room: tuple[Photographs, np.ndarray]):
    photographs, true = room
    depth, sure = swept(photographs, on_the_wall(200))
    shown = photographs.weight > 0
    assert np.isfinite(depth[shown]).all()
    assert np.isnan(depth[~shown]).all()
    assert (sure[~shown] == 0).all()
    off = np.log(depth / true)
    certain = sure > 0.5
    assert certain[shown].mean() > 0.7
    assert np.mean(np.abs(off[certain]) > 0.2) < 0.005
    assert np.median(np.abs(off[certain])) < 0.02
    # Near depths have fewer and closer witnesses, which must not make them likelier.
    assert abs(np.mean(off[shown])) < 0.02


def test_without_points_the_depths_come_from_the_views_alone(room: tuple[Photographs, np.ndarray]):
    photographs, true = room
    depth, sure = swept(photographs)
    off = np.abs(np.log(depth / true))
    assert np.mean(off[photographs.weight > 0] > 0.2) < 0.01
    assert np.mean(off[sure > 0.5] > 0.2) < 0.005


def test_a_far_wall_is_far_without_points_too():
    """From a path of a fortieth of the way to the wall."""
    photographs, true = views(freckled, 0.06)
    centres = camera_centres(photographs)
    assert 30 * np.linalg.norm(centres - centres.mean(0), axis=1).max() < RADIUS
    depth, _ = swept(photographs)
    assert abs(np.median(np.log(depth / true)[photographs.weight > 0])) < 0.2


def test_walls_without_texture_are_never_sure():
    depth, sure = swept(views(grey)[0])
    assert np.isfinite(depth).any()
    assert sure.max() == 0


def test_noise_below_zero_leaves_no_hole(room: tuple[Photographs, np.ndarray]):
    photographs, true = room
    radiance = photographs.radiance.copy()
    radiance[:, 5, 5] = -10 * np.abs(radiance).max()
    depth, _ = swept(replace(photographs, radiance=radiance), on_the_wall(200))
    shown = photographs.weight > 0
    assert np.isfinite(depth[shown]).all()
    assert np.median(np.abs(np.log(depth / true)[shown])) < 0.02


def test_a_few_wrong_points_do_not_draw_depths_near(room: tuple[Photographs, np.ndarray]):
    photographs, true = room
    wall = on_the_wall(200)
    strays = 0.15 * on_the_wall(3)
    wrong = np.abs(np.log(swept(photographs, np.concatenate([wall, strays]))[0] / true)) > 0.2
    assert np.mean(wrong[photographs.weight > 0]) < 0.02


def test_points_that_stand_alone_do_not_move_the_walls():
    """Some points of every reconstruction are wrong; where nothing tells, the depth is that of the rest."""
    photographs, true = views(grey)
    right = on_the_wall(200)
    stray = 0.3 * right[::4]
    depth, _ = swept(photographs, np.concatenate([right, stray]))
    shown = photographs.weight > 0
    assert np.median(np.abs(np.log(depth / true))[shown]) < 0.06


def test_no_view_votes_for_itself_where_others_look_the_same_way(monkeypatch: pytest.MonkeyPatch):
    """Two rounds of a turntable: every orientation twice."""
    photographs, _ = views(freckled)
    half = len(photographs.weight) // 2
    twice = np.concatenate([photographs.cam_from_world[:half]] * 2)
    asked = []
    monkeypatch.setattr(
        engine.light.fitting.plane_sweep, "_agreement", lambda *a: asked.append((a[3], *a[4]))
    )
    swept(replace(
        photographs, cam_from_world=twice, radiance=photographs.radiance[: 2 * half],
        weight=photographs.weight[: 2 * half], clipped=photographs.clipped[: 2 * half],
    ))  # fmt: skip
    assert len(asked) == 2 * half
    for one, *others in asked:
        assert one not in others
        assert (one + half) % (2 * half) in others
