"""Rays through the tree of Gaussians: the light that the plain tracer finds, for every ray alike."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.geometry import fibonacci_sphere
from engine.light.gaussians import raytrace_reference
from engine.light.gaussians.gaussians import joined, radiance_towards
from engine.light.gaussians.rasterize import thread_pool
from engine.reference.monte_carlo import queries
from engine.types import Gaussians
from tests.engine.light import clouds


def plainly(gaussians: Gaussians, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """`raytrace_reference.trace` for every origin."""
    found = []
    for origin, some in zip(origins, directions, strict=True):
        fields = (gaussians.means, gaussians.quaternions, gaussians.scales, gaussians.density)
        tensors = [
            torch.tensor(np.asarray(x, np.float64)) for x in (*fields, radiance_towards(gaussians, origin))
        ]
        begin = torch.tensor(np.repeat(origin[None], len(some), 0))
        found.append(raytrace_reference.trace(*tensors, begin, torch.tensor(some))[0].numpy())
    return np.stack(found)


def traced(
    gaussians: Gaussians, origins: np.ndarray, directions: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    with thread_pool(2) as run:
        return queries.radiance(queries.plant(gaussians), origins, directions, wanted, run)


@pytest.mark.parametrize("degree", [0, 2, 3])
def test_every_ray_finds_what_the_plain_tracer_finds(degree: int) -> None:
    rng = np.random.default_rng(degree)
    gaussians = clouds.scattered(300)
    higher = rng.normal(0, 0.3, (300, (degree + 1) ** 2 - 1, 3))
    gaussians = replace(gaussians, radiance=np.concatenate([gaussians.radiance, higher], 1))
    origins = rng.uniform([-1, -1, -0.5], [1, 1, 3], (6, 3))
    directions = np.tile(fibonacci_sphere(60), (6, 1, 1))
    directions[0, :3] = np.eye(3)  # along the boxes' faces
    expected = plainly(gaussians, origins, directions)
    found = traced(gaussians, origins, directions, np.ones((6, 60), bool))
    assert expected.max() > 0.5
    # What the kernels call too faint to exist is left out of the tree.
    np.testing.assert_allclose(found, expected, atol=2e-4)


def test_what_stands_behind_opaque_gaussians_adds_nothing() -> None:
    inner, outer = clouds.shell(1.0, 1.0, 400), clouds.shell(50.0, 3.0, 400)
    both = replace(joined(inner, outer), density=np.full(800, 30.0))
    directions = fibonacci_sphere(50)[None]
    found = traced(both, np.zeros((1, 3)), directions, np.ones((1, 50), bool))
    np.testing.assert_allclose(found, 1.0, rtol=2e-3)


def test_a_ray_that_is_not_wanted_is_dark() -> None:
    directions = fibonacci_sphere(20)[None]
    wanted = np.arange(20)[None] % 2 == 0
    found = traced(clouds.shell(1.0), np.zeros((1, 3)), directions, wanted)
    assert (found[wanted] > 0.9).all()
    assert (found[~wanted] == 0).all()
