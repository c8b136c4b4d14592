"""Some of the object's pixels, which stand for all of them: what they know, and who is chosen.

Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_erosion

from engine.surface.data.observations import Observations, compensate_exposure, pixel_index
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.interreflection import radiance_of_hidden_patches
from engine.surface.rendering.object_pixels import ObjectPixels, coarse_regions
from engine.surface.rendering.transport import IncidentLight, LightTransport, SurfaceGeometry


@dataclass(frozen=True, slots=True)
class PixelSampleConfig:
    """Shadows that are not foreseen quite right pull the light, and the distance most: 7 and 11 % too near by all pixels of two
    reliefs, 2 and 2 % by those whose photographs are explained best."""

    enough_inside: int = 50  # pixels away from the rim to leave it out
    explained_share: float = 0.3  # of the pixels, explained best, to pick them from


@dataclass(frozen=True, slots=True, eq=False)
class PixelSample:
    """The pixels that vote: where they are up to the one factor, what they see, what they were seen as."""

    geometry: SurfaceGeometry  # with the object at distance 1
    observations: Observations
    photographed: Float[np.ndarray, "q v"]  # of all the object's pixels, for the light they throw
    regions: list[Int[np.ndarray, " _"]]
    full_diffuse: bool
    bounce: bool
    walls: Float[np.ndarray, "w v"] | None = None  # the same of the walls that no photograph shows

    def geometry_at(self, distance: float) -> SurfaceGeometry:
        """What the pixels see when the object stands at `distance`."""
        return self.geometry.at(distance)

    def light_transport(self, light: IncidentLight) -> LightTransport:
        """How they answer a light."""
        return LightTransport(light, self.photographed, self.full_diffuse, self.bounce, "cpu", self.walls)

    def with_exposure_compensated(self, drift: Float[np.ndarray, " n"]) -> "PixelSample":
        """The same had no view's log exposure drifted."""
        return replace(
            self,
            observations=self.observations.with_exposure_compensated(drift),
            photographed=compensate_exposure(self.photographed, drift),
        )


def interior(
    object_pixels: ObjectPixels, config: PixelSampleConfig = PixelSampleConfig()
) -> Int[np.ndarray, " k"]:
    """The pixels away from the object's rim, or all where those are few."""
    index = pixel_index(object_pixels.mask)
    found = index[np.asarray(binary_erosion(object_pixels.mask, np.ones((5, 5), bool)), bool)]
    return found if len(found) >= config.enough_inside else index[object_pixels.mask]


def random_subset(candidates: Int[np.ndarray, " k"], count: int, seed: int) -> Int[np.ndarray, " p"]:
    """At most so many of them at random, in order."""
    few = min(count, len(candidates))
    return np.sort(np.random.default_rng(seed).choice(candidates, few, replace=False))


def calibration_pixels(
    object_pixels: ObjectPixels,
    geometry: SurfaceGeometry,
    distance: float,
    count: int,
    params: SurfaceParams,
    seed: int,
    views: Int[np.ndarray, " m"] | None = None,
    spread: Float[np.ndarray, " q"] | None = None,
    light: IncidentLight | None = None,
    config: PixelSampleConfig = PixelSampleConfig(),
) -> tuple[Int[np.ndarray, " p"], PixelSample]:
    """A random part of the pixels, away from the rim where there is enough of it, and of the best explained once
    `spread` of the residuals tells them: their indices, and what they know (`sample_pixels`)."""
    open_to = interior(object_pixels, config)
    if spread is not None:
        open_to = open_to[spread[open_to] <= np.quantile(spread[open_to], config.explained_share)]
    chosen = random_subset(open_to, count, seed)
    return chosen, sample_pixels(object_pixels, geometry, distance, chosen, params, views, light)


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
    seen = (
        object_pixels.observations
        if views is None
        else object_pixels.observations.part(np.arange(object_pixels.mask.sum()), views)
    )
    hidden = geometry.visibility.part(chosen) if geometry.visibility is not None else None
    made = of_pixels(geometry.material, chosen)
    return PixelSample(
        SurfaceGeometry(geometry.points[chosen] / distance, geometry.views[chosen], hidden, material=made),
        seen.part(chosen),
        seen.radiance,
        coarse_regions(np.isin(pixel_index(object_pixels.mask), chosen)),
        params.diffuse == "disney",
        params.models("interreflections"),
        radiance_of_hidden_patches(geometry, light, seen.radiance)
        if light is not None and params.models("interreflections")
        else None,
    )
