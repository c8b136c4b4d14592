"""Aim rays at the light: von Mises-Fisher lobes seen from each point, mixed with the cosine of the surface.

Source: the paper, Sec. 3.3, Eq. (12); sampling after W. Jakob, "Numerically stable sampling of the von
Mises-Fisher distribution on S2" (2012); multiple importance sampling after Veach and Guibas (1995): technique
and direction are drawn together, and dividing by the mixed density is the balance heuristic. World frame,
scene units; densities are per steradian.

Three things the paper leaves open. Its kappa_i is "a scalar concentration proxy": here the inverse of a round
component's standard deviation. (The inverse variance was tried: lobes come out narrower than a near lamp, whose
light then is ten times as noisy.) Eq. (12) depends on the unit of length: here that is an argument, in the paper's
own photographs the distance from camera to object. Its lambda_i come from the centres alone, however bright each
is: that is the default, and helps little where a small lamp is a hundredth of the Gaussians; `emitted` gives
weights that follow the light.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from engine.color import luminance
from engine.errors import LightError
from engine.geometry import tangents
from engine.light.gaussians.gaussians import Y00
from engine.types import Gaussians

COMPONENTS = 64
SHARPNESS = 10.0
"""s of Eq. (12)."""
LIGHT_SHARE = 0.5
"""Share of the samples that aim at the light; the others follow the cosine."""
_STEPS, _SETTLED = 100, 1e-4  # of EM, at most; gain in mean log likelihood that ends it


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """How to draw directions at some points; lobes of each point side by side."""

    lobes: Float[np.ndarray, "n k 3"]  # mu^ of Eq. (12), unit
    kappas: Float[np.ndarray, "n k"]  # kappa^ of Eq. (12), > 0
    weights: Float[np.ndarray, " k"]  # lambda^ of Eq. (12), sums to 1

    def sample(
        self, normals: Float[np.ndarray, "n 3"], uniforms: Float[np.ndarray, "n s 3"]
    ) -> tuple[Float[np.ndarray, "n s 3"], Float[np.ndarray, "n s"]]:
        """Unit directions, and the density with which they are drawn; some lie below the horizon.

        Args:
            uniforms: in [0, 1); the first picks technique and lobe, the others place the direction.
        """
        pick, u, v = np.moveaxis(uniforms, -1, 0)
        lobe = np.searchsorted(np.cumsum(self.weights)[:-1], pick / LIGHT_SHARE, side="right")
        row = np.arange(len(normals))[:, None]
        at_light = pick < LIGHT_SHARE
        axis = np.where(at_light[..., None], self.lobes[row, lobe], normals[:, None])
        # Height below the tip of the axis, 1 - cos: as such it keeps its digits where lobes are narrow.
        drop = np.where(at_light, _drop(self.kappas[row, lobe], u), 1 - np.sqrt(1 - u))
        flat, turn = np.sqrt(drop * (2 - drop)), 2 * np.pi * v
        first, second = (side.reshape(axis.shape) for side in tangents(axis.reshape(-1, 3)))
        directions = (
            (1 - drop)[..., None] * axis
            + (flat * np.cos(turn))[..., None] * first
            + (flat * np.sin(turn))[..., None] * second
        )
        return directions, self.pdf(normals, directions)

    def pdf(
        self, normals: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n s 3"]
    ) -> Float[np.ndarray, "n s"]:
        """Density with which `sample` draws these directions."""
        light, cosine = self.densities(normals, directions)
        return LIGHT_SHARE * light + (1 - LIGHT_SHARE) * cosine

    def densities(
        self, normals: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n s 3"]
    ) -> tuple[Float[np.ndarray, "n s"], Float[np.ndarray, "n s"]]:
        """Of the two techniques, each by itself: the lobes, and the cosine."""
        light = np.zeros(directions.shape[:2])
        for lobe, kappa, weight in zip(
            np.moveaxis(self.lobes, 1, 0), self.kappas.T[..., None], self.weights, strict=True
        ):
            drop = ((directions - lobe[:, None]) ** 2).sum(-1) / 2
            light += weight * np.exp(_log_peak(kappa) - kappa * drop)
        return light, np.maximum(np.einsum("nsi,ni->ns", directions, normals), 0) / np.pi


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """The light as round Gaussian components, seen from nowhere yet; fitted once per light."""

    means: Float[np.ndarray, "k 3"]  # world
    concentrations: Float[np.ndarray, " k"]  # kappa of Eq. (12), > 0: `unit` / standard deviation
    weights: Float[np.ndarray, " k"]  # lambda of Eq. (12), > 0, sums to 1
    unit: float  # the length that Eq. (12) takes for 1, scene units

    def at(self, points: Float[np.ndarray, "n 3"], sharpness: float = SHARPNESS) -> Proposal:
        """The lobes as Eq. (12) has them at each point.

        Raises:
            LightError: a point lies on a component's mean, where Eq. (12) has no direction.
        """
        away = self.means - points[:, None].astype(np.float64)
        distance = np.linalg.norm(away, axis=2)
        if (distance < 1e-9 * self.unit).any():
            raise LightError("a surface point lies on the centre of a light; check the poses and the depth")
        kappas = sharpness * self.concentrations * self.unit / distance
        return Proposal(away / distance[..., None], kappas, self.weights)


def fit(
    gaussians: Gaussians,
    seed: int,
    components: int = COMPONENTS,
    unit: float = 1.0,
    weights: Float[np.ndarray, " m"] | None = None,
) -> Mixture:
    """Components over the Gaussians' centres, by expectation maximisation from a k-means++ start.

    Args:
        components: at most; there are fewer where there are fewer Gaussians.
        unit: length that Eq. (12) takes for 1, scene units.
        weights: how much each centre counts; None: all the same, as in the paper.

    Raises:
        LightError: no Gaussian counts.
    """
    weights = np.ones(len(gaussians.means)) if weights is None else weights
    counted = np.nonzero(weights > 0)[0]
    if len(counted) == 0:
        raise LightError("no Gaussian of the light shines, so no ray can aim at it; fit the light again")
    points = gaussians.means[counted].astype(np.float64)
    mass = weights[counted] / weights[counted].sum()
    # A centre stands for its Gaussian, whose variance is scale^2 / 2: else one lone lamp would be a point.
    extent = (gaussians.scales[counted].astype(np.float64) ** 2).mean(1) / 2
    means = _scattered(points, mass, components, np.random.default_rng(seed))
    variance = np.full(
        len(means), mass @ ((points - mass @ points) ** 2).mean(1) / len(means) + mass @ extent
    )
    share, before = np.full(len(means), 1 / len(means)), -np.inf
    for _ in range(_STEPS):
        score = np.log(share) - 1.5 * np.log(variance) - 0.5 * _squared(points, means) / variance
        best = score.max(1, keepdims=True)
        belongs = np.exp(score - best)
        total = belongs.sum(1, keepdims=True)
        likelihood = float(mass @ (best + np.log(total))[:, 0])
        held = (belongs / total) * mass[:, None]
        share = held.sum(0)
        alive = share > 1e-12
        held, share = held[:, alive], share[alive]
        means = (held.T @ points) / share[:, None]
        spread = _squared(points, means) / 3 + extent[:, None]
        variance = (held * spread).sum(0) / share
        if likelihood - before < _SETTLED:
            break
        before = likelihood
    return Mixture(means, unit / np.sqrt(variance), share / share.sum(), float(unit))


def emitted(gaussians: Gaussians) -> Float[np.ndarray, " m"]:
    """What each Gaussian sends out, up to one factor: luminance times opacity times cross-section."""
    level = np.maximum(luminance(gaussians.radiance[:, 0].astype(np.float64) * Y00), 0)
    a, b, c = gaussians.scales.astype(np.float64).T
    return level * -np.expm1(-gaussians.density) * (a * b + b * c + c * a)


def _drop(kappas: Float[np.ndarray, "*n"], u: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """1 - cos of the angle to a lobe's mean, by inversion of its distribution function."""
    with np.errstate(divide="ignore"):  # u = 0 under a narrow lobe: the far end, which is the sphere's
        return np.minimum(-np.log1p((1 - u) * np.expm1(-2 * kappas)) / kappas, 2.0)


def _log_peak(kappas: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Logarithm of a lobe's density at its mean; sinh(kappa) of the textbook overflows beyond 700."""
    return np.log(kappas) - np.log(2 * np.pi) - np.log(-np.expm1(-2 * kappas))


def _scattered(
    points: Float[np.ndarray, "m 3"], mass: Float[np.ndarray, " m"], count: int, rng: np.random.Generator
) -> Float[np.ndarray, "k 3"]:
    """Starting means among the points, each far from those before it: k-means++ (Arthur and Vassilvitskii 2007)."""
    chosen = [points[rng.choice(len(points), p=mass)]]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, ((points - chosen[-1]) ** 2).sum(1))
        pull = mass * nearest
        if not pull.sum() > 0:
            break
        chosen.append(points[rng.choice(len(points), p=pull / pull.sum())])
    return np.array(chosen)


def _squared(points: Float[np.ndarray, "m 3"], means: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "m k"]:
    """Squared distances."""
    # Around their middle: far from the origin the product below would cancel.
    middle = points.mean(0)
    a, b = points - middle, means - middle
    return np.maximum((a**2).sum(1)[:, None] - 2 * a @ b.T + (b**2).sum(1), 0)
