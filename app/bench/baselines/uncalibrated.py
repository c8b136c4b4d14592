"""The baseline that masks the background out: uncalibrated photometric stereo under natural light.

Nothing is known of the light but that it is far and of second order. As in B. Haefner et al., "Variational
uncalibrated photometric stereo under general lighting" (2019), the surface starts as a balloon blown up inside the
mask (a full one, and two flatter ones for what the mask cuts out of a wall), and light (9 harmonics per view and
channel, linear) and surface (normals and albedo, Lambert, no shadows) are solved in turns. Low-order pictures leave
surface and light free to move together, and their scale (R. Basri, D. Jacobs, I. Kemelmacher, "Photometric stereo
with general, unknown lighting", 2007): here the balloon decides the first, and a grey world the second, so that
scores of albedo mean something after matching the mean only. No pose, no background pixel and no emitter is
looked at. Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float
from scipy.sparse.linalg import spsolve

from app.bench.baselines.flat import HARMONICS, HarmonicRows, Harmonics, answers
from app.bench.baselines.matt import MATT_ROUGHNESS, answered, seen_object
from engine.geometry import rays
from engine.progress import Progress
from engine.surface.data.observations import Observations, shifted_neighbours
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels, depth_from_normals
from engine.surface.rendering.transport import SurfaceGeometry, pixel_blocks
from engine.types import Camera, CapturedScene, Surface

HEIGHTS = (1.0, 0.3, 0.1)
"""Balloons to start from, as round as the outline or flatter: that which explains the pictures best is kept."""
SETTLED, PATIENCE = 0.99, 5
"""So many turns must lower the residuals' spread to this share; beyond, the surface drifts where pictures hardly tell."""
GREY = 0.3
"""The median albedo of every channel, as nothing says what it is."""


@dataclass(frozen=True, slots=True)
class UncalibratedParams:
    """What the person may ask of the baseline."""

    turns: int = 30  # light, then surface: how often at most, from each start
    passes: int = 3  # Gauss-Newton evaluations of the surface in each turn
    object_distance: float = 1.0  # mean depth of the answer, scene units: unknown to the method
    model_error: float = 0.02  # relative misfit expected of a good model


def uncalibrated(
    captured: CapturedScene, params: UncalibratedParams, device: str, seed: int, progress: Progress
) -> Surface:
    """Normals, albedo and light from the object's pixels alone; Gaussians, lamps and poses stay unread.

    Raises:
        SurfaceError: too few views, or an empty mask.
    """
    # Under a light that is not known yet, a share of the background would take up what the light leaves unexplained.
    object_pixels, _ = seen_object(
        captured, SurfaceParams(model_error=params.model_error, without=("mixed_pixels",))
    )
    geometry = object_pixels.geometry_at(params.object_distance)
    states = []
    for i, height in enumerate(HEIGHTS):
        span = progress.part(0.9 * i / len(HEIGHTS), 0.9 * (i + 1) / len(HEIGHTS))
        states.append(
            _in_turns(
                object_pixels,
                geometry,
                balloon(object_pixels.camera, object_pixels.mask, height),
                params,
                span,
            )
        )
    state = min(states, key=lambda state: float(np.median(state.residual_scale)))
    depth = depth_from_normals(object_pixels, state, params.object_distance, progress.part(0.9, 1))
    return answered(object_pixels, state, geometry, depth, params.model_error)


def _in_turns(
    object_pixels: ObjectPixels,
    geometry: SurfaceGeometry,
    normals: Float[np.ndarray, "p 3"],
    params: UncalibratedParams,
    progress: Progress,
) -> gauss_newton.PixelEstimate:
    seen, parts = object_pixels.observations, pixel_blocks(object_pixels.mask)
    usual = np.median(seen.radiance.reshape(len(normals), -1, 3), axis=1)
    state = gauss_newton.initial_estimate(normals, grey(usual), np.full(len(normals), MATT_ROUGHNESS))
    spreads: list[float] = []
    for turn in range(params.turns):
        span = progress.part(turn / params.turns, (turn + 1) / params.turns)
        problem = gauss_newton.PixelProblem(HarmonicRows(fitted_light(state, seen)), geometry, parts, seen)
        state = gauss_newton.update_residual_scale(state, problem)
        spreads.append(float(np.median(state.residual_scale)))
        if turn >= PATIENCE and spreads[-1] > SETTLED * spreads[-1 - PATIENCE]:
            break
        state = gauss_newton.minimize(state, problem, params.passes, span)
        state = replace(state, albedo=grey(state.albedo), lm_lambda=np.full(len(normals), 1e-2))
    return state


def grey(albedo: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
    """Albedo whose median is GREY in every channel."""
    return np.clip(albedo * (GREY / np.median(albedo, axis=0)), *gauss_newton.ALBEDO)


def balloon(
    camera: Camera, mask: Bool[np.ndarray, "h w"], height: float | int = 1.0
) -> Float[np.ndarray, "p 3"]:
    """Normals of a balloon blown up inside the mask, then squashed to `height`; a disc gives a ball.

    The root of the solution of -laplace u = 4 with u = 0 outside the mask is the height, in pixels, towards the
    camera; the rim's normals are across the line of sight.
    """
    count, beside = int(mask.sum()), shifted_neighbours(mask, np.array([[0, 1], [0, -1], [1, 0], [-1, 0]]))
    own, which = np.nonzero(beside >= 0)
    ones = np.ones(len(own))
    laplace = sparse.identity(count) * 4 - sparse.csr_matrix(
        (ones, (own, beside[own, which])), (count, count)
    )
    height2 = np.append(np.asarray(spsolve(laplace.tocsc(), np.full(count, 4.0))), 0.0)  # the last is outside
    right, left, below, above = height2[beside].T
    local = np.stack([(left - right) / 4, (above - below) / 4, -np.sqrt(height2[:-1])], axis=1)
    local[:, :2] *= height
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    # Turn each from the image's axis to its own line of sight.
    ahead = rays(camera)[mask]
    half = ahead + [0, 0, 1]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    once = local * [-1, -1, 1]
    return 2 * (once * half).sum(1, keepdims=True) * half - once


def fitted_light(state: gauss_newton.PixelEstimate, observations: Observations) -> Harmonics:
    """The harmonics of every view and channel that explain the radiance best, given the surface.

    Weighted as the surface's own fit is: relative errors, Cauchy weights after a first answer.
    """
    design = answers(state.normals)
    first, second = np.triu_indices(HARMONICS)
    squares = design[:, first] * design[:, second]
    channels = observations.radiance.shape[1]
    albedo = np.tile(state.albedo, channels // 3)
    relative = 1 / (observations.radiance + observations.eps[:, None])
    weight = observations.weight * relative**2
    robust = 1.0
    coefficients = np.zeros((HARMONICS, channels))
    for _ in range(3):
        w = weight * robust
        system = np.zeros((channels, HARMONICS, HARMONICS))
        system[:, first, second] = system[:, second, first] = (w * albedo**2).T @ squares
        slope = (w * albedo * observations.radiance).T @ design
        ridge = 1e-6 * np.einsum("vii->v", system)[:, None, None] * np.eye(HARMONICS)
        coefficients = np.linalg.solve(system + ridge, slope[..., None])[..., 0].T
        residual = (
            (albedo * (design @ coefficients) - observations.radiance)
            * relative
            * np.sqrt(observations.weight)
        )
        spread = 1.4826 * np.median(np.abs(residual), axis=0)
        robust = 1 / (1 + (residual / (observations.cauchy * np.maximum(spread, 0.3))) ** 2)
    return Harmonics(coefficients.astype(np.float32))
