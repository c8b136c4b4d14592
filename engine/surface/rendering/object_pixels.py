"""Every pixel of the object under a given light: search, Gauss-Newton, depth, visibility.

Camera frame. Knows nothing of Gaussians or files: the light arrives as energy at a lattice of probes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.data.observations import CAUCHY, PLAIN, Observations, observe, photographed
from engine.surface.depth.normal_integration import integrate_normals
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.exhaustive_search import global_start
from engine.surface.params import SurfaceParams
from engine.surface.rendering.interreflection import lit
from engine.surface.rendering.transport import Incident, Responses, Sight, predict
from engine.surface.visibility.ray_visibility import occlusion
from engine.types import Camera, Frames


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """The object's pixels as photographed in some views; `p` counts them in row order."""

    camera: Camera
    mask: Bool[np.ndarray, "h w"]
    seen: Observations
    material: Float[np.ndarray, "p 2"] | None = None  # as `brdf` has it; None: all of paint

    def exposed(self, drift: Float[np.ndarray, " n"]) -> "Subject":
        """The same had no view's log exposure drifted."""
        return replace(self, seen=self.seen.exposed(drift))

    @property
    def rays(self) -> Float[np.ndarray, "p 3"]:
        """Unit viewing directions."""
        return rays(self.camera)[self.mask]

    @property
    def pitch(self) -> float:
        """Angle between the rays of neighbouring pixels, radians."""
        every = rays(self.camera)
        beside = self.mask[:, 1:] & self.mask[:, :-1]
        return float(np.median(np.linalg.norm((every[:, 1:] - every[:, :-1])[beside], axis=1)))

    def flat(self, distance: float) -> Sight:
        """All points at one z, nothing hidden."""
        return self.at(np.full(int(self.mask.sum()), distance))

    def at(self, z: Float[np.ndarray, " p"]) -> Sight:
        """The points at their z, nothing hidden."""
        directions = self.rays
        return Sight(directions / directions[:, 2:] * z[:, None], -directions, None, material=self.material)

    def standing(self, depth: Float[np.ndarray, "h w"], follow: bool) -> Sight:
        """The points where a depth puts them, or all at its mean; nothing hidden yet."""
        z = depth[self.mask]
        return self.at(z) if follow else replace(self.flat(float(z.mean())), cast_z=z)

    def responses(
        self, light: Incident, params: SurfaceParams, device: str, sight: Sight | None = None
    ) -> Responses:
        """How the pixels answer a light; `sight` knows the walls that throw some of it, if there are any."""
        return answering(self.seen.radiance, light, sight, params, device)


def subject(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
) -> Subject:
    """The object in some views, at the photographs' resolution."""
    cauchy = CAUCHY if params.robust else PLAIN
    return Subject(camera, mask, observe(frames, mask, views, params.model_error, cauchy, params.rim))


def search(
    who: Subject, light: Incident, sight: Sight, params: SurfaceParams, progress: Progress
) -> gauss_newton.State:
    """A first surface from nothing."""
    responses = who.responses(light, params, "cpu")
    regions = coarse_regions(who.mask)
    return gauss_newton.begin(*global_start(responses, sight, who.seen, regions, params.candidates, progress))


def depth_of(
    who: Subject, state: gauss_newton.State, distance: float, progress: Progress
) -> Float[np.ndarray, "h w"]:
    """Depth from the normals; its mean is `distance`."""
    return integrate_normals(who.camera, image(who.mask, state.normals), who.mask, distance, progress)


def sight_of(
    who: Subject,
    state: gauss_newton.State,
    depth: Float[np.ndarray, "h w"],
    directions: Float[np.ndarray, "d 3"],
    params: SurfaceParams,
    progress: Progress,
) -> Sight:
    """Where the depth puts the points, and what of it hides the room from them."""
    hidden = None
    if params.visibility:
        q = rays(who.camera)
        points = q / q[..., 2:] * depth[..., None]
        albedo = state.albedo if params.bounce and params.walls else None
        normals = image(who.mask, state.normals)
        hidden = occlusion(points, normals, who.mask, directions, progress, albedo=albedo)
    return replace(who.standing(depth, params.follow_depth), occlusion=hidden)


def answering(
    photographed: Float[np.ndarray, "p v"],
    light: Incident,
    sight: Sight | None,
    params: SurfaceParams,
    device: str,
) -> Responses:
    """How pixels answer a light in whose views they were `photographed`; `sight` knows the walls that throw some of it."""
    walls = lit(sight, light, photographed) if sight is not None and params.bounce else None
    return Responses(light, photographed, params.full_diffuse, params.bounce, device, walls)


def photographed_in(
    frames: Frames, mask: Bool[np.ndarray, "h w"], views: Sequence[int]
) -> Float[np.ndarray, "p v"]:
    """The mask's pixels in some views, which may be none; view-major."""
    v, u = np.nonzero(mask)
    return photographed(frames, np.array(views, int), (v, u)).reshape(len(v), 3 * len(views))


def painted(
    responses: Responses, sight: Sight, parts: list[Int[np.ndarray, " _"]], state: gauss_newton.State
) -> Float[np.ndarray, "p k 3"]:
    """What the answer sends in every view of the responses' light; float32."""
    sent = np.zeros((len(state.normals), responses.photographed.shape[1] // 3, 3), np.float32)
    if sent.size:
        for pixels, answer in predict(responses, sight, parts, state.normals, state.albedo, state.roughness):
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
