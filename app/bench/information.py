"""The least error that any unbiased estimate of a pixel's normal can have from its photographs (Cramer and Rao).

A pixel's six unknowns are those of `engine.surface.optimize.gauss_newton`: two tilts, three logs of albedo, roughness. Its radiances
scatter by the sensor and by the studio's path tracing. Whether radiances or their logarithms are compared makes no
difference: derivatives and deviations are divided by the same number. Angles are radians.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ellipe

from engine.surface.optimize.gauss_newton import STEP, PixelEstimate, perturbed, roughness_step
from engine.surface.rendering.transport import SurfaceGeometry, TransportModel

SHARED = 0.8
"""Correlation of the path tracer's noise between channels, for a sample that finds a lamp finds it in all three: 0.79 to 0.88
between two renderings of 240 pixels of study-blob in 6 views; 0.01 between views."""
DIMMEST = 0.1
"""Of a pixel's mean over the views."""
LEAST = 40
"""A mean over fewer pixels says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """Of `chosen` pixels of the object, in row order."""

    chosen: Bool[np.ndarray, "h w"]
    normal_deg: Float[np.ndarray, " k"]  # mean angle to the true normal
    blur_deg: Float[np.ndarray, " k"]  # between the truth, at the pixel's centre, and its mean over the pixel

    def over(self, mask: Bool[np.ndarray, "h w"]) -> tuple[float, float]:
        """The means of both over the chosen ones of some pixels, degrees; NaN where they are too few."""
        among = mask[self.chosen]
        if among.sum() < LEAST:
            return float("nan"), float("nan")
        return float(self.normal_deg[among].mean()), float(self.blur_deg[among].mean())


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """Of a radiance x: variance `shot` x + `floor`^2 of its own, and (`path`^2 `level`) x of the path tracer, of which the part
    `shared` is the same in all channels of a view. `level` is the pixel's mean over the views.

    That the path tracer's variance grows with x was measured between two renderings, over a tenfold range of x; below `DIMMEST`
    of the level it is taken to stay as it is there, or views in which a pixel is all but dark would tell without any noise.
    """

    shot: float
    floor: float
    path: float
    shared: float = SHARED


def information(
    radiance: Float[np.ndarray, "p n 3"], jacobian: Float[np.ndarray, "p n 3 u"], scatter: Scatter
) -> Float[np.ndarray, "p u u"]:
    """Fisher information of the unknowns: derivatives of the true radiance by each, over its scatter."""
    radiance = np.maximum(radiance, 0)  # beside bright light a cell may hold a little less than nothing
    level = radiance.mean(1, keepdims=True)
    traced = scatter.path**2 * level * np.maximum(radiance, DIMMEST * level)
    own = scatter.shot * radiance + scatter.floor**2 + (1 - scatter.shared) * traced
    common = np.sqrt(scatter.shared * traced)
    # Per view the scatter is own + common common^T: its inverse by Sherman and Morrison.
    weighed = jacobian / own[..., None]
    told = np.einsum("pncu,pncw->puw", jacobian, weighed)
    lost = np.einsum("pncu,pnc->pnu", weighed, common)
    return told - np.einsum("pnu,pnw,pn->puw", lost, lost, 1 / (1 + (common**2 / own).sum(2)))


def expected_angle(information: Float[np.ndarray, "p u u"]) -> Float[np.ndarray, " p"]:
    """Mean angle between a normal and its true one, if the two tilts scatter as little as the information allows.

    With tilts of equal deviation s it is s sqrt(pi / 2), which is sqrt(pi / 4) of their RMS; else an ellipse's
    circumference tells (complete elliptic integral of the second kind). A right angle where nothing is known.
    """
    scale = np.sqrt(np.einsum("puu->pu", information))
    known = (scale > 0).all(1)
    angle = np.full(len(information), np.pi / 2)
    scale = scale[known]
    scaled = information[known] / scale[:, :, None] / scale[:, None, :]
    covariance = np.linalg.inv(scaled + 1e-9 * np.eye(information.shape[1]))
    tilts = (covariance / scale[:, :, None] / scale[:, None, :])[:, :2, :2]
    small, large = np.maximum(np.linalg.eigvalsh(tilts), 1e-300).T
    angle[known] = np.minimum(np.sqrt(2 * large / np.pi) * ellipe(1 - small / large), np.pi / 2)
    return angle


def derivatives(
    transport: TransportModel, geometry: SurfaceGeometry, pixels: Int[np.ndarray, " p"], at: PixelEstimate
) -> tuple[Float[np.ndarray, "p n 3"], Float[np.ndarray, "p n 3 6"]]:
    """Radiance of some pixels in every view, and its derivatives by the six unknowns."""
    n, r, albedo = at.normals[pixels], at.roughness[pixels], at.albedo[pixels][:, None]
    leaning, rough = perturbed(n, r)
    diffuse, specular = (
        x.astype(np.float64).reshape(len(pixels), 4, -1, 3)
        for x in transport(transport.block(geometry, pixels), leaning, rough)
    )
    sent = albedo[:, None] * diffuse + specular
    steps = np.stack([np.full(len(pixels), STEP), np.full(len(pixels), STEP), roughness_step(r)], 1)
    jacobian = np.zeros((*sent[:, 0].shape, 6))
    for k, unknown in enumerate((0, 1, 5)):
        jacobian[..., unknown] = (sent[:, k + 1] - sent[:, 0]) / steps[:, k, None, None]
    for c in range(3):
        jacobian[:, :, c, 2 + c] = albedo[..., c] * diffuse[:, 0, :, c]
    return sent[:, 0], jacobian
