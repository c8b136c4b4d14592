"""Adam over the Gaussians' parameters, and the moving of useless ones to where the error is.

Every parameter is unitless, so one step size serves any scene: a mean moves in units of its own scales,
along its own axes; scales, density and radiance move in their logarithms (none can become negative).
Moments advance only for Gaussians that the view sees. World frame.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from engine.light.gaussians.gaussians import Y00, rotations
from engine.light.gaussians.rasterize import Gradients, Shapes
from engine.types import Gaussians

# Step sizes: mean (own scales), turn (radians), log scales, log density, log radiance.
_RATES = np.repeat([0.06, 0.03, 0.025, 0.05, 0.03], [3, 3, 3, 1, 3])
_BETA1, _BETA2 = 0.9, 0.99
_DENSEST, _THINNEST = 10.0, 0.01
_FATTEST = 12.0  # longest to shortest axis; needles alias and extrapolate
# Fields of `GaussianOptimizer` that a Gaussian takes along when it moves; the others are made anew.
_KEPT = ("means", "quaternions", "log_scales", "log_density", "log_radiance", "moment1", "moment2", "steps")


@dataclass(slots=True, eq=False)
class GaussianOptimizer:
    """Gaussians under training: parameters, moments and what the last pass said of each."""

    means: Float[np.ndarray, "k 3"]
    quaternions: Float[np.ndarray, "k 4"]
    log_scales: Float[np.ndarray, "k 3"]
    log_density: Float[np.ndarray, " k"]
    log_radiance: Float[np.ndarray, "k 3"]
    geometry: Shapes
    moment1: Float[np.ndarray, "k 13"]
    moment2: Float[np.ndarray, "k 13"]
    steps: Int[np.ndarray, " k"]
    weight: Float[np.ndarray, " k"]
    blame: Float[np.ndarray, " k"]


def _geometry(
    quaternions: np.ndarray, log_scales: np.ndarray, means: np.ndarray, log_density: np.ndarray
) -> Shapes:
    axes, scales = np.swapaxes(rotations(quaternions), 1, 2), np.exp(log_scales)[:, :, None]
    return Shapes(axes / scales, axes * scales, means.copy(), np.exp(log_density))


def optimizer_of(gaussians: Gaussians) -> GaussianOptimizer:
    """Start training; the radiance's constant term only."""
    k = len(gaussians.means)
    log_scales, log_density = np.log(gaussians.scales), np.log(gaussians.density)
    return GaussianOptimizer(
        gaussians.means.copy(), gaussians.quaternions.copy(), log_scales, log_density,
        np.log(np.maximum(gaussians.radiance[:, 0] * Y00, 1e-30)),
        _geometry(gaussians.quaternions, log_scales, gaussians.means, log_density),
        np.zeros((k, 13)), np.zeros((k, 13)), np.zeros(k, np.int64), np.zeros(k), np.zeros(k),
    )  # fmt: skip


def gaussians_of(optimizer: GaussianOptimizer) -> Gaussians:
    """The trained Gaussians, SH degree 0, single precision."""
    return Gaussians(
        optimizer.means.astype(np.float32),
        optimizer.quaternions.astype(np.float32),
        np.exp(optimizer.log_scales).astype(np.float32),
        np.exp(optimizer.log_density).astype(np.float32),
        (np.exp(optimizer.log_radiance) / Y00).astype(np.float32)[:, None, :],
    )


def step(
    optimizer: GaussianOptimizer,
    gradients: Gradients,
    rate: float,
    smallest: Float[np.ndarray, " v"],
    largest: np.ndarray,
) -> None:
    """One Adam step for the Gaussians that were seen; `smallest`, `largest` bound their scales."""
    i = gradients.index
    scales = np.exp(optimizer.log_scales[i])
    density, radiance = np.exp(optimizer.log_density[i]), np.exp(optimizer.log_radiance[i])
    spread = optimizer.geometry.spread[i]  # rows: own axes times scale
    slope = np.concatenate(
        [
            np.einsum("vij,vj->vi", spread, gradients.means),
            gradients.turn,
            gradients.log_scales,
            (gradients.density * density)[:, None],
            gradients.colours * radiance,
        ],
        axis=1,
    )
    optimizer.steps[i] += 1
    first = optimizer.moment1[i] * _BETA1 + (1 - _BETA1) * slope
    second = optimizer.moment2[i] * _BETA2 + (1 - _BETA2) * slope * slope
    optimizer.moment1[i], optimizer.moment2[i] = first, second
    t = optimizer.steps[i][:, None]
    step = first / (1 - _BETA1**t) / (np.sqrt(second / (1 - _BETA2**t)) + 1e-12)
    step *= -rate * _RATES
    optimizer.means[i] += np.einsum("vij,vi->vj", spread, step[:, :3])
    half = 0.5 * step[:, 3:6]
    w, xyz = optimizer.quaternions[i, :1], optimizer.quaternions[i, 1:]
    turned = np.concatenate(
        [w - (xyz * half).sum(1, keepdims=True), xyz + w * half + np.cross(xyz, half)], axis=1
    )
    optimizer.quaternions[i] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    log_scales = np.log(scales) + step[:, 6:9]
    log_scales = np.clip(log_scales, np.log(smallest)[:, None], np.log(largest)[:, None])
    thick = log_scales.max(1, keepdims=True) - np.log(_FATTEST)
    optimizer.log_scales[i] = np.maximum(log_scales, thick)
    optimizer.log_density[i] = np.clip(
        optimizer.log_density[i] + step[:, 9], np.log(_THINNEST), np.log(_DENSEST)
    )
    optimizer.log_radiance[i] += step[:, 10:]
    optimizer.weight[i] += gradients.weight
    optimizer.blame[i] += gradients.blame
    fresh = _geometry(
        optimizer.quaternions[i], optimizer.log_scales[i], optimizer.means[i], optimizer.log_density[i]
    )
    for name in ("white", "spread", "means", "density"):
        getattr(optimizer.geometry, name)[i] = getattr(fresh, name)


def relocate(optimizer: GaussianOptimizer, budget: int, useless: np.ndarray) -> GaussianOptimizer:
    """Move useless Gaussians, and add new ones up to the budget, by splitting those with most blame.

    A split replaces one by two halves along its longest axis. Deterministic: no chance is involved.
    """
    keep = np.nonzero(~useless)[0]
    births = min(max(budget - len(keep), 0), len(keep))
    blame = optimizer.blame[keep]
    parents = keep[np.argsort(-blame, kind="stable")[:births]]
    parents = parents[optimizer.blame[parents] > 0]
    rows = np.concatenate([keep, parents])
    fields = {name: getattr(optimizer, name)[rows] for name in _KEPT}
    place = np.searchsorted(keep, parents)
    young = np.arange(len(keep), len(rows))
    longest = optimizer.log_scales[parents].argmax(1)
    shift = 0.55 * optimizer.geometry.spread[parents, longest]
    fields["means"][place] -= shift
    fields["means"][young] += shift
    for group in (place, young):
        fields["log_scales"][group, longest] += np.log(0.65)
        for name in ("moment1", "moment2", "steps"):
            fields[name][group] = 0
    geometry = _geometry(fields["quaternions"], fields["log_scales"], fields["means"], fields["log_density"])
    return GaussianOptimizer(
        **fields, geometry=geometry, weight=np.zeros(len(rows)), blame=np.zeros(len(rows))
    )
