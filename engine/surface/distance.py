"""How far the object is, in scene units, from the light's own parallax.

The object never moves in the camera's frame, so it cannot be triangulated; but near lights shift against the
object as the rig moves, by an amount that depends on how far in front of the camera the object is. A small
subset of pixels and views is solved at a few distances; the one with the least misfit wins, and how sharply
it wins gives the standard error. In a far room the distance is unobservable and also does not matter.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface import newton
from engine.surface.observations import Observations
from engine.surface.start import global_start
from engine.surface.transport import Incident, Responses, Sight

PASSES = 4
CANDIDATES = 150
SPREAD = 3.0
"""One residual spread for every pixel and distance, so that misfits compare."""


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
    light_at: Callable[[float, Progress], Incident],
    seen: Observations,
    rays: Float[np.ndarray, "p 3"],
    regions: list[Int[np.ndarray, " _"]],
    full_diffuse: bool,
    reach: tuple[float, float],
    count: int,
    progress: Progress,
) -> Distance:
    """Least-misfit distance between `reach`'s ends, for a small set of pixels.

    `light_at` gives the light at the lattice for an object at some distance; `rays` are the pixels' unit
    viewing directions. The minimum is refined by a parabola in log distance; its curvature, inflated by the
    misfit itself, gives the standard error (infinite where the curve does not bend).
    """
    tried = np.geomspace(*reach, count)
    misfit = np.empty(count)
    q = rays / rays[:, 2:]
    for i, z in enumerate(tried):
        span = progress.part(i / count, (i + 1) / count)
        light = light_at(float(z), span.part(0, 0.5))
        responses = Responses(light, seen.radiance, full_diffuse, False, "cpu")
        sight = Sight(q * z, -rays, None)
        start = global_start(responses, sight, seen, regions, CANDIDATES, span.part(0.5, 0.7))
        state = newton.begin(*start)
        state.spread[:] = SPREAD
        state = newton.iterate(state, responses, sight, regions, seen, PASSES, span.part(0.7, 1.0))
        # A trimmed mean: pixels in the object's own shadow misfit at every distance.
        misfit[i] = np.sort(state.misfit)[: int(0.8 * len(q))].mean() / (seen.weight > 0).mean(0).sum()
    best = int(np.argmin(misfit))
    logs = np.log(tried)
    value, stderr = float(tried[best]), float("inf")
    if 0 < best < count - 1:
        a, b, _ = np.polyfit(logs[best - 1 : best + 2] - logs[best], misfit[best - 1 : best + 2], 2)
        if a > 0:
            value = float(
                tried[best] * np.exp(np.clip(-b / (2 * a), *(logs[[best - 1, best + 1]] - logs[best])))
            )
            observations = (seen.weight > 0).sum()
            stderr = float(value * np.sqrt(max(misfit[best], 1.0) / (a * observations)))
    return Distance(value, stderr, "light", tuple(map(float, tried)), tuple(map(float, misfit)))
