"""Stated errors hold the truth when neighbouring views and all channels share theirs."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import angle_between
from engine.progress import Progress
from engine.results.metrics import NORMAL_BAND
from engine.surface.optimize import gauss_newton
from engine.surface.rendering.object_pixels import ObjectPixels, observe_object
from engine.surface.rendering.transport import IncidentLight
from engine.surface.uncertainty.standard_errors import (
    LightVariance,
    formal,
    grid_refinement_error,
    jackknife,
    standard_errors,
    unresolved_variance,
)
from tests.engine.surface.rendering.test_object_pixels import (
    CAMERA,
    PARAMS,
    ball,
    light_of_lamps,
    pictures_of_a_ball,
)

VIEWS = 48


def at_the_truth(object_pixels: ObjectPixels, light: IncidentLight, roughness: float):
    """The ball's normals; its state there, spread measured; and what the solver asks besides a state."""
    truth, count = ball()[1][object_pixels.mask], len(object_pixels.observations.eps)
    problem = object_pixels.problem(light, object_pixels.geometry_at(0.5), PARAMS, "cpu")
    state = gauss_newton.initial_estimate(
        truth, np.tile([0.6, 0.4, 0.3], (count, 1)), np.full(count, roughness)
    )
    return truth, gauss_newton.update_residual_scale(state, problem), problem


def judged(together: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Errors of the normals and their standard errors, formal and by leaving out stretches, under exposures 8 % off
    that `together` views in a row share, all channels alike."""
    rng = np.random.default_rng(together)
    light = light_of_lamps(rng, VIEWS, 400)
    frames, mask = pictures_of_a_ball(rng, VIEWS, light)
    off = np.exp(0.08 * rng.normal(size=VIEWS // together).repeat(together))
    # A map of its own for every pixel: one for all would make one draw of the whole ball.
    tilt = np.exp(0.08 * rng.normal(size=(VIEWS // together, *mask.shape)).repeat(together, 0))
    radiance = (frames.radiance * (off[:, None, None] * tilt)[..., None]).astype(np.float32)
    object_pixels = observe_object(replace(frames, radiance=radiance), mask, CAMERA, np.arange(VIEWS), PARAMS)
    truth, state, problem = at_the_truth(object_pixels, light, 0.45)
    for _ in range(2):
        state = gauss_newton.minimize(state, problem, 6, Progress())
        state = gauss_newton.update_residual_scale(state, problem)
    error = np.arccos(np.clip((state.normals * truth).sum(1), -1, 1))
    variances = {
        "formal": formal(state.hessian, state.residual_scale),
        "jackknife": jackknife(state, problem, Progress())[1],
    }
    return {
        name: (
            error,
            standard_errors(state, v, object_pixels.observations, problem.geometry, np.zeros(len(v))).normal,
        )
        for name, v in variances.items()
    }


def share_held(error: np.ndarray, stderr: np.ndarray) -> float:
    return float((error <= NORMAL_BAND * stderr).mean())


@pytest.mark.parametrize("together", [3, 6])
def test_errors_that_neighbouring_views_share_are_held(together: int) -> None:
    told = judged(together)
    assert share_held(*told["jackknife"]) > 0.9
    assert share_held(*told["formal"]) < 0.85  # what it is there for


def test_errors_of_each_view_alone_are_not_blown_up() -> None:
    told = judged(1)
    assert share_held(*told["jackknife"]) > 0.88
    assert np.median(told["jackknife"][1]) < 3.5 * np.median(told["formal"][1])


def test_stretches_sum_to_the_whole_system() -> None:
    rng = np.random.default_rng(0)
    light = light_of_lamps(rng, 24, 400)
    frames, mask = pictures_of_a_ball(rng, 24, light)
    _, state, problem = at_the_truth(observe_object(frames, mask, CAMERA, np.arange(24), PARAMS), light, 0.5)
    state = gauss_newton.minimize(state, problem, 1, Progress())
    _, groups = gauss_newton.hessians_by_view_group(state, problem, 5, Progress())
    # The kernel's own arithmetic is that of single precision.
    system, slope = gauss_newton.eliminate_last(groups.hessian.sum(1), groups.gradient.sum(1))
    np.testing.assert_allclose(system, state.hessian, rtol=1e-4, atol=1e-4 * np.abs(state.hessian).max())
    np.testing.assert_allclose(slope, state.gradient, rtol=1e-4, atol=1e-4 * np.abs(state.gradient).max())


def test_pixels_doubt_the_light_as_those_of_like_normals_do() -> None:
    rng = np.random.default_rng(0)
    up, aside = np.array([0, 0, -1.0]), np.array([0, 0.8, -0.6])
    normals = np.concatenate([one + 0.01 * rng.normal(size=(20, 3)) for one in (up, aside)])
    variance = np.repeat([[1.0] * 6, [4.0] * 6], 20, axis=0)
    told = LightVariance(normals, variance).of(np.stack([up, aside, aside]))
    np.testing.assert_allclose(told, np.repeat([[1.0] * 6, [4.0] * 6], [1, 2], axis=0))
    few = LightVariance(normals[:1], variance[:1]).of(np.stack([up, aside]))
    np.testing.assert_allclose(few, 1)


def test_what_has_come_a_long_way_is_told_as_unsure() -> None:
    normals = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8]])
    before = gauss_newton.initial_estimate(normals, np.full((2, 3), 0.4), np.array([0.5, 0.3]))
    turned = gauss_newton.rotate_normals(normals, np.array([[0.0, 0.0], [0.0, 0.1]]))
    after = gauss_newton.initial_estimate(turned, before.albedo * 1.2, before.roughness)
    variance = grid_refinement_error(before, after)
    assert variance[:, :2].sum(1) == pytest.approx([0, 0.1**2], rel=0.02, abs=1e-12)
    assert variance[:, 2:5] == pytest.approx(np.log(1.2) ** 2)
    assert not variance[:, 5].any()


def tilted(degrees: np.ndarray) -> np.ndarray:
    """Normals that lean so far to the right."""
    lean = np.radians(degrees)
    return np.stack([np.sin(lean), np.zeros_like(lean), -np.cos(lean)], -1)


@pytest.mark.parametrize("turned", [False, True])
def test_where_an_edge_crosses_pixels_their_centres_are_as_unsure_as_they_are_wrong(turned: bool):
    share = np.linspace(0, 1, 101)[:, None]  # of the middle pixel that is left of the edge
    left, right = tilted(np.array([0.0])), tilted(np.array([20.0]))
    middle = share * left + (1 - share) * right
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    wrong = angle_between(middle, np.where(share > 0.5, left, right))
    told = []
    for one in middle:
        row = np.concatenate([left, left, left, one[None], right, right, right])
        normals, mask = np.tile(row, (5, 1, 1)), np.ones((5, 7), bool)
        if turned:
            normals, mask = normals.transpose(1, 0, 2), mask.T
        variance = unresolved_variance(normals, mask, np.zeros(mask.shape))
        told.append(variance[3, 2] if turned else variance[2, 3])
        assert variance[0, 0] < 1e-12
    assert np.sqrt(np.mean(told)) == pytest.approx(np.sqrt((wrong**2).mean()), rel=0.05)


def test_a_surface_that_bends_evenly_hides_nothing_between_its_pixels():
    bent = np.tile(tilted(np.linspace(0, 60, 61)), (9, 1, 1))  # a degree a pixel
    mask, still = np.ones(bent.shape[:2], bool), np.zeros(bent.shape[:2])
    assert np.degrees(np.sqrt(unresolved_variance(bent, mask, still))).max() < 0.01
    noisy = tilted(np.linspace(0, 60, 61) + np.random.default_rng(0).normal(0, 2, (9, 61)))
    known = unresolved_variance(noisy, mask, np.full(mask.shape, np.radians(2)))
    assert np.degrees(np.sqrt(known.mean())) < 2
    assert unresolved_variance(noisy, mask, np.full(mask.shape, np.radians(9))).max() == 0


def test_nothing_is_told_across_the_rim():
    step = np.tile(tilted(np.repeat([0.0, 40.0], 5)), (5, 1, 1))
    mask = np.ones(step.shape[:2], bool)
    mask[:, 5:] = False
    assert unresolved_variance(np.where(mask[..., None], step, 0), mask, np.zeros(mask.shape)).max() == 0
