"""Gauss-Newton on pixels: what stands still is not evaluated again, and comes out as if it had been."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.data.observations import PLAIN
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.gauss_newton import CONFIG, PixelEstimate, PixelProblem, initial_estimate, medoid
from engine.surface.rendering.transport import TransportModel, predict
from tests.engine.surface.lighting.test_light_calibration import TRUE_Z, parts_of_lamps, sample_of


@dataclass
class Counted:
    """Rows that remember how many variants of how many pixels were asked for."""

    rows: TransportModel
    asked: list[tuple[int, int]] = field(default_factory=list)

    @property
    def incident(self):
        return self.rows.incident

    def block(self, geometry, pixels):
        return self.rows.block(geometry, pixels)

    def __call__(self, block, normals, roughness):
        self.asked.append(roughness.shape)
        return self.rows(block, normals, roughness)


@pytest.fixture(scope="module")
def told() -> tuple[gauss_newton.PixelEstimate, PixelProblem]:
    parts = parts_of_lamps(np.random.default_rng(9), False)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    return state, sample.problem(parts.with_gains(np.ones((4, 3))), TRUE_Z)


def iterated(
    told, state: gauss_newton.PixelEstimate, passes: int, config: gauss_newton.GaussNewtonConfig = CONFIG
) -> tuple[gauss_newton.PixelEstimate, int]:
    """The state after so many passes, and how many variants of pixels were asked for on the way."""
    _, problem = told
    counted = Counted(problem.transport)
    found = gauss_newton.minimize(
        state, replace(problem, transport=counted), passes, Progress(), config=config
    )
    return found, sum(pixels * variants for pixels, variants in counted.asked)


def moved(told) -> gauss_newton.PixelEstimate:
    """Some degrees and a tenth of albedo away from the truth."""
    state, problem = told
    lean = np.random.default_rng(1).normal(0, 0.05, (len(state.normals), 2))
    state = replace(
        state, normals=gauss_newton.rotate_normals(state.normals, lean), albedo=0.9 * state.albedo
    )
    return gauss_newton.update_residual_scale(state, problem)


def test_what_stands_still_comes_out_as_if_it_had_been_evaluated_to_the_end(told):
    start = moved(told)
    afresh = replace(CONFIG, jacobian_reuse_step=-1.0)
    found, asked = iterated(told, start, 9, afresh)
    whole, every = iterated(told, start, 9, replace(afresh, step_tolerance=(0.0,) * 7))
    assert every == 9 * (4 + 1) * len(start.normals)  # the first once more, to the shared light
    assert asked < 0.8 * every
    assert np.degrees(angle_between(found.normals, whole.normals)).max() < 0.2
    np.testing.assert_allclose(found.albedo, whole.albedo, rtol=5e-3)
    assert np.isfinite(found.cost).all()


def test_a_pixel_at_rest_is_evaluated_once_and_stays(told):
    still, _ = iterated(told, moved(told), 12)
    again, asked = iterated(told, still, 6)
    assert asked < 1.2 * (4 + 1) * len(still.normals)
    assert np.degrees(angle_between(still.normals, again.normals)).max() < 0.2


def test_small_steps_keep_the_derivatives_and_come_out_the_same(told):
    start = moved(told)
    found, asked = iterated(told, start, 12)
    afresh, every = iterated(told, start, 12, replace(CONFIG, jacobian_reuse_step=-1.0))
    assert asked < 0.75 * every
    assert np.degrees(angle_between(found.normals, afresh.normals)).max() < 0.2
    np.testing.assert_allclose(found.albedo, afresh.albedo, rtol=5e-3)
    np.testing.assert_allclose(found.roughness, afresh.roughness, atol=0.01)


def test_answers_to_small_steps_are_those_to_none_and_what_the_step_changed(told):
    state, problem = told
    pixels, transport = problem.blocks[0], problem.transport
    block, at = transport.block(problem.geometry, pixels), state.part(pixels)
    before, after = (gauss_newton._evaluate(transport, block, at, True) for _ in range(2))
    far = np.arange(len(pixels)) % 3 == 0
    lean = np.where(far[:, None], 0.2, 0.01) * np.ones((len(pixels), 2))
    at = replace(at, normals=gauss_newton.rotate_normals(at.normals, lean))
    gauss_newton._update_evaluations(transport, block, at, after, far, CONFIG)
    whole = transport(block, *gauss_newton.perturbed(at.normals, at.roughness))
    for some, every, old in zip(after.variants, whole, before.variants, strict=True):
        np.testing.assert_allclose(some[far], every[far], rtol=1e-5, atol=1e-7)
        # Lamps are near: what sets the pixels apart has changed a little with the step.
        np.testing.assert_allclose(some[~far, 0], every[~far, 0], rtol=0.02, atol=2e-3 * every.max())
        kept = (some - some[:, :1])[~far], (old - old[:, :1])[~far]
        np.testing.assert_allclose(*kept, rtol=1e-4, atol=1e-6)


def test_a_block_of_a_few_has_what_reaches_them(told):
    state, problem = told
    transport, pixels = problem.transport, problem.blocks[0]
    block, few = transport.block(problem.geometry, pixels), np.arange(0, len(pixels), 2)
    whole = transport(block, state.normals[pixels][:, None], state.roughness[pixels][:, None])
    part = transport(
        block.part(few), state.normals[pixels[few]][:, None], state.roughness[pixels[few]][:, None]
    )
    for all_of_them, some in zip(whole, part, strict=True):
        np.testing.assert_allclose(some, all_of_them[few], rtol=1e-5, atol=1e-7)


def test_a_share_of_what_is_beside_the_rim_is_found_and_does_not_lean_the_normals(told):
    state, problem = told
    pixels, rng = np.arange(0, len(state.normals), 3), np.random.default_rng(4)
    seen, truth = problem.observations, rng.uniform(0.0, 0.5, len(pixels)).astype(np.float32)
    beside = rng.permuted(seen.radiance[pixels].reshape(len(pixels), -1, 3), axis=1).reshape(len(pixels), -1)
    radiance = seen.radiance.copy()
    radiance[pixels] += truth[:, None] * (beside - radiance[pixels])
    row = np.full(len(state.normals), -1)
    row[pixels] = np.arange(len(pixels))
    errors = {}
    for name, rows in (("told", row), ("untold", np.full_like(row, -1))):
        there = replace(problem, observations=replace(seen, radiance=radiance, row=rows, beside=beside))
        found, _ = iterated((state, there), moved((state, there)), 15)
        errors[name] = np.degrees(angle_between(found.normals, state.normals))
        if name == "told":
            np.testing.assert_allclose(
                found.background_fraction[pixels], truth, atol=0.035
            )  # the prior's pull
            assert not np.delete(found.background_fraction, pixels).any()
    assert np.median(errors["told"][pixels]) < 0.1 * np.median(errors["untold"][pixels])
    others = np.delete(np.arange(len(row)), pixels)
    np.testing.assert_allclose(errors["told"][others], errors["untold"][others], atol=0.05)


def test_a_system_without_its_share_steps_the_others_as_the_whole_one_does():
    rng = np.random.default_rng(0)
    jacobian, misfit = rng.normal(size=(5, 40, 7)), rng.normal(size=(5, 40))
    system = np.einsum("pvi,pvj->pij", jacobian, jacobian)
    slope = np.einsum("pvi,pv->pi", jacobian, misfit)
    left, pull = gauss_newton.eliminate_last(system, slope)
    whole = np.linalg.solve(system, slope[..., None])[..., 0]
    np.testing.assert_allclose(np.linalg.solve(left, pull[..., None])[..., 0], whole[:, :6])
    np.testing.assert_allclose(np.linalg.inv(left), np.linalg.inv(system)[:, :6, :6])


def test_without_robust_weights_the_misfit_is_the_sum_of_squares_however_small(told):
    """What a noise-free pixel misfits by is far below one, of which the robust measure takes the logarithm."""
    state, problem = told
    seen = replace(problem.observations, cauchy=100 * PLAIN)
    problem = replace(problem, observations=seen)
    state = gauss_newton.update_residual_scale(replace(state, albedo=1.001 * state.albedo), problem)
    found, _ = iterated((state, problem), state, 1)
    expected = np.zeros(len(state.normals))
    for pixels, sent in predict(
        problem.transport, problem.geometry, problem.blocks, state.normals, state.albedo, state.roughness
    ):
        eps = seen.eps[pixels][:, None]
        logs = np.log((seen.radiance[pixels] + eps) / (sent.reshape(len(pixels), -1) + eps))
        expected[pixels] = (seen.weight[pixels] * logs**2).sum(1)
    off = (state.roughness - state.roughness_prior[:, 0]) / state.roughness_prior[:, 1]
    expected += (off * found.residual_scale) ** 2
    assert np.median(expected - (off * found.residual_scale) ** 2) < 1
    np.testing.assert_allclose(found.cost, expected, rtol=1e-3)


def test_the_medoid_of_states_is_the_one_nearest_to_all_at_every_pixel():
    def state(tilts_deg: tuple[float, ...], albedo: float) -> PixelEstimate:
        tilt = np.radians(tilts_deg)
        normals = np.stack([np.sin(tilt), 0 * tilt, -np.cos(tilt)], axis=1)
        return initial_estimate(normals, np.full((len(tilt), 3), albedo), np.full(len(tilt), 0.5))

    states = [state((0, 40, 0), 0.1), state((1, 0, 10), 0.2), state((30, 2, 20), 0.3)]
    assert medoid(states).albedo[:, 0] == pytest.approx([0.2, 0.3, 0.2])
    assert medoid(states[:1]).albedo[:, 0] == pytest.approx([0.1, 0.1, 0.1])
