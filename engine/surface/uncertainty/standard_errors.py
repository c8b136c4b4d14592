"""How far each pixel can be trusted: standard errors from its own Gauss-Newton system and from parts of the views, and flags.

The system's covariance is (J^T W J)^-1 times the squared spread of the weighted residuals where that exceeds one. It takes residuals for
independent, which those of neighbouring views and of the three channels are not: they look at one and the same error of
the light. So the answer is also asked what it would be without each of a few stretches of the views (delete-a-group
jackknife: Shao, Tu, "The Jackknife and Bootstrap", 1995, ch. 2), one Gauss-Newton step each. What is wrong
alike in all views, neither can know: of the light `LightVariance` tells it, and of what is smaller than a pixel its neighbours
(`unresolved_variance`). Radians for normals.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import correlate1d, uniform_filter
from scipy.spatial import KDTree

from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.spatial_regularization import Answers
from engine.surface.rendering.transport import SurfaceGeometry

FLAGS = {"grazing": 1, "shadowed": 2, "saturated": 4, "ill_conditioned": 8, "guessed_light": 16}
"""The bits of `Surface.flags` by name."""


@dataclass(frozen=True, slots=True)
class StandardErrorsConfig:
    """From where on a pixel is flagged, and the jackknife: so many stretches that each still holds a whole turn of neighbouring
    views, and few enough to be cheap.

    A variance from 8 pieces is itself uncertain: the squared ratio of the 95 % bounds, Hotelling's T over chi for the two of a
    normal, Student's t over the normal law for the rest (7 degrees of freedom).
    """

    grazing_cosine: float = 0.2
    hidden_share: float = 0.5
    saturated_share: float = 0.25
    guessed_share: float = 0.1
    ill_normal_deg: float = 10.0
    stretches: int = 8
    variance_factor: tuple[float, ...] = (2.0, 2.0, 1.46, 1.46, 1.46, 1.46)  # for so few
    neighbours: int = 8  # pixels of the most alike normals that tell what the light's doubt is worth


CONFIG = StandardErrorsConfig()


@dataclass(frozen=True, slots=True, eq=False)
class StandardErrors:
    """One standard error per quantity and the flags of `Surface.flags`."""

    normal: Float[np.ndarray, " p"]  # radians, root of the two tangent variances' sum
    albedo: Float[np.ndarray, " p"]  # mean over channels
    roughness: Float[np.ndarray, " p"]
    flags: UInt8[np.ndarray, " p"]


@dataclass(frozen=True, slots=True, eq=False)
class LightVariance:
    """What some pixels' unknowns vary by, as the light is not wholly known; neighbours by normal speak for a pixel."""

    normals: Float[np.ndarray, "q 3"]
    variance: Float[np.ndarray, "q 6"]

    def of(self, normals: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 6"]:
        """Variances of pixels of these normals."""
        near = KDTree(self.normals).query(normals, min(CONFIG.neighbours, len(self.normals)))[1]
        return self.variance[near.reshape(len(normals), -1)].mean(1)


def formal(system: Float[np.ndarray, "p 6 6"], spread: Float[np.ndarray, " p"]) -> Float[np.ndarray, "p 6"]:
    """Variances that the system gives if residuals are independent."""
    variance = np.einsum("pii->pi", np.linalg.inv(gauss_newton.with_ridge(system)))
    return np.maximum(variance * np.maximum(spread, 1.0)[:, None] ** 2, 0)


def jackknife(
    state: gauss_newton.PixelEstimate, problem: gauss_newton.PixelProblem, progress: Progress
) -> tuple[gauss_newton.PixelEstimate, Float[np.ndarray, "p 6"]]:
    """The state with its residuals' spread measured, and its variances by leaving out stretches of the views, no less than the
    formal ones."""
    count = CONFIG.stretches
    state, groups = gauss_newton.hessians_by_view_group(state, problem, count, progress)
    system, slope = groups.hessian.sum(1), groups.gradient.sum(1)
    without = np.stack([
        np.linalg.solve(gauss_newton.with_ridge(system - groups.hessian[:, k]), (slope - groups.gradient[:, k])[..., None])[..., 0]
        for k in range(count)
    ])  # fmt: skip
    variance = (count - 1) * without[..., :6].var(0) * np.array(CONFIG.variance_factor)
    return state, np.maximum(
        variance, formal(gauss_newton.eliminate_last(system, slope)[0], state.residual_scale)
    )


def grid_refinement_error(
    coarse: gauss_newton.PixelEstimate, state: gauss_newton.PixelEstimate
) -> Float[np.ndarray, "p 6"]:
    """Variances of the unknowns of an object that has not come to rest: the squares of how far they have come since the `coarse`
    answer.

    What separates an answer from that on half the pixels, some rounds before, is about what still separates it from the one that
    it is on its way to (Roache, "Perspective: A Method for Uniform Reporting of Grid Refinement Studies", 1994).
    """
    before, now = (Answers.of(x) for x in (coarse, state))
    return now.offsets(before) ** 2


def standard_errors(
    state: gauss_newton.PixelEstimate,
    variance: Float[np.ndarray, "p 6"],
    observations: Observations,
    geometry: SurfaceGeometry,
    guessed: Float[np.ndarray, " p"],
) -> StandardErrors:
    """Standard errors and flags at the solver's answer, given the variances of its unknowns; `guessed` is the share of
    each pixel's light that comes from what no photograph shows."""
    normal = np.minimum(np.sqrt(variance[:, 0] + variance[:, 1]), np.pi / 2)
    albedo = (np.sqrt(variance[:, 2:5]) * state.albedo).mean(1)
    roughness = np.sqrt(variance[:, 5])
    cosine = (state.normals * geometry.views).sum(1)
    hidden = np.zeros(len(normal)) if geometry.visibility is None else geometry.visibility.hidden_share
    found = {
        "grazing": (cosine < CONFIG.grazing_cosine) | observations.edge,
        "shadowed": hidden > CONFIG.hidden_share,
        "saturated": observations.saturated > CONFIG.saturated_share,
        "ill_conditioned": normal > np.radians(CONFIG.ill_normal_deg),
        "guessed_light": guessed > CONFIG.guessed_share,
    }
    flags = np.zeros(len(normal), np.uint8)
    for name, here in found.items():
        flags[here] |= FLAGS[name]
    return StandardErrors(normal, np.minimum(albedo, 1.0), np.minimum(roughness, 1.0), flags)


def unresolved_variance(
    normals: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], stderr: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Variances of normals at pixel centres by edges that cross pixels, of which a pixel sees a mean.

    An edge between two normals, anywhere in a pixel, leaves its centre off the mean by a uniform share, up to half, of their
    difference d: d^2 / 12 in the mean square. The squares of the second differences of the three pixels across it come to d^2 / 3
    each in the mean, so a quarter of the mean around is told, less what the standard errors make of it. It is 0 where the surface
    bends evenly.
    """
    variance, steps = stderr.astype(np.float64) ** 2, np.zeros(mask.shape)
    for axis in (0, 1):
        inside = correlate1d(mask.astype(int), [1, 1, 1], axis, mode="constant") == 3
        second = correlate1d(normals.astype(np.float64), [1, -2, 1], axis, mode="constant")
        bend = (second**2).sum(-1) - correlate1d(variance, [1, 4, 1], axis, mode="constant")
        steps += np.where(inside, bend, 0)
    return np.maximum(uniform_filter(steps, 3, mode="constant"), 0) / 4
