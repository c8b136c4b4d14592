"""The hard cases spoil what they say, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.app.bench.synthetic import VIEWS, stored
from tests.bench import hard_cases

RNG = np.random.default_rng(3)


def test_few_views_keep_their_own_poses_and_backgrounds(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hard_cases, "FEW", 3)
    few = hard_cases.few(stored(), RNG)
    assert few.poses.cam_from_world[:, 0, 3].tolist() == [0, 6, VIEWS - 1]
    assert few.frames.radiance[:, 0, 0, 0].tolist() == [0, 6, VIEWS - 1]
    assert len(few.masks.background) == len(few.poses.registered) == 3


def test_cameras_are_turned_by_half_a_degree_about_their_places():
    before, after = stored().poses.cam_from_world, hard_cases.turned(stored(), RNG).poses.cam_from_world
    turn = after[:, :, :3] @ np.swapaxes(before[:, :, :3], 1, 2)
    angle = np.degrees(np.arccos((np.trace(turn, axis1=1, axis2=2) - 1) / 2))
    assert np.allclose(angle, hard_cases.TURNED_DEG, atol=1e-6)
    places = [-np.einsum("nij,ni->nj", pose[:, :, :3], pose[:, :, 3]) for pose in (before, after)]
    assert np.allclose(places[0], places[1], atol=1e-12)


def test_drift_changes_whole_photographs_by_a_factor_each():
    given = stored()
    after = hard_cases.drifting(given, RNG).frames.radiance
    some = given.frames.radiance > 0
    logs = np.log(after[some] / given.frames.radiance[some])
    view = np.nonzero(some)[0]
    each = [logs[view == v] for v in np.unique(view)]
    assert all(np.ptp(x) < 1e-5 for x in each)
    assert 0.01 < np.std([x[0] for x in each]) < 0.06


def test_strangers_stand_before_the_background_of_their_views_alone():
    given = stored()
    mask = np.zeros(given.masks.background.shape, bool)
    mask[:, :, -1] = True  # no background there
    given.masks.background[mask] = False
    after = hard_cases.passer_by(given, RNG).frames.radiance
    changed = (after != given.frames.radiance).any(-1)
    assert changed.any((1, 2)).nonzero()[0].tolist() == [0, 8]
    assert not changed[mask].any()
    assert hard_cases.moved_chair(given, RNG).frames.radiance[VIEWS // 2].min() < VIEWS // 2


def test_the_screen_flickers_where_it_is_seen_and_nowhere_else():
    given = stored()
    camera = given.poses.camera
    facing = np.array([[0.0, -1, 0, 0.5], [0, 0, -1, 0.98], [1, 0, 0, 0.0]])  # looks along x, right is -y
    on = hard_cases.screen_of(camera, facing)
    v, u = np.nonzero(on)
    # The middle lies on the axis; 0.29 and 0.17 m of 1.597 m away.
    assert u.mean() + 0.5 == pytest.approx(camera.cx, abs=1)
    assert v.mean() + 0.5 == pytest.approx(camera.cy, abs=1)
    assert np.ptp(u) == pytest.approx(2 * 0.29 / 1.597 * camera.fx, abs=2)
    assert np.ptp(v) == pytest.approx(2 * 0.17 / 1.597 * camera.fy, abs=2)
    behind = facing * np.array([[-1.0], [1], [-1]])
    assert not hard_cases.screen_of(camera, behind).any()
    poses = replace(given.poses, cam_from_world=np.tile(facing, (VIEWS, 1, 1)))
    before = given.frames.radiance + 1
    seen = replace(given, poses=poses, frames=replace(given.frames, radiance=before))
    after = hard_cases.flickering(seen, RNG).frames.radiance
    ratio = after[:, on] / before[:, on]
    assert np.ptp(ratio, axis=(1, 2)).max() < 1e-5 < np.ptp(ratio)
    assert ratio.min() > 1 / hard_cases.FLICKER
    assert ratio.max() < hard_cases.FLICKER
    assert (after[:, ~on] == before[:, ~on]).all()
