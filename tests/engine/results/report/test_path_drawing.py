"""The plan of the path keeps up up, and lengths true."""

import re

import numpy as np
import pytest

from engine.results.report.path_drawing import draw, survey
from engine.types import Gaussians, Poses
from tests.engine.ball import CAMERA
from tests.engine.results.test_metrics import ring


def poses() -> Poses:
    return Poses(CAMERA, ring(24), np.ones(24, bool), np.zeros((0, 3)), "rig", 0.1)


def test_up_is_the_cameras_mean_up():
    # The ring's cameras have the world's -y as up, and the path waves by 0.1 along it.
    plan = survey(poses(), None, np.array([0.0, 0.0, 0.5]))
    assert plan is not None
    assert np.ptp(plan.cameras[:, 1]) == pytest.approx(0.2, abs=0.01)
    assert np.ptp(plan.cameras[:, 0]) == pytest.approx(2.0, abs=0.05)
    assert np.linalg.norm(plan.objects - plan.cameras, axis=-1) == pytest.approx(0.5)
    higher = ring(24)
    centre = -np.einsum("nji,nj->ni", higher[:, :, :3], higher[:, :, 3])
    assert plan.cameras[:, 1] == pytest.approx(-centre[:, 1], abs=1e-9)


def test_the_scale_bar_is_as_long_as_it_says():
    plan = survey(poses(), None, None)
    assert plan is not None
    drawing = draw(plan, True, "metres")
    length = float(re.search(r">([\d.]+) metres<", drawing)[1])
    pixels = float(re.search(r'class="scale" d="M12 \d+h([\d.]+)"', drawing)[1])
    spots = np.array(
        [[float(x), float(y)] for x, y in re.findall(r'"camera" cx="([\d.]+)" cy="([\d.]+)"', drawing)]
    )
    across = np.linalg.norm(spots[0] - spots[12]) * length / pixels
    assert across == pytest.approx(2.0, rel=0.01)


def test_only_the_lamps_that_matter_are_drawn():
    radiance = np.full((10, 1, 3), 0.01)
    radiance[4] = 100.0
    light = Gaussians(
        np.random.default_rng(0).uniform(-1, 1, (10, 3)), np.tile([1.0, 0, 0, 0], (10, 1)),
        np.full((10, 3), 0.1), np.ones(10), radiance,
    )  # fmt: skip
    plan = survey(poses(), light, None)
    assert plan is not None
    assert len(plan.lamps) == 1
    assert plan.lamp_shares[0] == pytest.approx(100 / 100.09)
    assert draw(plan, False, "metres").count('class="lamp"') == 1


def test_no_registered_view_means_no_plan():
    lost = Poses(CAMERA, np.full((3, 3, 4), np.nan), np.zeros(3, bool), np.zeros((0, 3)), "unknown", 0.0)
    assert survey(lost, None, None) is None


def test_a_lamp_far_from_the_path_is_counted_not_drawn():
    light = Gaussians(
        np.array([[0.5, 0, 0.0], [500.0, 0, 0]]), np.tile([1.0, 0, 0, 0], (2, 1)), np.full((2, 3), 0.1),
        np.ones(2), np.array([[[1.0, 1, 1]], [[3.0, 3, 3]]]),
    )  # fmt: skip
    plan = survey(poses(), light, None)
    assert plan is not None
    assert (len(plan.lamps), plan.lamps_beyond) == (0, 1)
    assert (plan.high - plan.low).max() < 5
