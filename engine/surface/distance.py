"""How far the object is, in scene units, from the light's own parallax.

The object never moves in the camera's frame, so it cannot be triangulated; but near lights shift against the
object as the rig moves, by an amount that depends on how far in front of the camera the object is. A small
subset of pixels and views is solved at a few distances; the one with the least misfit wins, and how sharply
it wins gives the standard error. In a far room the distance is unobservable and also does not matter.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface import newton
from engine.surface.observations import Observations
from engine.surface.start import global_start
from engine.surface.transport import Incident, Responses, Sight

PASSES = 4
CANDIDATES = 150
FINE_STEPS = 5
"""Distances tried between the neighbours of the coarse minimum."""
SPREAD = 3.0
"""One residual spread for every pixel and distance, so that misfits compare."""
TRUSTED = 0.8
"""Share of the pixels that vote: those in the object's own shadow misfit at every distance."""


@dataclass(frozen=True, slots=True)
class Distance:
    """Camera to object along z, scene units, with one standard error; `source` is "given" or "light".

    `tried` and `misfit` (mean per observation) are the curve that was minimised, for the report.
    """

    value: float
    stderr: float
    source: str
    tried: tuple[float, ...] = ()
    misfit: tuple[float, ...] = ()


def find_distance(
    light_between: Callable[[float, float, bool, Progress], Incident],
    seen: Observations,
    rays: Float[np.ndarray, "p 3"],
    regions: list[Int[np.ndarray, " _"]],
    full_diffuse: bool,
    reach: tuple[float, float],
    progress: Progress,
) -> Distance:
    """Least-misfit distance between `reach`'s ends, for a small set of pixels.

    `light_between` gives the light at a lattice that spans two distances, coarse or (True) fine; `rays` are
    the pixels' unit viewing directions. Every layer of the coarse lattice is tried from scratch, then
    distances between the best one's neighbours from where it ended. A parabola in log distance through
    the three best gives the minimum; pixels drawn again and again (bootstrap) give its standard error.
    """
    q = rays / rays[:, 2:]

    def trial(responses: Responses, z: float, state: newton.State | None, span: Progress) -> newton.State:
        sight = Sight(q * z, -rays, None)
        if state is None:
            state = newton.begin(
                *global_start(responses, sight, seen, regions, CANDIDATES, span.part(0, 0.4))
            )
        state.spread[:] = SPREAD
        state = replace(state, misfit=np.full(len(q), np.inf))
        return newton.iterate(state, responses, sight, regions, seen, PASSES, span.part(0.4, 1.0))

    coarse = light_between(*reach, False, progress.part(0, 0.3))
    responses = Responses(coarse, seen.radiance, full_diffuse, False, "cpu")
    layers = coarse.lattice.depths()
    states = [
        trial(responses, float(z), None, progress.part(0.3 + 0.3 * i / len(layers), 0.3 + 0.3 * (i + 1) / len(layers)))
        for i, z in enumerate(layers)
    ]  # fmt: skip
    count = (seen.weight > 0).mean(0).sum()
    best = int(np.argmin([_trimmed(state.misfit) for state in states]))
    first, last = layers[max(best - 1, 0)], layers[min(best + 1, len(layers) - 1)]
    fine = light_between(float(first), float(last), True, progress.part(0.6, 0.8))
    responses = Responses(fine, seen.radiance, full_diffuse, False, "cpu")
    tried = np.geomspace(first, last, FINE_STEPS)
    found = [
        trial(responses, float(z), states[best], progress.part(0.8 + 0.2 * i / FINE_STEPS, 0.8 + 0.2 * (i + 1) / FINE_STEPS))
        for i, z in enumerate(tried)
    ]  # fmt: skip
    table = np.stack([state.misfit for state in found])
    value, bends = _minimum(tried, table)
    stderr = float("inf")
    if bends:
        generator = np.random.default_rng(0)
        draws = [_minimum(tried, table[:, generator.integers(0, len(q), len(q))])[0] for _ in range(100)]
        stderr = float(np.std(draws))
    misfit = [_trimmed(state.misfit) / count for state in found]
    return Distance(value, stderr, "light", tuple(map(float, tried)), tuple(map(float, misfit)))


def _trimmed(misfit: Float[np.ndarray, " p"]) -> float:
    return float(np.sort(misfit)[: int(TRUSTED * len(misfit))].mean())


def _minimum(tried: Float[np.ndarray, " k"], table: Float[np.ndarray, "k p"]) -> tuple[float, bool]:
    """Where the trimmed misfit is least, and whether it rises on both sides."""
    curve, logs = np.array([_trimmed(row) for row in table]), np.log(tried)
    best = int(np.argmin(curve))
    if not 0 < best < len(curve) - 1:
        return float(tried[best]), False
    near = slice(best - 1, best + 2)
    a, b, _ = np.polyfit(logs[near] - logs[best], curve[near], 2)
    shift = np.clip(-b / (2 * a), *(logs[[best - 1, best + 1]] - logs[best])) if a > 0 else 0.0
    return float(tried[best] * np.exp(shift)), True
