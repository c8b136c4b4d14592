"""Everything that a solve knows at some moment. Camera frame."""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface.data.observations import parent_index
from engine.surface.data.scene import Picture, Scene
from engine.surface.depth.part_offsets import DepthParts
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.grouped_light import GroupedLight
from engine.surface.lighting.light_calibration import LightParameters
from engine.surface.lighting.room_light import RoomLight
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem, initial_estimate
from engine.surface.optimize.pixel_sample import PixelSample
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.object_pixels import (
    ObjectPixels,
    depth_from_normals,
    image,
    light_transport,
    photographed_radiance,
)
from engine.surface.rendering.transport import IncidentLight, LightTransport, SurfaceGeometry
from engine.surface.uncertainty.standard_errors import LightVariance

Thing = TypeVar("Thing")


def known(thing: Thing | None) -> Thing:
    """What some pass before has found."""
    assert thing is not None
    return thing


@dataclass(frozen=True, slots=True)
class Iteration:
    """One iteration of a phase: which passes ran, and what they did; None where it is not known then."""

    phase: str
    passes: tuple[str, ...]
    pixels: int
    residual: float | None  # median spread of the weighted residuals afterwards, where the pixels were solved
    turned_deg: float | None  # mean turn of the normals
    validation_error: float | None  # median relative, of the validation views, once the light is settled
    kept: bool = True  # or undone, for the validation views were rendered worse


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The surface of the object's pixels at one size, and the light it is solved under."""

    level: int  # of `Scene.at`
    views: Int[np.ndarray, " n"]  # that `object_pixels` is seen in
    object_pixels: ObjectPixels
    room_light: RoomLight
    distance: Distance
    geometry: SurfaceGeometry
    state: PixelEstimate | None = None  # None: nothing is known yet
    depth: Float[np.ndarray, "h w"] | None = None
    part_offset: Float[np.ndarray, "h w 2"] | None = None  # `DepthParts.told`; None: parts are drawn together
    parts: DepthParts | None = None  # of the depth at this size, once they are placed
    # The light by groups of emitters, as long as it is calibrated.
    grouped_light: GroupedLight | None = None
    light_parameters: LightParameters | None = None
    first_light_parameters: LightParameters | None = None  # that of the distance search
    probe_distance: float = 0.0  # distance that the probes were put around; 0: around no depth yet
    searched_shares: tuple[float, ...] = ()  # of the light by groups, under which normals were sought
    calibration_pixels: tuple[PixelSample, PixelEstimate] | None = None  # pixels that calibrated the light
    light_variance: LightVariance | None = None  # what they leave open of it
    # The light as it is settled, in the views that are fitted and those that are not.
    picture: Picture | None = None  # that all views' pixels are of
    light: IncidentLight | None = None
    validation: IncidentLight | None = None
    exposure_offset: Float[np.ndarray, " n"] | None = None
    halved_state: PixelEstimate | None = None  # as the last smaller size left it, for the pixels of `state`
    coarse_state: PixelEstimate | None = None  # as the coarse phases left it, for the same
    regularized: bool = False
    history: tuple["Iteration", ...] = ()

    @property
    def residuals(self) -> tuple[float, ...]:
        """Median spread of the weighted residuals after each iteration that solved the pixels."""
        return tuple(one.residual for one in self.history if one.residual is not None)

    @property
    def compensated_pixels(self) -> ObjectPixels:
        """The object's pixels without what their views' exposures are off by."""
        if self.light_parameters is None or not self.room_light.exposure_sigma or self.light is not None:
            return self.object_pixels
        return self.object_pixels.with_exposure_compensated(self.light_parameters.exposure_offset)

    @property
    def incident(self) -> IncidentLight:
        """The light as it stands."""
        if self.light is not None:
            return self.light
        placed = known(self.light_parameters)
        return known(self.grouped_light).with_gains(placed.gain, placed.lamp_offset)

    def problem(self, scene: Scene) -> PixelProblem:
        """The pixels under the light as it stands."""
        return self.compensated_pixels.problem(self.incident, self.geometry, scene.params, scene.device)

    def validation_transport(self, scene: Scene) -> LightTransport:
        """How the pixels answer the light of the validation views; known once the light is settled."""
        picture = known(self.picture)
        seen = photographed_radiance(picture.frames, picture.mask, scene.validation.tolist())
        return light_transport(seen, known(self.validation), self.geometry, scene.params, "cpu")

    def depth_parts(self, progress: Progress) -> DepthParts:
        """The depth that the normals tell, in parts that stand where they did."""
        pixels, normals = self.object_pixels, known(self.state).normals
        return DepthParts.of(
            pixels.camera, pixels.mask, normals, self.distance.value, self.part_offset, progress
        )

    def with_parts(self, parts: DepthParts) -> "Estimate":
        """The same with that depth."""
        return replace(self, depth=parts.placed, parts=parts, part_offset=parts.told)

    def with_material(self, material: Float[np.ndarray, "p 2"] | None) -> "Estimate":
        """The same of another material."""
        pixels, geometry = (replace(one, material=material) for one in (self.object_pixels, self.geometry))
        return replace(self, object_pixels=pixels, geometry=geometry)

    def with_light_parameters(self, light_parameters: LightParameters) -> "Estimate":
        """The same under another calibration of the light; the object moves to where it has it."""
        by = light_parameters.distance / self.distance.value
        distance = replace(self.distance, value=light_parameters.distance)
        return replace(
            self, light_parameters=light_parameters, distance=distance, geometry=self.geometry.at(by),
            depth=known(self.depth) * by,
        )  # fmt: skip

    def upsampled(self, scene: Scene, progress: Progress) -> "Estimate":
        """The same for the pixels of a picture twice as large."""
        object_pixels = scene.coarse[self.level - 1].pixels(np.arange(len(scene.coarse_views)), scene.params)
        take = parent_index(self.object_pixels.mask, object_pixels.mask)
        object_pixels = replace(object_pixels, material=of_pixels(self.object_pixels.material, take))
        state = known(self.state).part(take)
        state = initial_estimate(state.normals, state.albedo, state.roughness)
        depth = depth_from_normals(object_pixels, state, self.distance.value, progress)
        offset = None
        if self.part_offset is not None:
            offset = image(object_pixels.mask, self.part_offset[self.object_pixels.mask][take])
        hidden = self.geometry.visibility and self.geometry.visibility.upsampled(take)
        geometry = replace(object_pixels.geometry_at(depth[object_pixels.mask]), visibility=hidden)
        return replace(
            self, level=self.level - 1, object_pixels=object_pixels, state=state, depth=depth, geometry=geometry,
            halved_state=state, part_offset=offset, parts=None,
        )  # fmt: skip
