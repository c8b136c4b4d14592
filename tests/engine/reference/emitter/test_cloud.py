"""Rows under the paper's training: their slopes are those of Eq. (5), Adam is Adam, and growth keeps its rules."""

import numpy as np
import pytest

from engine.light.gaussians.gaussians import Y00, radiance_towards
from engine.light.gaussians.rasterize import backward, shapes, thread_pool
from engine.reference.emitter import cloud as rows
from engine.reference.emitter.two_stage import log_l1
from tests.engine.light import clouds


def cloud_of(count: int, degree: int, seed: int = 0) -> rows.Cloud:
    """Needles and blobs of several colours in front of the origin."""
    rng = np.random.default_rng(seed)
    cloud = rows.finer_harmonics(rows.begin(clouds.scattered(count, seed).means, np.ones((count, 3))), degree)
    cloud.rows[:, 3:7] = rng.normal(size=(count, 4))
    cloud.rows[:, 7:10] = np.log(rng.uniform(0.1, 0.4, (count, 3)))
    cloud.rows[:, 10] = rng.uniform(-2, 2, count)
    cloud.rows[:, 11:] += rng.normal(size=(count, 3 * (degree + 1) ** 2))
    return cloud


@pytest.mark.parametrize("degree", [0, 1])
def test_slopes_are_the_finite_differences_of_eq_5(degree: int) -> None:
    cloud, view = cloud_of(5, degree, 3), clouds.view(16, 12, 3)
    target = np.random.default_rng(1).uniform(0, 2, (12, 16, 3)).astype(np.float32)
    gaussians = rows.gaussians_of(cloud)
    colours = radiance_towards(gaussians, view.origin)
    share, nothing = np.full((12, 16), 1 / 192, np.float32), np.zeros((12, 16), np.float32)
    with thread_pool(1) as run:
        _, gradients = backward(shapes(gaussians), colours, view, 0.0, target, share, 1.0, 0.0, nothing, run)
    found = np.zeros_like(cloud.rows)
    found[gradients.index] = rows.slopes(cloud, gradients, colours, view.origin)
    expected, step = np.zeros_like(found), 1e-6
    for at in np.ndindex(found.shape):
        ends = []
        for sign in (1, -1):
            before = cloud.rows[at]
            cloud.rows[at] += sign * step
            rendered = clouds.traced(rows.gaussians_of(cloud), view)[..., :3]
            ends.append(log_l1(target.reshape(-1, 3).astype(np.float64), rendered.reshape(-1, 3)))
            cloud.rows[at] = before
        expected[at] = (ends[0] - ends[1]) / (2 * step)
    # How harmonics turn as a mean moves is left out on purpose.
    groups = [slice(3, 7), slice(7, 10), slice(10, 11), slice(11, None)] + [slice(0, 3)] * (degree == 0)
    for group in groups:
        gap = np.linalg.norm(found[:, group] - expected[:, group])
        assert gap < 2e-3 * np.linalg.norm(expected[:, group]), group


def test_adam_worked_by_hand() -> None:
    table, first, second = np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 1))
    with thread_pool(1) as run:
        for step, slope in ((1, 2.0), (2, -1.0)):
            place = np.array([0, -1])
            rows.adam(table, first, second, place, np.array([[slope]]), np.array([0.5]), step, run)
    # Step 1 goes by the rate. Step 2: m = (0.9 * 0.2 - 0.1) / 0.19, v = (0.999 * 0.004 + 0.001) / 0.001999.
    assert table[0, 0] == pytest.approx(-0.5 - 0.5 * (0.08 / 0.19) / np.sqrt(0.004996 / 0.001999), rel=1e-9)
    assert table[1, 0] == 0


def test_the_small_are_cloned_the_large_split_and_the_calm_stay() -> None:
    cloud = cloud_of(3, 0)
    cloud.rows[:, 7:10] = np.log([[0.1] * 3, [0.001] * 3, [0.1] * 3])
    cloud.pulled[:], cloud.seen[:] = [1.0, 1.0, 0.0], 4
    cloud.first[:] = 1.0
    grown = rows.densified(cloud, extent=1.0, most=100, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(grown.rows[:3], cloud.rows[[1, 2, 1]])
    np.testing.assert_allclose(np.exp(grown.rows[3:, 7:10]), 0.1 / 1.6)
    assert 0 < np.linalg.norm(grown.rows[3:, :3] - cloud.rows[0, :3], axis=1).max() < 0.4
    np.testing.assert_array_equal(grown.first[:, 0], [1, 1, 0, 0, 0])
    assert not grown.pulled.any()
    full = rows.densified(cloud, extent=1.0, most=3, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(full.rows, cloud.rows)


def test_a_reset_leaves_all_faint_and_pruning_takes_the_fainter() -> None:
    cloud = cloud_of(4, 0)
    cloud.rows[1, 10] = -6.0  # opacity 0.0025
    rows.make_faint(cloud)
    opacity = -np.expm1(-rows.gaussians_of(cloud).density)
    np.testing.assert_allclose(opacity, [0.01, 1 / (1 + np.exp(6)), 0.01, 0.01], rtol=1e-6)
    assert len(rows.pruned(cloud).rows) == 3


def test_a_start_is_faint_and_as_large_as_its_neighbours_are_far() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float64)
    begun = rows.gaussians_of(rows.begin(square, np.full((4, 3), 2.0)))
    np.testing.assert_allclose(begun.scales, np.sqrt(2 * (1 + 1 + 2) / 3))
    np.testing.assert_allclose(-np.expm1(-begun.density), 0.1)
    np.testing.assert_allclose(begun.radiance[:, 0] * Y00, 2.0)
