"""Every pixel of the object under a given light: search, Gauss-Newton, depth, visibility.

Camera frame. Knows nothing of Gaussians or files: the light arrives as energy at a lattice of probes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.data.observations import CAUCHY, PLAIN, Observations, gather_radiance, observe
from engine.surface.depth.normal_integration import integrate_normals
from engine.surface.optimize.exhaustive_search import exhaustive_search
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem
from engine.surface.params import SurfaceParams
from engine.surface.rendering.interreflection import radiance_of_hidden_patches
from engine.surface.rendering.transport import (
    IncidentLight,
    LightTransport,
    SurfaceGeometry,
    pixel_blocks,
    predict,
)
from engine.surface.visibility.ray_visibility import trace_occlusion
from engine.types import Camera, Frames


@dataclass(frozen=True, slots=True, eq=False)
class ObjectPixels:
    """The object's pixels as photographed in some views; `p` counts them in row order."""

    camera: Camera
    mask: Bool[np.ndarray, "h w"]
    observations: Observations
    material: Float[np.ndarray, "p 2"] | None = None  # as `brdf` has it; None: all of paint

    def with_exposure_compensated(self, drift: Float[np.ndarray, " n"]) -> "ObjectPixels":
        """The same had no view's log exposure drifted."""
        return replace(self, observations=self.observations.with_exposure_compensated(drift))

    @property
    def rays(self) -> Float[np.ndarray, "p 3"]:
        """Unit viewing directions."""
        return rays(self.camera)[self.mask]

    def geometry_at(self, z: float | Float[np.ndarray, " p"]) -> SurfaceGeometry:
        """The points at their z, or all at one; nothing hidden."""
        directions = self.rays
        z = np.broadcast_to(z, len(directions))
        return SurfaceGeometry(
            directions / directions[:, 2:] * z[:, None], -directions, None, material=self.material
        )

    def problem(
        self, light: IncidentLight, geometry: SurfaceGeometry, params: SurfaceParams, device: str
    ) -> PixelProblem:
        """The pixels under a light; the geometry knows the walls that throw some of it, if there are any."""
        transport = light_transport(self.observations.radiance, light, geometry, params, device)
        return PixelProblem(transport, geometry, pixel_blocks(self.mask), self.observations)


def observe_object(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
) -> ObjectPixels:
    """The object in some views, at the photographs' resolution."""
    cauchy = CAUCHY if params.models("robust_loss") else PLAIN
    seen = observe(frames, mask, views, params.model_error, cauchy, params.models("mixed_pixels"))
    return ObjectPixels(camera, mask, seen)


def search_initial_normals(
    object_pixels: ObjectPixels,
    light: IncidentLight,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
    progress: Progress,
) -> PixelEstimate:
    """A first surface from nothing."""
    problem = object_pixels.problem(light, replace(geometry, visibility=None), params, "cpu")
    problem = replace(problem, blocks=coarse_regions(object_pixels.mask))
    return exhaustive_search(problem, params.normal_candidates, progress)


def depth_from_normals(
    object_pixels: ObjectPixels, state: PixelEstimate, distance: float, progress: Progress
) -> Float[np.ndarray, "h w"]:
    """Depth from the normals; its mean is `distance`."""
    mask = object_pixels.mask
    return integrate_normals(object_pixels.camera, image(mask, state.normals), mask, distance, progress)


def geometry_with_visibility(
    object_pixels: ObjectPixels,
    state: PixelEstimate,
    depth: Float[np.ndarray, "h w"],
    directions: Float[np.ndarray, "d 3"],
    params: SurfaceParams,
    progress: Progress,
) -> SurfaceGeometry:
    """Where the depth puts the points, and what of it hides the room from them."""
    hidden, mask = None, object_pixels.mask
    if params.models("self_shadowing"):
        q = rays(object_pixels.camera)
        points = q / q[..., 2:] * depth[..., None]
        albedo = state.albedo if params.models("interreflections", "hidden_surfaces") else None
        hidden = trace_occlusion(points, image(mask, state.normals), mask, directions, progress, albedo)
    return replace(object_pixels.geometry_at(depth[mask]), visibility=hidden)


def light_transport(
    photographed: Float[np.ndarray, "p v"],
    light: IncidentLight,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
    device: str,
) -> LightTransport:
    """How pixels answer a light in whose views they were `photographed`; the geometry knows the walls that throw some of it."""
    bounce = params.models("interreflections")
    transport = LightTransport(light, photographed, params.diffuse == "disney", bounce, device)
    if not bounce:
        return transport
    return replace(transport, walls=radiance_of_hidden_patches(geometry, light, photographed))


def photographed_radiance(
    frames: Frames, mask: Bool[np.ndarray, "h w"], views: Sequence[int]
) -> Float[np.ndarray, "p v"]:
    """The mask's pixels in some views, which may be none; view-major."""
    v, u = np.nonzero(mask)
    return gather_radiance(frames, np.array(views, int), (v, u)).reshape(len(v), 3 * len(views))


def render_pixels(
    transport: LightTransport,
    geometry: SurfaceGeometry,
    blocks: list[Int[np.ndarray, " _"]],
    state: PixelEstimate,
) -> Float[np.ndarray, "p k 3"]:
    """What the answer sends in every view of the responses' light; float32."""
    sent = np.zeros((len(state.normals), transport.photographed.shape[1] // 3, 3), np.float32)
    if sent.size:
        for pixels, answer in predict(
            transport, geometry, blocks, state.normals, state.albedo, state.roughness
        ):
            sent[pixels] = answer
    return sent


def coarse_regions(mask: Bool[np.ndarray, "h w"], across: int = 3) -> list[Int[np.ndarray, " _"]]:
    """Pixels in at most `across`^2 parts of the mask's bounding box: enough for a first look."""
    v, u = np.nonzero(mask)

    def cell(x: Int[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
        return (x - x.min()) * across // (x.max() - x.min() + 1)

    tile = cell(v) * across + cell(u)
    return [np.nonzero(tile == k)[0] for k in np.unique(tile)]


def image(mask: Bool[np.ndarray, "h w"], values: Shaped[np.ndarray, "p ..."]) -> Float[np.ndarray, "h w ..."]:
    """Per-pixel values back on the image grid, zero outside; float32."""
    full = np.zeros((*mask.shape, *values.shape[1:]), np.float32)
    full[mask] = values
    return full
