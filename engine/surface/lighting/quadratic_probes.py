"""Where the light around an object is gathered, and what that tells of every probe of its lattice.

Over the object's box the light of one direction is close to a quadratic of the place: the middle and the middles of the box's
twelve edges fix its ten coefficients, and the lattice, however many probes it has, is told by those thirteen. Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from engine.color import luminance
from engine.surface.rendering.transport import ProbeGrid

_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
_CHOSEN = np.isin(np.abs(_CUBE).sum(1), (0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticProbes:
    """Where light is gathered for a lattice; with no weights, at its own probes."""

    points: Float[np.ndarray, "k 3"]
    weights: Float[np.ndarray, "m k"] | None  # of these points for every probe
    beside: tuple[Int[np.ndarray, " _"], ...]  # for every probe the points nearest to it

    def everywhere(self, energy: Float[np.ndarray, "k d v"]) -> Float[np.ndarray, "m d v"]:
        """What was gathered, at every probe; a direction that hardly shines may come out a little below zero."""
        if self.weights is None:
            return energy
        flat = self.weights.astype(energy.dtype) @ energy.reshape(len(energy), -1)
        return flat.reshape(len(self.weights), *energy.shape[1:])

    def brightest(
        self, energy: Float[np.ndarray, "k d v"], label: Int[np.ndarray, "k d n"]
    ) -> Int[np.ndarray, "m d n"]:
        """Labels of directions at every probe: what the brightest of the points beside it has there."""
        if self.weights is None:
            return label
        k, d, n = label.shape
        level = luminance(energy.reshape(k, d, n, 3))
        found = np.empty((len(self.beside), d, n), label.dtype)
        for probe, some in enumerate(self.beside):
            best = level[some].argmax(0)[None]
            found[probe] = np.take_along_axis(label[some], best, 0)[0]
        return found


def quadratic_probes(lattice: ProbeGrid) -> QuadraticProbes:
    """Thirteen points where that is fewer than the lattice has, and tells as much."""
    points = lattice.points()
    # With more than four along an axis light bends too much between them for a quadratic.
    if len(points) <= _CHOSEN.sum() or min(lattice.shape) == 1 or max(lattice.shape) > 4:
        return QuadraticProbes(points, None, ())
    chosen = replace(lattice, shape=(3, 3, 3)).points()[_CHOSEN]
    axes = [np.linspace(-1, 1, count) for count in lattice.shape]
    at = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    distance = np.linalg.norm(at[:, None] - _CUBE[_CHOSEN], axis=2)
    weights = _terms(at) @ np.linalg.pinv(_terms(_CUBE[_CHOSEN]))
    # Where light was gathered it is known.
    known, where = np.nonzero(distance < 1e-9)
    weights[known] = np.eye(len(chosen))[where]
    beside = tuple(np.nonzero(row < row.min() + 1e-9)[0] for row in distance)
    return QuadraticProbes(chosen, weights, beside)


def _terms(at: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 10"]:
    """A quadratic's terms."""
    x, y, z = at.T
    return np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], 1)
