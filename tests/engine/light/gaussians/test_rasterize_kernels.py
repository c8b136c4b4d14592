"""The kernel against the reference: values, gradients by float64 finite differences, equal bits."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.light.gaussians import raytrace_reference
from engine.light.gaussians.gaussians import radiance_towards
from engine.light.gaussians.rasterize import (
    Gradients,
    Pinhole,
    backward,
    render,
    render_view,
    shapes,
    thread_pool,
)
from engine.types import Gaussians
from tests.engine.light import clouds

KNEE, HOLLOW = 0.5, 0.3


def off(ours: np.ndarray, reference: np.ndarray) -> float:
    """Size of the difference relative to the reference."""
    return float(np.linalg.norm(ours - reference) / np.linalg.norm(reference))


@pytest.mark.parametrize("seed", range(4))
def test_a_rendering_is_the_references(seed: int) -> None:
    gaussians, view = clouds.scattered(60, seed), clouds.view(61, 43, seed)
    image, reference = render_view(gaussians, view, 0.5), clouds.traced(gaussians, view, 0.5)
    for channel in range(5):
        assert off(image[..., channel], reference[..., channel]) < 1e-4


def test_gaussians_around_and_behind_the_camera_are_the_references() -> None:
    gaussians = clouds.scattered(60)
    gaussians = replace(gaussians, means=gaussians.means - [0, 0, 2.5], scales=3 * gaussians.scales)
    view = clouds.view(48, 32)
    image, reference = render_view(gaussians, view, 0.1), clouds.traced(gaussians, view, 0.1)
    assert off(image[..., :3], reference[..., :3]) < 1e-4


def test_a_pixel_does_not_depend_on_the_tile_it_falls_in() -> None:
    gaussians, view = clouds.scattered(80, 5), clouds.view(64, 48)
    whole = render_view(gaussians, view)
    for left, top in ((3, 5), (8, 16), (17, 1)):
        part = replace(view, lens=view.lens - [0, 0, left, top], width=30, height=20)
        # Moving the principal point rounds the rays' coordinates anew, in float32.
        np.testing.assert_allclose(
            render_view(gaussians, part), whole[top : top + 20, left : left + 30], rtol=2e-4, atol=2e-5
        )


def test_any_number_of_threads_gives_the_same_bits() -> None:
    gaussians, view = clouds.scattered(300, 2), clouds.view(96, 64)
    geometry, colours = shapes(gaussians), radiance_towards(gaussians, view.origin)
    target = np.random.default_rng(0).uniform(0, 2, (64, 96, 3)).astype(np.float32)
    weights = np.ones((64, 96), np.float32)
    answers = []
    for threads in (1, 2, 3, 2):
        with thread_pool(threads) as run:
            image = render(geometry, colours, view, 0.0, run)
            _, found = backward(geometry, colours, view, 0.0, target, weights, KNEE, HOLLOW, weights * 2, run)
        answers.append([image, found.means, found.turn, found.log_scales, found.density, found.colours])
    for other in answers[1:]:
        for one, two in zip(answers[0], other, strict=True):
            assert one.tobytes() == two.tobytes()


Loss = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]


def reference_loss(gaussians: Gaussians, view: Pinhole, loss: Loss, changes: dict[str, np.ndarray]) -> float:
    """A loss of the reference's rendering after small changes, in the kernel's own parameters."""
    rotation = raytrace_reference.rotation_of(torch.tensor(gaussians.quaternions))
    x, y, z = torch.tensor(changes["turn"]).unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    rotation = rotation @ torch.linalg.matrix_exp(cross)
    scales = torch.tensor(gaussians.scales) * torch.exp(torch.tensor(changes["log_scales"]))
    whitening = rotation.transpose(1, 2) / scales[:, :, None]
    q, tau = raytrace_reference.respond(
        whitening, torch.tensor(gaussians.means + changes["means"]), *clouds.rays(view)
    )
    alpha = 1 - torch.exp(
        -torch.tensor(gaussians.density + changes["density"]) * raytrace_reference.profile(q, "compact")
    )
    alpha = torch.where(tau > 0, alpha, 0)
    order = torch.argsort(tau, dim=1, stable=True)
    alpha = alpha.gather(1, order)
    through = torch.cumprod(1 - alpha, dim=1)
    before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    colours = torch.tensor(radiance_towards(gaussians, view.origin) + changes["colours"])
    radiance = torch.einsum("rk,rkc->rc", before * alpha, colours[order])
    return float(loss(radiance, through[:, -1]))


def differences(gaussians: Gaussians, view: Pinhole, loss: Loss) -> dict[str, np.ndarray]:
    k, step = len(gaussians.means), 1e-6
    widths = {"means": 3, "turn": 3, "log_scales": 3, "density": 0, "colours": 3}
    shapes = {name: (k, width) if width else (k,) for name, width in widths.items()}
    slopes = {}
    for name, shape in shapes.items():
        slope = np.zeros(shape)
        for at in np.ndindex(shape):
            ends = []
            for sign in (1, -1):
                changes = {other: np.zeros(size) for other, size in shapes.items()}
                changes[name][at] = sign * step
                ends.append(reference_loss(gaussians, view, loss, changes))
            slope[at] = (ends[0] - ends[1]) / (2 * step)
        slopes[name] = slope
    return slopes


def compare(found: Gradients, slopes: dict[str, np.ndarray]) -> None:
    for name, slope in slopes.items():
        ours = np.zeros_like(slope)
        ours[found.index] = getattr(found, name)
        assert off(ours, slope) < 1e-3, name


def push(gaussians: Gaussians, view: Pinhole, target, weights, knee: float, surface=None) -> Gradients:
    surface = np.zeros_like(weights) if surface is None else surface
    with thread_pool(1) as run:
        colours = radiance_towards(gaussians, view.origin)
        _, found = backward(
            shapes(gaussians), colours, view, 0.0, target, weights, knee, HOLLOW, surface, run
        )
    return found


def test_gradients_are_the_finite_differences_of_the_reference() -> None:
    gaussians, view = clouds.scattered(10, 3), clouds.view(24, 18)
    rng = np.random.default_rng(1)
    slope = rng.normal(size=(18, 24, 3)).astype(np.float32)
    weights = rng.uniform(0.5, 1, (18, 24)).astype(np.float32)
    a, b = torch.tensor(slope).double().reshape(-1, 3), torch.tensor(weights).double().ravel()
    slopes = differences(gaussians, view, lambda radiance, left: (a * radiance).sum() + (b * left).sum())
    compare(push(gaussians, view, slope, weights, 0.0), slopes)


def test_gradients_of_the_robust_loss_are_the_finite_differences_too() -> None:
    gaussians, view = clouds.scattered(6, 4), clouds.view(16, 16)
    rng = np.random.default_rng(2)
    target = rng.uniform(0, 2, (16, 16, 3)).astype(np.float32)
    weights = rng.uniform(0, 1, (16, 16)).astype(np.float32)
    want, share = torch.tensor(target).double().reshape(-1, 3), torch.tensor(weights).double().ravel()

    def loss(radiance: torch.Tensor, left: torch.Tensor) -> torch.Tensor:
        misfit = torch.log((KNEE + radiance) / (KNEE + want)).abs()
        return (share[:, None] * misfit).sum() + HOLLOW * (share * left).sum()

    compare(push(gaussians, view, target, weights, KNEE), differences(gaussians, view, loss))


def test_noise_far_below_black_counts_as_black() -> None:
    gaussians, view = clouds.scattered(10, 3), clouds.view(24, 18)
    target, weights = np.full((18, 24, 3), 0.2, np.float32), np.ones((18, 24), np.float32)
    target[9, 12] = -3 * KNEE
    found = push(gaussians, view, target, weights, KNEE)
    assert np.isfinite(found.blame).all()
    assert np.isfinite(found.colours).all()


def test_what_stands_where_a_view_looks_through_is_charged_for_its_weight() -> None:
    gaussians, view = clouds.scattered(10, 3), clouds.view(24, 18)
    rng = np.random.default_rng(4)
    slope = rng.normal(size=(18, 24, 3)).astype(np.float32)
    weights = rng.uniform(0.5, 1, (18, 24)).astype(np.float32)
    surface = np.zeros((18, 24), np.float32)
    surface[:, 12:] = 1e3  # everything stands in front of it
    a, b = torch.tensor(slope).double().reshape(-1, 3), torch.tensor(weights).double().ravel()
    charged = torch.tensor(surface).double().ravel() > 0

    def loss(radiance: torch.Tensor, left: torch.Tensor) -> torch.Tensor:
        return (a * radiance).sum() + (b * left).sum() + (b * (1 - left))[charged].sum()

    slopes = differences(gaussians, view, loss)
    compare(push(gaussians, view, slope, weights, 0.0, surface), slopes)
