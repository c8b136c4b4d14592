"""What a pixel's surroundings say about its gloss, before its own photographs are asked.

Roughness shows only where a highlight passed; a white wall that is dull and one that is glossy and leans a little
otherwise may explain all photographs equally well. But what looks alike is mostly of one material: pixels of the same
albedo near by, and most of all those whose roughness is well known, tell what to expect. How far they agree
among themselves is how far the expectation is trusted.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from engine.progress import Progress
from engine.surface.data.observations import shifted_neighbours
from engine.surface.optimize.gauss_newton import CONFIG as GAUSS_NEWTON
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem, minimize, where


@dataclass(frozen=True, slots=True)
class RoughnessPriorConfig:
    """Who tells a pixel what to expect, and from where on it does."""

    reach: float = 0.2  # of the pixels that are asked, in sides of a square as large as the object
    neighbours: int = 64  # asked
    alike: float = 0.1  # difference of log albedo, RMS over channels, that two of one material may well show
    known: float = 0.03  # a pixel whose error is less than this has no more to say for it
    least_spread: float = 0.03
    least_weight: float = 4.0  # so many pixels' worth of agreement before anything is expected
    unexpected: float = 1.5  # a pixel so many spreads off is solved a second time, from what it may expect
    pixels_at_once: int = 32_768


CONFIG = RoughnessPriorConfig()


def apply_roughness_prior(
    state: PixelEstimate, problem: PixelProblem, mask: Bool[np.ndarray, "h w"], steps: int, progress: Progress
) -> PixelEstimate:
    """The state under what its pixels may expect; those far off it begin once more with it, and keep what explains better."""
    state = with_roughness_prior(state, expected_roughness(state, mask, problem.geometry.material))
    mean, spread = state.roughness_prior.T
    surprised = np.abs(state.roughness - mean) > CONFIG.unexpected * spread
    few = [part for block in problem.blocks if len(part := block[surprised[block]])]
    other = state.begun_anew(roughness=np.where(surprised, mean, state.roughness))
    other = minimize(other, replace(problem, blocks=few), steps, progress)
    return where(surprised & (other.cost < state.cost), other, state)


def with_roughness_prior(state: PixelEstimate, gloss: Float[np.ndarray, "p 2"]) -> PixelEstimate:
    """The same where something else is expected of the roughness, its misfit and system with it."""
    square = state.residual_scale**2
    (was, width), (mean, spread) = state.roughness_prior.T, gloss.T
    before, now = (state.roughness - was) / width, (state.roughness - mean) / spread
    system, slope = state.hessian.copy(), state.gradient.copy()
    system[:, 5, 5] += square * (1 / spread**2 - 1 / width**2)
    slope[:, 5] += square * (before / width - now / spread)
    misfit = state.cost + square * (now**2 - before**2)
    return replace(state, cost=misfit, hessian=system, gradient=slope, roughness_prior=gloss)


def expected_roughness(
    state: PixelEstimate,
    mask: Bool[np.ndarray, "h w"],
    material: Float[np.ndarray, "p 2"] | None = None,
) -> Float[np.ndarray, "p 2"]:
    """Mean and spread of the roughness that every pixel may expect, `material` as in `SurfaceGeometry`."""
    count = len(state.roughness)
    asked, known = np.arange(CONFIG.neighbours), CONFIG.known**2
    turn = np.pi * (3 - np.sqrt(5)) * asked
    reach = CONFIG.reach * np.sqrt(count) * np.sqrt((asked + 0.5) / CONFIG.neighbours)
    steps = np.rint(np.stack([reach * np.sin(turn), reach * np.cos(turn)], 1)).astype(int)
    steps = np.unique(steps[(steps != 0).any(1)], axis=0)
    answer = np.tile(np.asarray(GAUSS_NEWTON.roughness_prior), (count, 1))
    if not len(steps):  # a handful of pixels has no neighbourhood
        return answer
    others = shifted_neighbours(mask, steps)
    logs, error = np.log(state.albedo), own_error(state)
    for first in range(0, count, CONFIG.pixels_at_once):
        part = slice(first, first + CONFIG.pixels_at_once)
        other = others[part]
        away = ((logs[other] - logs[part][:, None]) ** 2).mean(-1) / CONFIG.alike**2
        weight = np.exp(-away / 2) * (other >= 0) * known / (error[other] ** 2 + known)
        if material is not None:
            weight = weight * (material[other, 1] == material[part, None, 1])
        told = state.roughness[other]
        mean = weighted_median(told, weight)
        spread = 1.4826 * weighted_median(np.abs(told - mean[:, None]), weight)
        enough = weight.sum(1) > CONFIG.least_weight
        found = np.stack([mean, np.maximum(spread, CONFIG.least_spread)], 1)
        answer[part] = np.where(enough[:, None], found, answer[part])
    return answer


def own_error(state: PixelEstimate) -> Float[np.ndarray, " p"]:
    """Standard error of the roughness by the photographs alone; 1 at most."""
    alone = with_roughness_prior(state, np.tile([0.0, np.inf], (len(state.roughness), 1))).hessian
    square = np.maximum(state.residual_scale, 1.0)[:, None, None] ** 2
    variance = np.linalg.inv(alone / square + 1e-6 * np.eye(6))[:, 5, 5]
    return np.sqrt(np.clip(np.where(variance > 0, variance, 1), 0, 1))


def weighted_median(
    values: Float[np.ndarray, "p k"], weight: Float[np.ndarray, "p k"]
) -> Float[np.ndarray, " p"]:
    """Along the second axis."""
    order = np.argsort(values, axis=1)
    total = np.cumsum(np.take_along_axis(weight, order, 1), axis=1)
    at = (total < total[:, -1:] / 2).sum(1).clip(0, values.shape[1] - 1)
    return np.take_along_axis(values, np.take_along_axis(order, at[:, None], 1), 1)[:, 0]
