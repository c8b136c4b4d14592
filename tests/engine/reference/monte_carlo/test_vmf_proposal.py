"""Rays aimed at the light: drawn as their density says, and never at the price of a wrong mean."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from engine.errors import LightError
from engine.geometry import tangents
from engine.light.gaussians.gaussians import Y00
from engine.light.incident.probes import panorama_directions
from engine.reference.monte_carlo.vmf_proposal import Mixture, Proposal, emitted, fit
from engine.types import Gaussians
from tests.engine.light import clouds

UP = np.array([[0.0, 0, 1]])
SURE = 1e-3
"""Chance with which a right sampler would fail a chi-square test; seeds are fixed, so it does not."""


def one_lobe(kappa: float) -> Proposal:
    axis = np.array([0.36, -0.48, 0.8])
    return Proposal(axis[None, None], np.array([[kappa]]), np.ones(1))


def three_lobes() -> Proposal:
    lobes = np.array([[[0.0, 0.6, 0.8], [1.0, 0, 0], [0.0, -0.6, -0.8]]])
    return Proposal(lobes, np.array([[2.0, 40.0, 15.0]]), np.array([0.5, 0.3, 0.2]))


def drawn(proposal: Proposal, count: int, seed: int = 1) -> np.ndarray:
    """Directions that are drawn, n 3; normal up."""
    u = np.random.default_rng(seed).random((1, count, 3))
    directions, density = proposal.sample(UP, u)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1, atol=1e-12)
    np.testing.assert_allclose(density, proposal.pdf(UP, directions))
    return directions[0]


def chance(counted: np.ndarray, expected: np.ndarray) -> float:
    """How likely a right sampler strays so far."""
    assert expected.min() > 5
    return float(chi2.sf(((counted - expected) ** 2 / expected).sum(), counted.size - 1))


@pytest.mark.parametrize("proposal", [one_lobe(1e-3), one_lobe(5.0), one_lobe(300.0), three_lobes()])
def test_the_density_sums_to_one_over_the_sphere(proposal: Proposal):
    height = 400
    directions = panorama_directions(height).reshape(1, -1, 3)
    theta = np.pi * (np.arange(height) + 0.5) / height
    solid = np.repeat(2 * np.sin(np.pi / 2 / height) * np.sin(theta) * np.pi / height, 2 * height)
    light, cosine = proposal.densities(UP, directions)
    assert light[0] @ solid == pytest.approx(1, abs=1e-4)
    assert cosine[0] @ solid == pytest.approx(1, abs=1e-4)
    assert proposal.pdf(UP, directions)[0] @ solid == pytest.approx(1, abs=1e-4)


def test_samples_of_the_mixture_follow_its_density():
    rows, columns, fine, count = 8, 12, 30, 100_000
    proposal = three_lobes()
    directions = drawn(proposal, count)
    row = np.minimum((1 - directions[:, 2]) / 2 * rows, rows - 1e-9).astype(int)
    column = ((np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi)) % 1 * columns).astype(int)
    counted = np.bincount(row * columns + column, minlength=rows * columns)
    z = 1 - 2 * (np.arange(rows * fine) + 0.5) / (rows * fine)
    phi = 2 * np.pi * (np.arange(columns * fine) + 0.5) / (columns * fine)
    z, phi = np.meshgrid(z, phi, indexing="ij")
    flat = np.sqrt(1 - z * z)
    grid = np.stack([flat * np.cos(phi), flat * np.sin(phi), z], -1)
    density = proposal.pdf(UP, grid.reshape(1, -1, 3)).reshape(rows, fine, columns, fine).mean((1, 3))
    assert chance(counted, count * density.ravel() * 4 * np.pi / rows / columns) > SURE


@pytest.mark.parametrize("kappa", [1e-4, 1.0, 50.0, 1e4, 1e8])
def test_samples_of_a_lobe_follow_its_density_however_narrow_it_is(kappa: float):
    # First number below the share of the light: nothing but the lobe. Bins are in 1 - cos and the turn.
    count, fine, turns = 40_000, 200, 6
    proposal, rng = one_lobe(kappa), np.random.default_rng(2)
    u = np.concatenate([np.zeros((count, 1)), rng.random((count, 2))], axis=1)[None]
    axis = proposal.lobes[0]
    first, second = (side[0] for side in tangents(axis))
    directions = proposal.sample(UP, u)[0][0]
    x, y = directions @ first, directions @ second
    drop = ((directions - axis) ** 2).sum(1) / 2
    edges = (
        np.minimum(np.array([0, 0.1, 0.3, 0.7, 1.2, 2, 3, 5]) / kappa, 2.0)
        if kappa > 3
        else np.linspace(0, 2, 8)
    )
    counted, *_ = np.histogram2d(
        drop, np.arctan2(y, x) % (2 * np.pi), [edges, np.linspace(0, 2 * np.pi, turns + 1)]
    )
    h = edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(fine) + 0.5) / fine
    flat = np.sqrt(h * (2 - h))[..., None]
    density, _ = proposal.densities(UP, ((1 - h)[..., None] * axis[0] + flat * first).reshape(1, -1, 3))
    per_bin = density.reshape(h.shape).mean(1) * np.diff(edges) * 2 * np.pi / turns
    expected = count * np.repeat(per_bin[:, None], turns, 1)
    left = count - expected.sum()  # what lies beyond the last edge
    if left > 5:
        counted, expected = np.append(counted, count - counted.sum()), np.append(expected, left)
    assert chance(counted.ravel(), expected.ravel()) > SURE


def test_equation_12_worked_by_hand():
    # A component at (3, 0, 4), concentration 0.7, seen from (0, 0, 0): 5 away, so kappa^ = 10 * 0.7 / 5 = 1.4.
    # The other at (0, 0, -2), concentration 3: kappa^ = 10 * 3 / 2 = 15. Weights stay 0.25 and 0.75.
    mixture = Mixture(
        np.array([[3.0, 0, 4], [0.0, 0, -2]]), np.array([0.7, 3.0]), np.array([0.25, 0.75]), 1.0
    )
    seen = mixture.at(np.zeros((1, 3)))
    np.testing.assert_allclose(seen.lobes[0], [[0.6, 0, 0.8], [0, 0, -1]])
    np.testing.assert_allclose(seen.kappas[0], [1.4, 15.0])
    np.testing.assert_allclose(seen.weights, [0.25, 0.75])
    # At the first mean: 0.25 * 1.4 / (2 pi (1 - exp(-2.8))) = 0.0557042 / 0.9391899 = 0.0593109; the other lobe
    # stands 143 degrees away (cos = -0.8): exp(-15 * 1.8) is nothing.
    light, cosine = seen.densities(UP, np.array([[[0.6, 0, 0.8]]]))
    assert light[0, 0] == pytest.approx(0.0593109, abs=1e-7)
    assert cosine[0, 0] == pytest.approx(0.8 / np.pi)


def test_the_components_are_where_the_gaussians_are_and_as_wide():
    rng = np.random.default_rng(0)
    centres = np.array([[4.0, 0, 0], [0, 5.0, 0], [0, 0, -6.0]])
    counts = [300, 600, 100]
    means = np.concatenate([c + 0.3 * rng.normal(size=(n, 3)) for c, n in zip(centres, counts, strict=True)])
    cloud = Gaussians(
        means,
        np.tile([1.0, 0, 0, 0], (1000, 1)),
        np.full((1000, 3), 0.1),
        np.ones(1000),
        np.ones((1000, 1, 3)),
    )
    found = fit(cloud, 0, 3)
    order = np.argmax(found.means @ centres.T, axis=1).argsort()
    np.testing.assert_allclose(found.means[order], centres, atol=0.06)
    np.testing.assert_allclose(found.weights[order], [0.3, 0.6, 0.1], atol=0.01)
    np.testing.assert_allclose(1 / found.concentrations**2, 0.3**2 + 0.1**2 / 2, rtol=0.15)


def test_weights_move_the_components_to_what_they_favour():
    room = lamplit()
    by_light = fit(room, 0, 8, weights=emitted(room))
    by_centres = fit(room, 0, 8)
    near = [m.weights[np.linalg.norm(m.means - LAMP, axis=1) < 0.3].sum() for m in (by_light, by_centres)]
    # 20 of radiance 300 and three areas of 0.04^2 send 28.6, 1500 of 0.05 and 0.36^2 (a little less opaque) 27.7.
    assert near[0] == pytest.approx(28.6 / (28.6 + 27.7), abs=0.01)
    assert near[1] < 0.02


def test_a_change_of_unit_changes_nothing_if_the_world_changes_too():
    room = lamplit()
    metres = fit(room, 3, 16, 0.7).at(np.array([[0.1, 0.2, 0.3]]))
    large = replace(room, means=1000 * room.means, scales=1000 * room.scales)
    millimetres = fit(large, 3, 16, 700.0).at(np.array([[100.0, 200, 300]]))
    np.testing.assert_allclose(metres.lobes, millimetres.lobes, atol=1e-9)
    np.testing.assert_allclose(metres.kappas, millimetres.kappas, rtol=1e-9)


LAMP, RADIUS = np.array([0.3, -0.2, 1.1]), 0.1


def lamplit() -> Gaussians:
    """A dim shell 3 away, and a lamp of 20 Gaussians, 1.2 from the origin."""
    room, count = clouds.shell(0.05), 20
    spots = LAMP + RADIUS * np.random.default_rng(0).normal(size=(count, 3)) / 2
    return Gaussians(
        np.concatenate([room.means, spots]), np.concatenate([room.quaternions, room.quaternions[:count]]),
        np.concatenate([room.scales, np.full((count, 3), 0.04)]), np.append(room.density, np.full(count, 5.0)),
        np.concatenate([room.radiance, np.full((count, 1, 3), 300 / Y00)]),
    )  # fmt: skip


def test_a_near_lamps_irradiance_comes_out_right_and_with_less_noise_than_by_cosine_alone():
    # A sphere of radiance 300, wholly above the horizon: E = pi L (R / d)^2 cos(theta).
    distance, count = np.linalg.norm(LAMP), 40_000
    exact = np.pi * 300 * (RADIUS / distance) ** 2 * LAMP[2] / distance
    rim = np.sqrt(1 - (RADIUS / distance) ** 2)
    room = lamplit()
    proposal = fit(room, 0, 64, unit=1.0, weights=emitted(room)).at(np.zeros((1, 3)))

    def estimates(directions, density):
        return 300 * (directions @ LAMP / distance > rim) * np.maximum(directions[:, 2], 0) / density

    u = np.random.default_rng(4).random((1, count, 3))
    directions, density = proposal.sample(UP, u)
    mixed = estimates(directions[0], density[0])
    assert abs(mixed.mean() - exact) < 4 * mixed.std() / np.sqrt(count)
    u[..., 0] = 0.999  # the cosine's share
    directions, _ = proposal.sample(UP, u)
    by_cosine = estimates(directions[0], directions[0, :, 2] / np.pi)
    assert abs(by_cosine.mean() - exact) < 4 * by_cosine.std() / np.sqrt(count)
    assert mixed.var() < 0.25 * by_cosine.var()


def test_the_same_seed_gives_the_same_components():
    first, again, other = (fit(lamplit(), seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.means, again.means)
    np.testing.assert_array_equal(first.concentrations, again.concentrations)
    assert len(first.weights) == 64
    assert not np.array_equal(first.means, other.means)


def test_few_gaussians_give_few_components_and_one_is_no_point():
    alone = clouds.scattered(1)
    found = fit(alone, 0)
    assert found.concentrations == pytest.approx((2 / (alone.scales**2).mean()) ** 0.5)
    assert len(fit(clouds.scattered(5), 0).weights) <= 5


def test_a_point_in_a_lobes_middle_and_a_light_that_does_not_shine_are_refused():
    found = fit(clouds.scattered(1), 0)
    with pytest.raises(LightError, match="centre of a light"):
        found.at(found.means)
    with pytest.raises(LightError, match="no Gaussian of the light shines"):
        fit(clouds.scattered(3), 0, weights=np.zeros(3))
