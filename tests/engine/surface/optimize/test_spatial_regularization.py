"""Neighbours decide what a pixel's photographs leave open, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from engine.surface.optimize.gauss_newton import PixelEstimate, initial_estimate
from engine.surface.optimize.spatial_regularization import regularize_spatially

SIDE = 24
MASK = np.ones((SIDE, SIDE), bool)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def dome() -> np.ndarray:
    """Normals of a cap of a sphere, in row order."""
    v, u = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE - 0.5
    return np.stack([u, v, -np.sqrt(1 - u**2 - v**2)], -1).reshape(-1, 3)


def known_to(tilt: float, log_albedo: float, roughness: float, rng: np.random.Generator) -> PixelEstimate:
    """The dome as solved from photographs that know it to these standard errors, every pixel for itself."""
    truth = dome()
    count = len(truth)
    errors = np.array([tilt, tilt, log_albedo, log_albedo, log_albedo, roughness])
    drawn = rng.normal(size=(count, 6)) * errors
    normals = truth + np.cross(drawn[:, :3] * [1, 1, 0], truth)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    state = initial_estimate(normals, np.exp(np.log(0.4) + drawn[:, 2:5]), 0.5 + drawn[:, 5])
    system = np.tile(np.diag(1 / errors**2), (count, 1, 1))
    return replace(state, residual_scale=np.ones(count), hessian=system)


def angles(state: PixelEstimate) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((state.normals * dome()).sum(1), -1, 1)))


def test_what_is_left_open_comes_nearer_to_the_truth(rng: np.random.Generator) -> None:
    before = known_to(0.02, 0.05, 0.1, rng)
    after = regularize_spatially(before, MASK)
    assert angles(after).mean() < 0.7 * angles(before).mean()
    assert np.abs(after.roughness - 0.5).mean() < 0.6 * np.abs(before.roughness - 0.5).mean()
    assert np.abs(after.albedo - 0.4).mean() < 0.7 * np.abs(before.albedo - 0.4).mean()


def test_a_curved_surface_stays_curved(rng: np.random.Generator) -> None:
    after = regularize_spatially(known_to(1e-4, 1e-3, 1e-3, rng), MASK)
    assert angles(after).max() < 0.1


def test_what_the_photographs_know_stands(rng: np.random.Generator) -> None:
    """One pixel unlike all others, and sure of it; and the same pixel when it is not sure."""
    state = known_to(0.01, 0.02, 0.05, rng)
    middle = SIDE * SIDE // 2 + SIDE // 2
    state.roughness[middle], state.albedo[middle] = 0.9, 0.1
    unsure = regularize_spatially(state, MASK)
    state.hessian[middle] *= 1e6
    sure = regularize_spatially(state, MASK)
    assert sure.roughness[middle] == pytest.approx(0.9, abs=0.01)
    assert sure.albedo[middle] == pytest.approx(0.1, abs=0.005)
    state.hessian[middle] *= 1e-8
    assert regularize_spatially(state, MASK).roughness[middle] == pytest.approx(0.5, abs=0.1)
    assert unsure.roughness[middle] < 0.9


def test_an_edge_of_colour_stays_sharp(rng: np.random.Generator) -> None:
    state = known_to(0.01, 0.02, 0.05, rng)
    right = np.tile(np.arange(SIDE) >= SIDE // 2, SIDE)
    state.albedo[right] *= 0.5
    columns = regularize_spatially(state, MASK).albedo.reshape(SIDE, SIDE, 3).mean((0, 2))
    assert columns[: SIDE // 2] == pytest.approx(0.4, rel=0.03)
    assert columns[SIDE // 2 :] == pytest.approx(0.2, rel=0.03)


def test_pixels_without_neighbours_on_both_sides_keep_their_answers(rng: np.random.Generator) -> None:
    state = known_to(0.02, 0.05, 0.1, rng).part(np.arange(2))
    mask = np.zeros((3, 4), bool)
    mask[1, 1:3] = True
    after = regularize_spatially(state, mask)
    for name in ("normals", "albedo", "roughness"):
        assert getattr(after, name) == pytest.approx(getattr(state, name), abs=1e-6)


def test_a_turn_of_the_picture_turns_the_answer(rng: np.random.Generator) -> None:
    state = known_to(0.02, 0.05, 0.1, rng)
    order = np.arange(SIDE * SIDE).reshape(SIDE, SIDE).T.ravel()
    turned = regularize_spatially(state.part(order), MASK)
    assert turned.roughness == pytest.approx(regularize_spatially(state, MASK).roughness[order], abs=1e-9)
