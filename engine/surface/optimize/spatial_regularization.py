"""Neighbouring pixels come to an accord where their photographs leave it open.

Every pixel was solved for itself: two tilts of the normal, the logs of albedo, roughness. Its Gauss-Newton system says
how well the photographs know each of these and in which combination; roughness, say, hardly at all where no
highlight passed. Along each of four lines through a pixel its answer is expected half-way between the two
beside it, up to departures with Cauchy's heavy tails, so that an edge costs little. How large departures usually are is
read off the answers themselves: what their second differences show beyond what the pixels' own errors explain. Where the
photographs speak up, their systems outweigh this, and nothing changes.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.geometry import tangents
from engine.surface.data.observations import shifted_neighbours
from engine.surface.optimize.gauss_newton import ALBEDO, ROUGHNESS, PixelEstimate, rotate_normals

ALIKE = (slice(0, 2), slice(2, 5), slice(5, 6))
"""Unknowns that share one usual departure: tilts, log albedos, roughness."""


@dataclass(frozen=True, slots=True)
class RegularizationConfig:
    """An answer's word carries as many pixels far as there are sweeps. Iterated to the end, what was gained in roughness stays and
    normals of a noisy set lose what they had gained."""

    real_share: float = 0.25  # of the squared second differences, at least, that is not noise
    cauchy: float = 2.0  # width of the tails, in usual departures
    least_departure: float = 1e-12  # squared
    least_cosine: float = 0.2  # of two normals whose tilt is told: leaning farther counts as this far
    sweeps: int = 6
    step: float = 0.7  # of each, which keeps two neighbours from swapping places


CONFIG = RegularizationConfig()


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What the pixels answer."""

    normals: Float[np.ndarray, "p 3"]
    albedo: Float[np.ndarray, "p 3"]  # log
    roughness: Float[np.ndarray, " p"]

    @classmethod
    def of(cls, state: PixelEstimate) -> "Answers":
        """Those of a state."""
        return cls(state.normals, np.log(state.albedo), state.roughness)

    def offsets(self, other: "Answers") -> Float[np.ndarray, "p 6"]:
        """From these to others, in the unknowns of `gauss_newton`: radians along these normals' tangents, logs, roughness."""
        cosine = np.maximum((other.normals * self.normals).sum(1, keepdims=True), CONFIG.least_cosine)
        lean = other.normals / cosine - self.normals
        tilts = [(lean * tangent).sum(1) for tangent in tangents(self.normals)]
        return np.column_stack([*tilts, other.albedo - self.albedo, other.roughness - self.roughness])

    def moved(self, by: Float[np.ndarray, "p 6"]) -> "Answers":
        """These, moved by such offsets."""
        return Answers(
            rotate_normals(self.normals, by[:, :2]), self.albedo + by[:, 2:5], self.roughness + by[:, 5]
        )

    def halfway(self, pair: Int[np.ndarray, "p 2"]) -> "Answers":
        """For every pixel the middle of the two that `pair` names."""
        one, other = pair.T
        normals = self.normals[one] + self.normals[other]
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        middle = [(x[one] + x[other]) / 2 for x in (self.albedo, self.roughness)]
        return Answers(normals, *middle)


def regularize_spatially(state: PixelEstimate, mask: Bool[np.ndarray, "h w"]) -> PixelEstimate:
    """The state after the pixels heard their neighbours; errors and systems stay each pixel's own."""
    lines = np.array([(0, 1), (1, 0), (1, 1), (1, -1)])  # steps in rows and columns
    pairs = [shifted_neighbours(mask, np.stack([step, -step])) for step in lines]
    known = [np.all(pair >= 0, axis=1) for pair in pairs]
    own = state.hessian / np.maximum(state.residual_scale, 1.0)[:, None, None] ** 2 + 1e-6 * np.eye(6)
    covariance = np.linalg.inv(own)
    variance = np.einsum("pii->pi", covariance)
    start = Answers.of(state)
    usual = _departures(start, pairs, known, variance)
    now = start
    for _ in range(CONFIG.sweeps):
        system, pull = own.copy(), np.zeros((len(own), 6))
        at = start.offsets(now)
        for pair, there in zip(pairs, known, strict=True):
            middle = start.offsets(now.halfway(pair))
            weight = np.zeros_like(middle)
            for like in ALIKE:
                away = ((at - middle)[:, like] ** 2).mean(1, keepdims=True) / usual[like]
                weight[:, like] = 1 / usual[like] / (1 + away / CONFIG.cauchy**2) / len(lines)
            weight[~there] = 0
            system += weight[:, :, None] * np.eye(6)
            pull += weight * middle
        settled = np.linalg.solve(system, pull[..., None])[..., 0]
        now = start.moved(at + CONFIG.step * (settled - at))
    albedo, roughness = np.clip(np.exp(now.albedo), *ALBEDO), np.clip(now.roughness, *ROUGHNESS)
    return replace(state, normals=now.normals, albedo=albedo, roughness=roughness)


def _departures(
    answers: Answers,
    pairs: list[Int[np.ndarray, "p 2"]],
    known: list[Bool[np.ndarray, " p"]],
    variance: Float[np.ndarray, "p 6"],
) -> Float[np.ndarray, " 6"]:
    """The square of a usual departure from half-way, for every unknown."""
    away, error = [], []
    for pair, there in zip(pairs, known, strict=True):
        one, other = pair.T
        away.append(answers.offsets(answers.halfway(pair))[there] ** 2)
        error.append((variance + (variance[one] + variance[other]) / 4)[there])
    squares, errors = np.concatenate(away), np.concatenate(error)
    usual = np.full(6, np.inf)
    for like in ALIKE if len(squares) else ():
        seen = np.median(squares[:, like]) / 0.4549  # the median of a squared standard normal variable
        usual[like] = max(seen - np.median(errors[:, like]), CONFIG.real_share * seen, CONFIG.least_departure)
    return usual
