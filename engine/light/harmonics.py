"""Radiance that changes with the direction it is seen from: degree by degree, as long as kept-out views gain by it.

Walls are matt, or nearly so, in most rooms, and what is not needed only fits noise. So shapes and mean colours stay as
the fit left them: what is added is the part of each harmonic that differs between the views, which leaves the mean
over them, and so the energy, alone. Source: real spherical harmonics as in 3DGS (Kerbl et al. 2023); Eq. (5) of the
paper by Adam. World frame, linear radiance.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from engine.light.gaussians import Y00, radiance_towards, sh_basis, sh_degree
from engine.light.photographs import Photographs, camera_centres
from engine.light.rasterise import Run, push_back, shapes
from engine.types import Gaussians

MARGIN = 0.03
"""Share of the kept-out views' log-L1 that a degree has to take away to stay."""
PASSES = 4  # over all views, for each degree
_RATE, _LAST = 0.05, 0.1  # Adam's step, relative to the mean colour; share of it that is left in the end
_BETA1, _BETA2 = 0.9, 0.99


def grown(
    gaussians: Gaussians,
    highest: int,
    photographs: Photographs,
    surface: Float[np.ndarray, "n h w"],
    knee: float,
    hollow: float,
    error: Callable[[Gaussians], float],
    rng: np.random.Generator,
    run: Run,
) -> Gaussians:
    """The same Gaussians with as many harmonics as pay.

    Args:
        highest: degree beyond which none is tried, at most 3.
        surface, knee, hollow: as `push_back` takes them.
        error: log-L1 of views that supervise nothing.
    """
    best = error(gaussians)
    for degree in range(sh_degree(gaussians.radiance.shape[1]) + 1, highest + 1):
        richer = _trained(gaussians, degree, photographs, surface, knee, hollow, rng, run)
        reached = error(richer)
        if not reached <= (1 - MARGIN) * best:
            return gaussians
        gaussians, best = richer, reached
    return gaussians


def _trained(
    gaussians: Gaussians,
    degree: int,
    photographs: Photographs,
    surface: np.ndarray,
    knee: float,
    hollow: float,
    rng: np.random.Generator,
    run: Run,
) -> Gaussians:
    """Harmonics up to `degree` trained on top of those that are there."""
    geometry, (count, below, _) = shapes(gaussians), gaussians.radiance.shape
    functions = (degree + 1) ** 2
    mean, spread = _over_views(gaussians.means, camera_centres(photographs), degree)
    level = np.maximum(gaussians.radiance[:, 0].astype(np.float64) * Y00, 0)
    radiance = np.zeros((count, functions, 3))
    radiance[:, :below] = gaussians.radiance
    change = np.zeros(
        (count, functions - 1, 3)
    )  # relative to `level`, one standard deviation of the harmonic
    moment1, moment2, steps = np.zeros_like(change), np.zeros_like(change), np.zeros(count)

    def rich() -> Gaussians:
        added = change * level[:, None] / spread[:, :, None]
        whole = radiance.copy()
        whole[:, 1:] += added
        whole[:, 0] -= (added * mean[:, :, None]).sum(1) / Y00
        return replace(gaussians, radiance=whole)

    total = PASSES * len(photographs.weight)
    for step in range(total):
        if step % len(photographs.weight) == 0:
            order = rng.permutation(len(photographs.weight)).tolist()
        view = order[step % len(photographs.weight)]
        pinhole = photographs.pinhole(view)
        colours = radiance_towards(rich(), pinhole.origin)
        _, gradients = push_back(
            geometry, colours, pinhole, 0.0, photographs.radiance[view], photographs.weight[view],
            photographs.clipped[view], knee, hollow, surface[view], run,
        )  # fmt: skip
        i = gradients.index
        towards = gaussians.means[i] - pinhole.origin
        basis = sh_basis(towards / np.linalg.norm(towards, axis=1, keepdims=True), degree)[:, 1:]
        unlike = (basis - mean[i]) / spread[i]
        slope = unlike[:, :, None] * (gradients.colours * level[i] * (colours[i] > 0))[:, None]
        steps[i] += 1
        moment1[i] = _BETA1 * moment1[i] + (1 - _BETA1) * slope
        moment2[i] = _BETA2 * moment2[i] + (1 - _BETA2) * slope * slope
        t = steps[i][:, None, None]
        move = moment1[i] / (1 - _BETA1**t) / (np.sqrt(moment2[i] / (1 - _BETA2**t)) + 1e-12)
        change[i] -= _RATE * _LAST ** (step / total) * move
    return replace(gaussians, radiance=rich().radiance.astype(gaussians.radiance.dtype))


def _over_views(
    means: Float[np.ndarray, "k 3"], centres: Float[np.ndarray, "n 3"], degree: int
) -> tuple[Float[np.ndarray, "k b"], Float[np.ndarray, "k b"]]:
    """Mean and standard deviation of every harmonic but the constant, over the directions from the cameras."""
    total = np.zeros((len(means), (degree + 1) ** 2 - 1))
    squares = total.copy()
    for centre in centres:
        towards = means - centre
        basis = sh_basis(towards / np.linalg.norm(towards, axis=1, keepdims=True), degree)[:, 1:]
        total, squares = total + basis, squares + basis * basis
    mean = total / len(centres)
    return mean, np.sqrt(np.maximum(squares / len(centres) - mean * mean, 1e-8))
