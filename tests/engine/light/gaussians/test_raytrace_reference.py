"""The reference itself, against values worked out by hand."""

import math

import numpy as np
import pytest
import torch

from engine.light.gaussians import raytrace_reference

AXIS = (
    torch.tensor([[0.0, 0.0, 0.0]], dtype=torch.float64),
    torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64),
)


def cloud(*rows: tuple[float, float, float]) -> tuple[torch.Tensor, ...]:
    """Round Gaussians of scale 0.5 with density, depth and radiance; 0.3 beside the axis."""
    density, depth, radiance = (
        torch.tensor(column, dtype=torch.float64) for column in zip(*rows, strict=True)
    )
    k = len(rows)
    means = torch.stack([torch.full((k,), 0.3, dtype=torch.float64), torch.zeros(k), depth], 1)
    quaternions = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).repeat(k, 1)
    scales = torch.full((k, 3), 0.5, dtype=torch.float64)
    return means, quaternions, scales, density, radiance[:, None].repeat(1, 3)


def test_one_gaussian_worked_by_hand() -> None:
    # q = (0.3 / 0.5)^2 = 0.36; alpha = 1 - exp(-2 exp(-0.36)) = 0.752254, seen at z = 2.
    radiance, left, far = raytrace_reference.trace(*cloud((2.0, 2.0, 5.0)), *AXIS, kind="exp")
    alpha = 1 - math.exp(-2 * math.exp(-0.36))
    assert alpha == pytest.approx(0.752254, abs=1e-6)
    np.testing.assert_allclose(radiance[0], 5 * alpha, rtol=1e-12)
    assert left.item() == pytest.approx(1 - alpha, rel=1e-12)
    assert far.item() == pytest.approx(2 * alpha, rel=1e-12)


def test_the_compact_profile_worked_by_hand() -> None:
    # (1 - 0.36 / 8)^8 = 0.955^8 = 0.691876
    _, left, _ = raytrace_reference.trace(*cloud((2.0, 2.0, 5.0)), *AXIS)
    assert left.item() == pytest.approx(math.exp(-2 * 0.955**8), rel=1e-12)
    assert raytrace_reference.profile(torch.tensor([8.0, 9.0]), "compact").tolist() == [0.0, 0.0]


def test_the_nearer_one_hides_the_farther_whatever_their_order() -> None:
    near, far = (1.0, 2.0, 3.0), (50.0, 4.0, 7.0)
    share = math.exp(-math.exp(-0.36))
    expected = 3 * (1 - share) + share * 7 * (1 - math.exp(-50 * math.exp(-0.36)))
    for rows in ((near, far), (far, near)):
        radiance, _, _ = raytrace_reference.trace(*cloud(*rows), *AXIS, kind="exp")
        np.testing.assert_allclose(radiance[0], expected, rtol=1e-12)


def test_what_lies_behind_or_too_near_does_not_count() -> None:
    radiance, left, _ = raytrace_reference.trace(*cloud((1.0, -2.0, 3.0), (1.0, 0.4, 3.0)), *AXIS, near=0.5)
    assert left.item() == 1
    assert radiance.abs().max() == 0
