"""Some of the object's pixels, which stand for all of them: what they know, and who is chosen.

Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_erosion

from engine.surface.data.observations import Observations, evened, numbered
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.interreflection import lit
from engine.surface.rendering.object_pixels import Subject, coarse_regions
from engine.surface.rendering.transport import Incident, Responses, Sight

FEW = 50
"""So many pixels away from the rim are enough to leave it out."""
EXPLAINED = 0.3
"""Share of the pixels to pick them from: those whose photographs are explained best. Shadows that are not foreseen quite
right pull the light, and the distance most: 7 and 11 % too near by all pixels of two reliefs, 2 and 2 % by these."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The pixels that vote: where they are up to the one factor, what they see, what they were seen as."""

    sight: Sight  # with the object at distance 1
    seen: Observations
    photographed: Float[np.ndarray, "q v"]  # of all the object's pixels, for the light they throw
    regions: list[Int[np.ndarray, " _"]]
    full_diffuse: bool
    bounce: bool
    walls: Float[np.ndarray, "w v"] | None = None  # the same of the walls that no photograph shows

    def at(self, distance: float) -> Sight:
        """What the pixels see when the object stands at `distance`."""
        return self.sight.at(distance)

    def responses(self, light: Incident) -> Responses:
        """How they answer a light."""
        return Responses(light, self.photographed, self.full_diffuse, self.bounce, "cpu", self.walls)

    def exposed(self, drift: Float[np.ndarray, " n"]) -> "Sample":
        """The same had no view's log exposure drifted."""
        return replace(self, seen=self.seen.exposed(drift), photographed=evened(self.photographed, drift))


def inner(who: Subject) -> Int[np.ndarray, " k"]:
    """The pixels away from the object's rim, or all where those are few."""
    index = numbered(who.mask)
    found = index[np.asarray(binary_erosion(who.mask, np.ones((5, 5), bool)), bool)]
    return found if len(found) >= FEW else index[who.mask]


def some_of(candidates: Int[np.ndarray, " k"], count: int, seed: int) -> Int[np.ndarray, " p"]:
    """At most so many of them at random, in order."""
    few = min(count, len(candidates))
    return np.sort(np.random.default_rng(seed).choice(candidates, few, replace=False))


def voters(
    who: Subject,
    sight: Sight,
    distance: float,
    count: int,
    params: SurfaceParams,
    seed: int,
    views: Int[np.ndarray, " m"] | None = None,
    spread: Float[np.ndarray, " q"] | None = None,
    light: Incident | None = None,
) -> tuple[Int[np.ndarray, " p"], Sample]:
    """A random part of the pixels, away from the rim where there is enough of it, and of the best explained once
    `spread` of the residuals tells them: their indices, and what they know (`sampled`)."""
    open_to = inner(who)
    if spread is not None:
        open_to = open_to[spread[open_to] <= np.quantile(spread[open_to], EXPLAINED)]
    chosen = some_of(open_to, count, seed)
    return chosen, sampled(who, sight, distance, chosen, params, views, light)


def sampled(
    who: Subject,
    sight: Sight,
    distance: float,
    chosen: Int[np.ndarray, " p"],
    params: SurfaceParams,
    views: Int[np.ndarray, " m"] | None = None,
    light: Incident | None = None,
) -> Sample:
    """What some pixels know, in all views or in some, given by their places among the subject's. The object stands at
    `distance` in `sight`. Walls shine as under `light`, which has the same views."""
    seen = who.seen if views is None else who.seen.part(np.arange(who.mask.sum()), views)
    hidden = sight.occlusion.part(chosen) if sight.occlusion is not None else None
    made = of_pixels(sight.material, chosen)
    return Sample(
        Sight(sight.points[chosen] / distance, sight.views[chosen], hidden, material=made),
        seen.part(chosen),
        seen.radiance,
        coarse_regions(np.isin(numbered(who.mask), chosen)),
        params.full_diffuse,
        params.bounce,
        lit(sight, light, seen.radiance) if light is not None and params.bounce else None,
    )
