"""Pixels expect the roughness of what looks alike, and begin again from there where theirs is far off."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.optimize import gauss_newton, roughness_prior
from engine.surface.optimize.roughness_prior import (
    apply_roughness_prior,
    expected_roughness,
    with_roughness_prior,
)
from tests.engine.surface.lighting.test_light_calibration import TRUE_Z, parts_of_lamps, sample_of

MASK = np.ones((24, 30), bool)


def two_materials() -> tuple[gauss_newton.PixelEstimate, np.ndarray]:
    """A dull dark left half, a glossy bright right half, one pixel in nine lost; and the truth."""
    right = np.broadcast_to(np.arange(30) >= 15, MASK.shape)[MASK]
    truth = np.where(right, 0.3, 0.7)
    albedo = np.where(right, 0.6, 0.2)[:, None] * np.random.default_rng(0).normal(1, 0.02, (len(right), 3))
    roughness = truth.copy()
    roughness[::9] = 0.9
    state = gauss_newton.initial_estimate(np.tile([0.0, 0.0, -1.0], (len(right), 1)), albedo, roughness)
    return replace(
        state, residual_scale=np.ones(len(right)), hessian=np.tile(1e4 * np.eye(6), (len(right), 1, 1))
    ), truth


def test_the_roughness_of_what_looks_alike_is_expected_also_by_what_is_lost():
    state, truth = two_materials()
    mean, spread = expected_roughness(state, MASK).T
    np.testing.assert_allclose(mean, truth, atol=0.02)
    assert spread.max() < 0.1


def test_those_who_do_not_know_are_not_heard():
    state, _ = two_materials()
    knows_little = state.roughness == 0.9
    knows_little[:] |= np.arange(len(knows_little)) % 3 > 0
    roughness = np.where(knows_little, 0.9, state.roughness)  # most of them, but none is sure
    system = np.where(knows_little[:, None, None], 20 * np.eye(6), state.hessian)
    mean, _ = expected_roughness(replace(state, roughness=roughness, hessian=system), MASK).T
    assert (mean < 0.75).mean() > 0.95


def test_what_looks_like_nothing_else_expects_what_is_expected_of_anything():
    state, _ = two_materials()
    albedo = state.albedo.copy()
    albedo[100] = [0.9, 0.01, 0.9]
    np.testing.assert_array_equal(
        expected_roughness(replace(state, albedo=albedo), MASK)[100], gauss_newton.CONFIG.roughness_prior
    )


def test_metal_is_not_asked_what_paint_of_its_colour_expects():
    state, _ = two_materials()
    grey = replace(state, albedo=np.full_like(state.albedo, 0.4))
    metal = np.nonzero(MASK)[1] >= MASK.shape[1] // 2
    roughness = np.where(metal, 0.3, 0.7)
    made = np.stack([np.full(len(metal), 0.5), metal], 1)
    mean, _ = expected_roughness(replace(grey, roughness=roughness), MASK, made).T
    np.testing.assert_allclose(mean, roughness)


@pytest.fixture(scope="module")
def solved():
    parts = parts_of_lamps(np.random.default_rng(9), False)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    problem = sample.problem(parts.with_gains(np.ones((4, 3))), TRUE_Z)
    state = gauss_newton.update_residual_scale(state, problem)
    return gauss_newton.minimize(state, problem, 2, Progress()), problem


def test_another_expectation_is_as_if_the_state_had_been_evaluated_under_it(solved):
    state, problem = solved
    told = np.random.default_rng(1).uniform(0.1, 0.5, (len(state.normals), 2))
    now = with_roughness_prior(state, told)
    again = replace(state, roughness_prior=told, cost=np.full(len(told), np.inf))
    again = gauss_newton.minimize(again, problem, 1, Progress())
    for name in ("cost", "hessian", "gradient"):
        np.testing.assert_allclose(getattr(now, name), getattr(again, name), rtol=2e-3, atol=1e-3)


def test_a_pixel_far_off_begins_again_and_keeps_what_explains_better(solved, monkeypatch):
    truth, problem = solved
    lost = np.arange(0, len(truth.normals), 4)
    lean = np.zeros((len(truth.normals), 2))
    lean[lost] = 0.2
    normals, roughness = gauss_newton.rotate_normals(truth.normals, lean), truth.roughness.copy()
    roughness[lost] = 1.0
    gone = gauss_newton.initial_estimate(normals, truth.albedo, roughness)
    gone = gauss_newton.minimize(gauss_newton.update_residual_scale(gone, problem), problem, 1, Progress())
    told = np.column_stack([truth.roughness, np.full(len(roughness), 0.1)])
    monkeypatch.setattr(roughness_prior, "expected_roughness", lambda *_: told)
    found = apply_roughness_prior(gone, problem, MASK, 8, Progress())
    assert (found.cost <= with_roughness_prior(gone, told).cost + 1e-9).all()
    assert np.abs(found.roughness - truth.roughness)[lost].max() < 0.05
    assert np.degrees(angle_between(found.normals, truth.normals))[lost].max() < 4.0  # of eleven
    others = np.delete(np.arange(len(roughness)), lost)
    np.testing.assert_array_equal(found.normals[others], gone.normals[others])


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_handful_of_pixels_expects_what_is_expected_of_anything(count: int):
    mask = np.zeros(MASK.shape, bool)
    mask.flat[:count] = True
    state = gauss_newton.initial_estimate(
        np.tile([0.0, 0.0, -1.0], (count, 1)), np.full((count, 3), 0.5), np.full(count, 0.2)
    )
    assert (expected_roughness(state, mask) == gauss_newton.CONFIG.roughness_prior).all()
