"""Radiance that changes with the direction: learnt where walls shine, left alone where they are matt."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import rays
from engine.light.gaussians import radiance_towards
from engine.light.train import LightParams, LightReport, fit
from engine.progress import Progress
from engine.types import Frames, Gaussians, Masks, Poses
from tests.engine.light.painted import CAMERA, RADIUS, VIEWS, clouds, photographed, poses

PARAMS = LightParams(budget=1500, width=64, passes=(4, 6), holdout=8)
TOWARDS = np.array([0.48, -0.6, 0.64])
SHEEN = 3.0  # by how much a wall brightens per unit that the direction leans from straight on


def photographs(sheen: float) -> tuple[Frames, Masks, Poses]:
    """A painted sphere whose walls shine towards one side."""
    cam_from_world = poses(0.3)
    radiance, depth = photographed(cam_from_world, clouds)
    for view, pose in enumerate(cam_from_world):
        towards = rays(CAMERA)
        centre = -pose[:, :3].T @ pose[:, 3]
        wall = centre + (depth[view] / towards[..., 2])[..., None] * towards @ pose[:, :3]
        straight = wall / np.linalg.norm(wall, axis=-1, keepdims=True)
        seen = (wall - centre) / np.linalg.norm(wall - centre, axis=-1, keepdims=True)
        radiance[view] *= np.maximum(1 + sheen * ((seen - straight) @ TOWARDS), 0.05)[..., None]
    nowhere = np.zeros((VIEWS, CAMERA.height, CAMERA.width), bool)
    frames = Frames(tuple(map(str, range(VIEWS))), radiance, nowhere, nowhere, (1e-4, 1e-3))
    given = Poses(CAMERA, cam_from_world, np.ones(VIEWS, bool), np.zeros((0, 3)), "given", np.nan)
    return frames, Masks(nowhere[0], ~nowhere), given


@pytest.fixture(scope="module")
def shining() -> tuple[Gaussians, LightReport]:
    gaussians, _, report = fit(*photographs(SHEEN), PARAMS, 0, Progress())
    return gaussians, report


def test_walls_that_shine_are_seen_to(shining: tuple[Gaussians, LightReport]):
    gaussians, report = shining
    assert report.degree >= 1
    _, _, plain = fit(*photographs(SHEEN), replace(PARAMS, degree=0), 0, Progress())
    assert plain.degree == 0
    assert report.heldout_log_l1 < 0.85 * plain.heldout_log_l1
    # From where a Gaussian is seen leaning towards the bright side it is the brighter.
    visible = np.linalg.norm(gaussians.means, axis=1) > 2
    there, here = (radiance_towards(gaussians, side * 0.4 * TOWARDS)[visible].sum() for side in (-1, 1))
    # A direction leans by 0.4 / 3 of what of `TOWARDS` lies across it: two thirds, mean over the sphere.
    lean = SHEEN * 0.4 / RADIUS * 2 / 3
    assert there / here == pytest.approx((1 + lean) / (1 - lean), rel=0.2)


def test_matt_walls_keep_one_colour():
    _, _, report = fit(*photographs(0.0), PARAMS, 0, Progress())
    assert report.degree == 0


def test_nothing_grows_without_views_to_judge_by():
    gaussians, _, report = fit(*photographs(SHEEN), replace(PARAMS, holdout=0), 0, Progress())
    assert report.degree == 0
    assert gaussians.radiance.shape[1] == 1
