"""What every method beside ours is given, so that rows differ in the method alone: ours' light and distance.

Of a lamp that all photographs show clipped, of what none shows, and of how far away the object stands, only the
object's shading tells, and reading that is our solver's. The others get its answers (at its defaults, not counted in their seconds):
the light under its gains, and the object at its distance.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np

from app.bench.stored import Stored
from engine.light.globes import beside
from engine.progress import Progress
from engine.surface.pixels import SurfaceParams
from engine.surface.solve import solve
from engine.surface.surroundings import furnished


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """A solver's input under our light, and the object's distance in scene units."""

    stored: Stored
    distance: float


@functools.lru_cache(maxsize=2)
def alike(stored: Stored, device: str, seed: int) -> Alike:
    """What ours found, on the same input.

    Raises:
        SurfaceError: what our solver has to say.
    """
    params = SurfaceParams()
    *_, report = solve(*stored.inputs, params, device, seed, Progress())
    gain = np.array(report.light_gains)[:-1]  # the last is that of what was filled in
    return Alike(brightened(stored, gain, params, seed), report.distance.value)


def brightened(stored: Stored, gain: np.ndarray, params: SurfaceParams, seed: int) -> Stored:
    """The same room with every group of emitters under its gain (`SurfaceReport.light_gains` without the last)."""
    room = furnished(
        stored.gaussians, stored.lamps, stored.frames, stored.masks, stored.poses, params.relight_groups,
        params.relight_prior, seed,
    )  # fmt: skip
    field, lamps = room.under(gain)
    # Their brightness is known now, as far as anybody knows it.
    known = replace(lamps, clipped=np.zeros(len(lamps.radii), bool))
    return replace(stored, gaussians=beside(field, lamps), lamps=known)
