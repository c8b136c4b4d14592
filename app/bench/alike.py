"""What every method beside ours is given, so that rows differ in the method alone: ours' light and distance.

Of a lamp that all photographs show clipped, of what none shows, and of how far away the object stands, only the
object's shading tells, and reading that is our solver's. The others get its answers (at its defaults, not counted in
their seconds): the light under its gains, and the object at its distance.
"""

from dataclasses import dataclass, replace

import numpy as np

from app.bench.stored import Stored
from engine.progress import Progress
from engine.surface.params import SurfaceParams
from engine.surface.solve import solve
from engine.types import Emitters


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """A solver's input under our light, and the object's distance in scene units."""

    stored: Stored
    distance: float


_found: dict[tuple[Stored, str, int], Alike] = {}
"""The last answer alone: inputs are large, and rows come set by set."""


def alike(stored: Stored, device: str, seed: int) -> Alike:
    """What ours found, on the same input.

    Raises:
        SurfaceError: what our solver has to say.
    """
    if (stored, device, seed) not in _found:
        found = solve(stored.captured, SurfaceParams(), device, seed, Progress())
        hand_over(stored, device, seed, found.emitters, found.report.distance.value)
    return _found[stored, device, seed]


def hand_over(stored: Stored, device: str, seed: int, emitters: Emitters, distance: float) -> None:
    """What our solver at its defaults just found: it need not be solved again for the rows beside it."""
    _found.clear()
    _found[stored, device, seed] = Alike(under(stored, emitters), distance)


def under(stored: Stored, emitters: Emitters) -> Stored:
    """The same input under another light."""
    # Their brightness is known now, as far as anybody knows it.
    lamps = replace(emitters.lamps, clipped=np.zeros(len(emitters.lamps.radii), bool))
    return replace(stored, gaussians=emitters.gaussians, lamps=lamps)
