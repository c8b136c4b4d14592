"""Every pixel of the object under a given light: search, Gauss-Newton, depth, visibility, and again.

Camera frame. Knows nothing of Gaussians or files: the light arrives as energy at a lattice of probes.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from engine.geometry import rays
from engine.progress import Progress
from engine.surface import newton
from engine.surface.confidence import Confidence, confidence
from engine.surface.integrate import integrate
from engine.surface.observations import observe
from engine.surface.start import global_start
from engine.surface.transport import Incident, Responses, Sight, blocks, predict
from engine.surface.visibility import occlusion
from engine.types import Camera, Frames, Renders, Surface


@dataclass(frozen=True, slots=True)
class SurfaceParams:
    """What the person may ask of the surface solve."""

    directions: int = 2048  # cells on the sphere of incident directions
    probes_across: int = 3  # probe points along each image axis of the object's box
    probes_deep: int = 2  # probe points along the viewing axis
    probe_face_px: int = 48  # resolution of one face of each probe's cube
    candidates: int = 300  # normals tried by the global search
    rounds: int = 3  # solve, integrate, see: how often
    passes: int = 4  # Gauss-Newton evaluations in each round
    full_diffuse: bool = True  # Disney's diffuse lobe; False is the paper's Lambert (10)
    visibility: bool = True  # let the object shadow itself
    bounce: bool = True  # let the object light itself with what was photographed
    relight: bool = True  # refine the brightness of groups of emitters by the object's own shading
    relight_groups: int = 12  # groups besides the lamps
    relight_prior: float = 0.15  # how far a group's log brightness may be off before it has to be argued
    model_error: float = 0.02  # relative misfit expected of a good model
    held_out: int = 4  # views kept out of the fit and re-rendered
    object_distance: float = 0.0  # camera to object along z, scene units; 0 = find it


def solve_pixels(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
    light: Incident,
    views: Int[np.ndarray, " n"],
    distance: float,
    params: SurfaceParams,
    device: str,
    progress: Progress,
) -> tuple[Surface, Sight, Confidence, newton.State]:
    """The solve itself, under a given light."""
    seen = observe(frames, mask, views, params.model_error)
    directions = rays(camera)
    q = directions / directions[..., 2:]
    parts = blocks(mask)
    responses = Responses(light, seen.radiance, params.full_diffuse, params.bounce, device)
    depth = np.where(mask, distance, 0.0)
    sight = Sight((q * depth[..., None])[mask], -directions[mask], None)
    start = global_start(
        responses, sight, seen, coarse_regions(mask), params.candidates, progress.part(0, 0.15)
    )
    state = newton.begin(*start)
    for turn in range(params.rounds):
        span = progress.part(0.15 + 0.85 * turn / params.rounds, 0.15 + 0.85 * (turn + 1) / params.rounds)
        state = newton.respread(state, responses, sight, parts, seen)
        state = newton.iterate(state, responses, sight, parts, seen, params.passes, span.part(0, 0.7))
        normals = image(mask, state.normals)
        depth = integrate(camera, normals, mask, distance, span.part(0.7, 0.8))
        if turn + 1 < params.rounds:
            points = q * depth[..., None]
            hidden = None
            if params.visibility:
                hidden = occlusion(points, normals, mask, light.directions, span.part(0.8, 1.0))
            sight = Sight(points[mask], sight.views, hidden)
    certainty = confidence(state, seen, sight)
    surface = Surface(
        mask,
        image(mask, state.normals),
        image(mask, state.albedo),
        image(mask, state.roughness),
        depth.astype(np.float32),
        image(mask, certainty.normal),
        image(mask, certainty.albedo),
        image(mask, certainty.roughness),
        image(mask, state.spread * params.model_error),
        image(mask, certainty.flags).astype(np.uint8),
    )
    return surface, sight, certainty, state


def rerender(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    light: Incident,
    views: tuple[int, ...],
    surface: Surface,
    sight: Sight,
    params: SurfaceParams,
    device: str,
) -> Renders:
    """Pictures of the answer in views the fit has not used."""
    radiance = np.zeros((len(views), *mask.shape, 3), np.float32)
    if views:
        photographed = frames.radiance[list(views)][:, mask].transpose(1, 0, 2).reshape(int(mask.sum()), -1)
        responses = Responses(
            light, np.ascontiguousarray(photographed), params.full_diffuse, params.bounce, device
        )
        flat = np.zeros((int(mask.sum()), len(views), 3), np.float32)
        normals, albedo, roughness = surface.normal[mask], surface.albedo[mask], surface.roughness[mask]
        for pixels, answer in predict(responses, sight, blocks(mask), normals, albedo, roughness):
            flat[pixels] = answer
        radiance[:, mask] = flat.transpose(1, 0, 2)
    return Renders(views, radiance)


def coarse_regions(mask: Bool[np.ndarray, "h w"], across: int = 4) -> list[Int[np.ndarray, " _"]]:
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
