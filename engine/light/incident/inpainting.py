"""Guess the light from directions that no photograph showed: smooth, positive, from what was seen.

Push-pull over ever coarser spheres of directions, on the logarithm of radiance: a guess is close to a local
geometric mean, so one bright window at the edge of the unseen does not flood it. Any frame.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from engine.errors import LightError
from engine.geometry import fibonacci_sphere

_SHRINK = 3  # each sphere has this many times fewer directions than the finer one


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhood:
    """Nested spheres of directions: how a level is gathered into the next coarser one, and spread back."""

    gather: tuple[csr_matrix, ...]
    spread: tuple[csr_matrix, ...]


def neighbourhood(directions: Float[np.ndarray, "d 3"]) -> Neighbourhood:
    """Nested spheres over a set of directions, down to a handful."""
    gather, spread = [], []
    fine = directions
    while len(fine) > 12:
        coarse = fibonacci_sphere(max(6, len(fine) // _SHRINK))
        distance, index = KDTree(coarse).query(fine, k=4)
        weight = 1 / (distance**2 + 0.3 * 4 * np.pi / len(coarse))
        weight /= weight.sum(1, keepdims=True)
        rows = np.repeat(np.arange(len(fine)), 4)
        matrix = csr_matrix((weight.ravel(), (rows, index.ravel())), (len(fine), len(coarse)))
        spread.append(matrix)
        gather.append(csr_matrix(matrix.T))
        fine = coarse
    return Neighbourhood(tuple(gather), tuple(spread))


def inpaint(
    values: Float[np.ndarray, "d c"], trust: Float[np.ndarray, " d"], over: Neighbourhood
) -> Float[np.ndarray, "d c"]:
    """`values` where trust is 1, a smooth continuation where it is 0, a mean of both between.

    Raises:
        LightError: nothing is trusted.
    """
    if not trust.sum() > 0:
        raise LightError("no direction around a probe was photographed; more views of the room are needed")
    levels = [(values, trust)]
    value, weight = values, trust
    for matrix in over.gather:
        mass = matrix @ weight
        value = (matrix @ (value * weight[:, None])) / np.maximum(mass, 1e-30)[:, None]
        weight = np.minimum(mass / (0.25 * _SHRINK), 1)  # a quarter of the finer cells seen is enough
        levels.append((value, weight))
    value, weight = levels[-1]
    result = np.broadcast_to(np.average(value, axis=0, weights=weight), value.shape)
    result = weight[:, None] * value + (1 - weight[:, None]) * result
    for matrix, (value, weight) in zip(reversed(over.spread), reversed(levels[:-1]), strict=True):
        result = weight[:, None] * value + (1 - weight[:, None]) * (matrix @ result)
    return result


def inpaint_energy(
    energy: Float[np.ndarray, "d 3"],
    opacity: Float[np.ndarray, " d"],
    seen: Float[np.ndarray, " d"],
    solid_angle: Float[np.ndarray, " d"],
    over: Neighbourhood,
) -> Float[np.ndarray, "d 3"]:
    """Energy of every direction cell: what was seen, and a guess for the share that was not; never zero.

    `opacity` and `seen` (at most opacity) in [0, 1] per cell: how much of it the Gaussians cover, and how
    much of it was photographed.
    """
    radiance = energy / (solid_angle * np.maximum(opacity, 1e-6))[:, None]
    trust = np.where(seen > 0.02, seen, 0)
    mean = np.average(radiance, axis=0, weights=trust + 1e-12)
    logarithm = np.log(np.maximum(radiance, 1e-4 * mean + 1e-30))
    guess = np.exp(inpaint(logarithm, trust, over))
    kept = energy * (seen / np.maximum(opacity, 1e-6))[:, None]
    return kept + guess * ((1 - seen) * solid_angle)[:, None]
