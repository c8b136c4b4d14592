"""How far each pixel can be trusted: standard errors from its own Gauss-Newton system, and flags.

Covariance = (J^T W J)^-1 times the squared spread of the weighted residuals where that exceeds one: a model
that misfits by more than the noise earns a wider error. Radians for normals.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from engine.surface.newton import State
from engine.surface.observations import Observations
from engine.surface.transport import Sight

GRAZING, SHADOWED, SATURATED, ILL = 1, 2, 4, 8
GRAZING_COSINE = 0.2
HIDDEN_SHARE = 0.5
SATURATED_SHARE = 0.25
ILL_NORMAL = np.radians(10.0)


@dataclass(frozen=True, slots=True, eq=False)
class Confidence:
    """One standard error per quantity and the flags of `Surface.flags`."""

    normal: Float[np.ndarray, " p"]  # radians, root of the two tangent variances' sum
    albedo: Float[np.ndarray, " p"]  # mean over channels
    roughness: Float[np.ndarray, " p"]
    flags: UInt8[np.ndarray, " p"]


def confidence(state: State, seen: Observations, sight: Sight) -> Confidence:
    """Standard errors and flags at the solver's answer."""
    scale = np.maximum(state.spread, 1.0) ** 2
    ridge = 1e-9 * np.einsum("pii->p", state.system)[:, None, None] * np.eye(6) + 1e-12 * np.eye(6)
    variance = np.einsum("pii->pi", np.linalg.inv(state.system + ridge)) * scale[:, None]
    variance = np.maximum(variance, 0)
    normal = np.minimum(np.sqrt(variance[:, 0] + variance[:, 1]), np.pi / 2)
    albedo = (np.sqrt(variance[:, 2:5]) * state.albedo).mean(1)
    roughness = np.sqrt(variance[:, 5])
    flags = np.zeros(len(normal), np.uint8)
    cosine = (state.normals * sight.views).sum(1)
    flags[(cosine < GRAZING_COSINE) | seen.edge] |= GRAZING
    if sight.occlusion is not None:
        flags[sight.occlusion.share > HIDDEN_SHARE] |= SHADOWED
    flags[seen.saturated > SATURATED_SHARE] |= SATURATED
    flags[normal > ILL_NORMAL] |= ILL
    return Confidence(normal, np.minimum(albedo, 1.0), np.minimum(roughness, 1.0), flags)
