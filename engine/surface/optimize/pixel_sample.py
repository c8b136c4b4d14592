"""Some of the object's pixels, which stand for all of them: what they know, and who is chosen.

Camera frame.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_erosion

from engine.surface.data.observations import Observations, compensate_exposure, pixel_index
from engine.surface.optimize.gauss_newton import PixelProblem
from engine.surface.params import SurfaceParams
from engine.surface.rendering.interreflection import radiance_of_hidden_patches
from engine.surface.rendering.object_pixels import ObjectPixels, coarse_regions
from engine.surface.rendering.transport import IncidentLight, LightTransport, SurfaceGeometry


@dataclass(frozen=True, slots=True)
class PixelSampleConfig:
    """Shadows that are not foreseen quite right pull the light, and the distance most: 7 and 11 % too near by all pixels of two
    reliefs, 2 and 2 % by those whose photographs are explained best."""

    enough_inside: int = 50  # pixels away from the rim to leave it out
    explained_share: float = 0.3  # of the pixels, explained best, to pick them from


CONFIG = PixelSampleConfig()


@dataclass(frozen=True, slots=True, eq=False)
class PixelSample:
    """The pixels that vote: where they are up to the one factor, what they see, what they were seen as."""

    geometry: SurfaceGeometry  # with the object at distance 1
    observations: Observations
    photographed: Float[np.ndarray, "q v"]  # of all the object's pixels, for the light they throw
    regions: list[Int[np.ndarray, " _"]]
    full_diffuse: bool
    bounce: bool
    # The same of the walls that no photograph shows.
    walls: Float[np.ndarray, "w _"] = field(default_factory=lambda: np.zeros((0, 0), np.float32))

    def problem(self, light: IncidentLight, distance: float = 1.0) -> PixelProblem:
        """The pixels under a light when the object stands at `distance`."""
        transport = LightTransport(
            light, self.photographed, self.full_diffuse, self.bounce, "cpu", self.walls
        )
        return PixelProblem(transport, self.geometry.at(distance), self.regions, self.observations)

    def with_exposure_compensated(self, drift: Float[np.ndarray, " n"]) -> "PixelSample":
        """The same had no view's log exposure drifted."""
        seen = self.observations.with_exposure_compensated(drift)
        return replace(self, observations=seen, photographed=compensate_exposure(self.photographed, drift))


def interior(object_pixels: ObjectPixels) -> Int[np.ndarray, " k"]:
    """The pixels away from the object's rim, or all where those are few."""
    index = pixel_index(object_pixels.mask)
    found = index[np.asarray(binary_erosion(object_pixels.mask, np.ones((5, 5), bool)), bool)]
    return found if len(found) >= CONFIG.enough_inside else index[object_pixels.mask]


def random_subset(candidates: Int[np.ndarray, " k"], count: int, seed: int) -> Int[np.ndarray, " p"]:
    """At most so many of them at random, in order."""
    few = min(count, len(candidates))
    return np.sort(np.random.default_rng(seed).choice(candidates, few, replace=False))


def well_explained(
    candidates: Int[np.ndarray, " k"], residual_scale: Float[np.ndarray, " p"]
) -> Int[np.ndarray, " _"]:
    """Those of them whose residuals spread least."""
    spread = residual_scale[candidates]
    return candidates[spread <= np.quantile(spread, CONFIG.explained_share)]


def sample_pixels(
    object_pixels: ObjectPixels,
    geometry: SurfaceGeometry,
    distance: float,
    chosen: Int[np.ndarray, " p"],
    params: SurfaceParams,
    views: Int[np.ndarray, " m"] | None = None,
    light: IncidentLight | None = None,
) -> PixelSample:
    """What some pixels know, in all views or in some, given by their places among the object's. The object stands at
    `distance` in `geometry`. Walls shine as under `light`, which has the same views."""
    seen, bounce = object_pixels.observations, params.models("interreflections")
    if views is not None:
        seen = seen.part(np.arange(object_pixels.mask.sum()), views)
    at = geometry.part(chosen)
    sample = PixelSample(
        replace(at, points=at.points / distance), seen.part(chosen), seen.radiance,
        coarse_regions(np.isin(pixel_index(object_pixels.mask), chosen)), params.diffuse == "disney", bounce,
    )  # fmt: skip
    if light is None or not bounce:
        return sample
    return replace(sample, walls=radiance_of_hidden_patches(geometry, light, seen.radiance))
