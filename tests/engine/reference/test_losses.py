"""Eq. (14)-(16), by hand, and pseudo normals of surfaces whose normals are known."""

import math

import numpy as np
import pytest
import torch

from engine.geometry import rays
from engine.reference.losses import STEPS, colour_loss, normal_loss, pseudo_normals, total_variation
from engine.surface.data.observations import shifted_neighbours
from tests.engine.ball import CAMERA, ball


def beside(mask: np.ndarray) -> torch.Tensor:
    return torch.tensor(shifted_neighbours(mask, np.array(STEPS)))


def test_the_colour_loss_is_the_l1_norm_of_log_intensities() -> None:
    photographed = torch.tensor([[0.0, 1.0, 3.0], [2.0, 2.0, 2.0]])
    rendered = torch.tensor([[1.0, 0.0, 3.0], [2.0, 2.0, 5.0]])
    np.testing.assert_allclose(colour_loss(photographed, rendered), [2 * math.log(2), math.log(2)], rtol=1e-6)


def test_the_normal_loss_is_one_less_the_cosine_over_known_pixels() -> None:
    normals = torch.tensor([[0.0, 0, -1], [0, 0, -1], [0, 0, -1]])
    pseudo = torch.tensor([[0.0, 0, -7], [0, -3, 0], [1, 0, 0]])
    assert float(normal_loss(normals, pseudo, torch.tensor([True, True, False]))) == pytest.approx(0.5)


def test_total_variation_is_isotropic_and_stops_at_the_rim() -> None:
    mask = np.array([[True, True], [True, False]])
    values = torch.tensor([[0.0], [3.0], [4.0]])  # right 3, below 4
    assert float(total_variation(values, beside(mask))) == pytest.approx(5 / 3, abs=1e-5)
    flat = torch.full((3, 3), 0.7, requires_grad=True)
    total_variation(flat, beside(mask)).backward()
    assert flat.grad is not None
    assert bool(torch.isfinite(flat.grad).all())


def test_pseudo_normals_of_a_plane_are_the_planes() -> None:
    facing = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
    ray = rays(CAMERA)
    points = ray * (-1.0 / (ray @ facing))[..., None]
    mask = np.zeros(points.shape[:2], bool)
    mask[10:14, 20:26] = True
    found, known = pseudo_normals(torch.tensor(points[mask]), beside(mask))
    assert bool(known.all())
    cosine = torch.nn.functional.normalize(found, dim=1).numpy() @ facing
    np.testing.assert_allclose(cosine, 1, atol=1e-9)


def test_pseudo_normals_of_a_ball_are_nearly_its_own() -> None:
    surface = ball()
    points = (rays(CAMERA) / rays(CAMERA)[..., 2:] * surface.depth[..., None])[surface.mask]
    found, known = pseudo_normals(torch.tensor(points), beside(surface.mask))
    cosine = (torch.nn.functional.normalize(found, dim=1).numpy() * surface.normal[surface.mask]).sum(1)
    assert np.degrees(np.arccos(np.clip(np.median(cosine[known.numpy()]), -1, 1))) < 1.5


def test_a_pixel_alone_has_no_pseudo_normal() -> None:
    _, known = pseudo_normals(torch.ones((1, 3)), torch.full((1, 4), -1))
    assert not known.any()
