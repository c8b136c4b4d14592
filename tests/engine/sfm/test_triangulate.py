"""Promises of `engine.sfm.triangulate`, in the small room ray cast in numpy."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.geometry import inverse
from engine.progress import Progress
from engine.sfm.params import FeatureParams, PoseParams
from engine.sfm.triangulate import triangulate
from engine.types import Camera, Frames, Masks, Poses
from tests.engine import box_room
from tests.engine.sfm.test_reconstruct import as_frames

CAMERA = Camera(320, 240, 250.0, 250.0, 160.0, 120.0, k1=-0.04)
PARAMS = PoseParams(features=FeatureParams(maximum=1000, enlarge_most=1))


@pytest.fixture(scope="module")
def given() -> tuple[Frames, Masks, Poses]:
    truth = box_room.handheld(16, reach=0.6)
    placed = np.ones(16, bool)
    placed[5] = False
    poses = np.where(placed[:, None, None], truth, np.nan)
    frames, masks = as_frames(box_room.render(CAMERA, truth))
    return frames, masks, Poses(CAMERA, poses, placed, np.zeros((0, 3)), "given", math.nan)


def test_points_lie_on_the_walls_of_the_room(given: tuple[Frames, Masks, Poses], tmp_path: Path):
    points, report = triangulate(*given, PARAMS, tmp_path, Progress())
    assert len(points) == report.points > 300
    assert (report.views, report.placed) == (16, 15)
    assert report.reprojection_px < 0.5
    assert (report.judged, report.off, report.off_deg) == (15, (), None)
    off = box_room.distance_to_surfaces(points)
    assert np.median(off) < 0.01
    assert np.percentile(off, 90) < 0.05


def test_poses_that_the_photographs_contradict_are_doubted(
    given: tuple[Frames, Masks, Poses], tmp_path: Path
):
    frames, masks, poses = given
    wrong = poses.cam_from_world.copy()
    for row, world in enumerate(inverse(wrong)):
        # Each camera stands 6 cm off, another way.
        shift = 0.06 * np.array([math.cos(row), math.sin(2 * row), math.sin(row)])
        wrong[row, :, 3] = -wrong[row, :, :3] @ (world[:, 3] + shift)
    _, report = triangulate(frames, masks, replace(poses, cam_from_world=wrong), PARAMS, tmp_path, Progress())
    assert len(report.off) > 10
    assert "v05" not in report.off  # it has no pose
    assert report.off_deg is not None
    assert report.off_deg > 0.2


def test_a_room_without_texture_has_no_points(given: tuple[Frames, Masks, Poses], tmp_path: Path):
    frames, masks, poses = given
    blank = replace(frames, radiance=np.full_like(frames.radiance, 0.3))
    points, report = triangulate(blank, masks, poses, PARAMS, tmp_path, Progress())
    assert points.shape == (0, 3)
    assert math.isnan(report.reprojection_px)
    assert report.off == ()
