"""The losses of the paper's inverse renderer, over the pixels that are solved. Torch, any float type.

Source: the paper, Eq. (13)-(16). Camera frame. Pixels are a list; `beside[p]` names the pixels to the right, to the
left, below and above, -1 where that one is not in the list.

What the paper leaves open: derivatives of the depth map are means of the one-sided differences that exist, so that
they do not lean; those of the total variation are forward ones. Channels of one quantity share one root.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

RIGHT, LEFT, BELOW, ABOVE = range(4)
STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""Rows and columns to the neighbours in that order."""
_ROUNDED = 1e-12  # under the root of Eq. (16), whose slope at nothing is infinite


def colour_loss(photographed: Float[Tensor, "*n 3"], rendered: Float[Tensor, "*n 3"]) -> Float[Tensor, " *n"]:
    """Each pixel's term of Eq. (14): the L1 norm of log(1 + m); both in units of its 1."""
    return (torch.log1p(photographed.clamp(min=0)) - torch.log1p(rendered.clamp(min=0))).abs().sum(-1)


def normal_loss(
    normals: Float[Tensor, "p 3"], pseudo: Float[Tensor, "p 3"], known: Tensor
) -> Float[Tensor, ""]:
    """Eq. (15), over the pixels whose pseudo normal is known."""
    cosine = torch.nn.functional.cosine_similarity(normals, pseudo, dim=1)
    return (1 - cosine)[known].sum() / max(int(known.sum()), 1)


def pseudo_normals(
    points: Float[Tensor, "p 3"], beside: Int[Tensor, "p 4"]
) -> tuple[Float[Tensor, "p 3"], Tensor]:
    """Normals of a depth map's points by differences, facing the camera; and where there are neighbours for them."""
    along_u, has_u = _slope(points, beside[:, RIGHT], beside[:, LEFT])
    along_v, has_v = _slope(points, beside[:, BELOW], beside[:, ABOVE])
    return torch.linalg.cross(along_v, along_u), has_u & has_v


def _slope(
    points: Float[Tensor, "p 3"], ahead: Int[Tensor, " p"], behind: Int[Tensor, " p"]
) -> tuple[Float[Tensor, "p 3"], Tensor]:
    """Mean of the one-sided differences that exist, and whether there is one."""
    forward, backward = (ahead >= 0)[:, None], (behind >= 0)[:, None]
    total = forward * (points[ahead.clamp(min=0)] - points) + backward * (
        points - points[behind.clamp(min=0)]
    )
    count = forward.to(points.dtype) + backward
    return total / count.clamp(min=1), (count > 0)[:, 0]


def total_variation(values: Float[Tensor, "p c"], beside: Int[Tensor, "p 4"]) -> Float[Tensor, ""]:
    """TV of Eq. (16), isotropic; a difference across the rim counts nothing."""
    squared = torch.zeros_like(values[:, 0])
    for side in (RIGHT, BELOW):
        other = beside[:, side]
        step = (values[other.clamp(min=0)] - values) * (other >= 0)[:, None]
        squared = squared + (step * step).sum(1)
    return (squared + _ROUNDED).sqrt().mean()
