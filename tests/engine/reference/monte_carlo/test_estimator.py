"""Eq. (8): the right mean whatever is sampled, less noise where the light is aimed at, and true gradients."""

import math

import numpy as np
import pytest
import torch

from engine.geometry import fibonacci_sphere
from engine.light.gaussians.gaussians import Y00
from engine.reference.monte_carlo.estimator import (
    estimate,
    light_pdf,
    lobes_at,
    response,
    towards_highlight,
    towards_light,
)
from engine.reference.monte_carlo.vmf_proposal import Mixture, emitted, fit
from engine.surface.reflectance.brdf_torch import rows_reference
from engine.types import Gaussians

NORMAL = torch.nn.functional.normalize(torch.tensor([[0.3, -0.2, -1.0]], dtype=torch.float64), dim=1)
VIEW = torch.nn.functional.normalize(torch.tensor([[-0.1, 0.2, -1.0]], dtype=torch.float64), dim=1)
ALBEDO = torch.tensor([[0.6, 0.4, 0.2]], dtype=torch.float64)
DULL = torch.tensor([0.6], dtype=torch.float64)
LAMP, LAMP_RADIUS = np.array([0.5, -0.4, -1.2]), 0.05


def room() -> Mixture:
    """Forty dim Gaussians all around and one bright small lamp near the point."""
    means = np.concatenate([3 * fibonacci_sphere(40), LAMP[None]])
    scales = np.repeat(np.append(np.full(40, 0.5), LAMP_RADIUS)[:, None], 3, 1)
    radiance = np.append(np.full(40, 0.2), 400.0)[:, None, None] / Y00
    gaussians = Gaussians(
        means, np.tile([1.0, 0, 0, 0], (41, 1)), scales, np.full(41, 5.0), np.repeat(radiance, 3, 2)
    )
    return fit(gaussians, 0, 16, weights=emitted(gaussians))


def uniforms(points: int, samples: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(
        (points, samples, 3), generator=torch.Generator().manual_seed(seed), dtype=torch.float64
    )


def arriving(directions: torch.Tensor) -> torch.Tensor:
    """A dim room, and the lamp as a sphere seen from the origin."""
    centre = torch.tensor(LAMP)
    cosine = directions @ (centre / centre.norm())
    lit = cosine > math.sqrt(1 - (LAMP_RADIUS / float(centre.norm())) ** 2)
    return (0.2 + 400.0 * lit)[..., None].expand(*lit.shape, 3).to(torch.float64)


def aimed(samples: int, points: int = 1, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    lobes = lobes_at(room(), torch.zeros((points, 3), dtype=torch.float64))
    return towards_light(lobes, NORMAL.repeat(points, 1), uniforms(points, samples, seed))


def shiny(samples: int, points: int = 1, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    many = [x.repeat(points, *[1] * (x.ndim - 1)) for x in (NORMAL, VIEW, DULL)]
    return towards_highlight(*many, uniforms(points, samples, seed))


def seen(drawn: tuple[torch.Tensor, torch.Tensor], light, albedo: torch.Tensor = ALBEDO) -> np.ndarray:
    """Estimates of as many points as were drawn for."""
    directions, pdf = drawn
    many = [x.repeat(len(directions), *[1] * (x.ndim - 1)) for x in (NORMAL, albedo, DULL, VIEW)]
    return estimate(*many, directions, pdf, light(directions)).numpy()


@pytest.mark.parametrize("draw", [aimed, shiny])
def test_constant_light_on_a_lambertian_returns_albedo_times_light(draw) -> None:
    def constant(directions: torch.Tensor) -> torch.Tensor:
        return torch.full((*directions.shape[:2], 3), 2.5, dtype=torch.float64)

    drawn = draw(400_000)
    highlight = seen(drawn, constant, torch.zeros_like(ALBEDO))
    np.testing.assert_allclose(seen(drawn, constant) - highlight, 2.5 * ALBEDO.numpy(), rtol=0.01)


def test_all_ways_of_sampling_agree_and_aiming_at_a_small_near_lamp_is_less_noisy() -> None:
    points, samples = 400, 256
    by_light, by_highlight = (seen(draw(samples, points), arriving)[:, 1] for draw in (aimed, shiny))
    every = torch.tensor(fibonacci_sphere(400_000))[None]
    even = torch.full(every.shape[:2], 1 / (4 * math.pi), dtype=torch.float64)
    exact = seen((every, even), arriving)[0, 1]
    for found in (by_light, by_highlight):
        assert abs(found.mean() - exact) < 4 * found.std() / math.sqrt(points)
    assert by_light.std() < 0.3 * by_highlight.std()


def test_the_density_is_the_one_the_fitted_mixture_has() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3)) * 0.3
    directions = np.tile(fibonacci_sphere(200), (5, 1, 1))
    normals = NORMAL.repeat(5, 1)
    expected = room().at(points).pdf(normals.numpy(), directions)
    found = light_pdf(lobes_at(room(), torch.tensor(points)), normals, torch.tensor(directions))
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-6)
    drawn, density = aimed(100)
    np.testing.assert_allclose(drawn.norm(dim=2).numpy(), 1, rtol=1e-9)
    here = light_pdf(lobes_at(room(), torch.zeros((1, 3), dtype=torch.float64)), NORMAL, drawn)
    np.testing.assert_allclose(density.numpy(), here.numpy())


@pytest.mark.parametrize("full_diffuse", [False, True])
def test_the_response_is_the_one_our_solver_has_but_for_schlicks_fresnel(full_diffuse: bool) -> None:
    directions = torch.tensor(fibonacci_sphere(300))
    diffuse, specular = rows_reference(NORMAL, DULL, VIEW, directions, full_diffuse, 0.0)
    half = ((1 + VIEW @ directions.T) / 2).sqrt()  # l.h
    inside = (1 - (1 - half**2) / 1.5**2).sqrt()  # cosine of the refracted ray
    across, along = (
        (half - 1.5 * inside) / (half + 1.5 * inside),
        (inside - 1.5 * half) / (inside + 1.5 * half),
    )
    law, schlick = (across**2 + along**2) / 2, 0.04 + 0.96 * (1 - half) ** 5
    found = response(NORMAL, DULL, VIEW, directions[None], full_diffuse)
    for one, other in zip(found, (diffuse, specular / law * schlick), strict=True):
        np.testing.assert_allclose(one.numpy(), other.numpy(), rtol=1e-9, atol=1e-12)


def test_head_on_the_lobes_are_the_values_worked_out_by_hand() -> None:
    # n = v = l: D = 1 / (pi a2) with a2 = 0.5^4, F = 0.04, G / (4 n.l n.v) = 1/4.
    up = torch.tensor([[0.0, 0, -1]], dtype=torch.float64)
    diffuse, specular = response(up, torch.tensor([0.5], dtype=torch.float64), up, up[None], False)
    assert float(diffuse) == pytest.approx(1 / math.pi)
    assert float(specular) == pytest.approx(16 / math.pi * 0.04 / 4)


def test_gradients_are_those_of_finite_differences_with_the_same_samples() -> None:
    directions, pdf = aimed(64, 3)
    light = arriving(directions)
    turned = torch.tensor([[0.0, 0, 0], [0.1, -0.2, 0], [-0.3, 0.1, 0.1]], dtype=torch.float64)
    normals = torch.nn.functional.normalize(NORMAL + turned, dim=1)
    views = VIEW.repeat(3, 1)

    def pictures(normals: torch.Tensor, albedo: torch.Tensor, roughness: torch.Tensor) -> torch.Tensor:
        unit = torch.nn.functional.normalize(normals, dim=1)
        return estimate(unit, albedo, roughness, views, directions, pdf, light)

    leaves = (normals, ALBEDO.repeat(3, 1), torch.tensor([0.3, 0.5, 0.8], dtype=torch.float64))
    leaves = tuple(leaf.clone().requires_grad_() for leaf in leaves)
    assert torch.autograd.gradcheck(pictures, leaves, eps=1e-7, atol=1e-5, rtol=1e-4)
    assert all(bool((grad != 0).any()) for grad in torch.autograd.grad(pictures(*leaves).sum(), leaves))
