"""What the baselines share: the object in all views, fits without a highlight, the result as a `Surface`.

Roughness is not observable without a highlight: it stays at MATT_ROUGHNESS, and its score says no more than that
constant does. Camera frame.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from engine.errors import SurfaceError
from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.exhaustive_search import exhaustive_search
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels, coarse_regions, observe_object
from engine.surface.rendering.transport import Block, Light, SurfaceGeometry, TransportModel, pixel_blocks
from engine.surface.solve import held_out, surface_of
from engine.surface.tiled_solve import maps_of
from engine.surface.uncertainty.standard_errors import formal, standard_errors
from engine.types import Frames, Masks, Poses, Surface

MATT_ROUGHNESS = 0.5


def seen_object(
    frames: Frames, masks: Masks, poses: Poses, params: SurfaceParams
) -> tuple[ObjectPixels, Int[np.ndarray, " n"]]:
    """The object in all registered views, and which those are.

    Raises:
        SurfaceError: too few views, or an empty mask.
    """
    if not masks.object.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    views = held_out(poses.registered, 0)[0]
    return observe_object(frames, masks.object, poses.camera, views, params), views


class Matt:
    """Another model's rows with the highlight left out."""

    def __init__(self, rows: TransportModel):
        self.rows = rows

    @property
    def incident(self) -> Light:
        """The model's light."""
        return self.rows.incident

    def block(self, geometry: SurfaceGeometry, pixels: Int[np.ndarray, " p"]) -> Block:
        """The model's block."""
        return self.rows.block(geometry, pixels)

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, zeros)."""
        diffuse, _ = self.rows(block, normals, roughness)
        return diffuse, np.zeros_like(diffuse)


def matt_start(
    object_pixels: ObjectPixels,
    rows: TransportModel,
    geometry: SurfaceGeometry,
    candidates: int,
    progress: Progress,
) -> gauss_newton.PixelEstimate:
    """Our global search, for rows without a highlight."""
    normals, albedo, _ = exhaustive_search(
        rows, geometry, object_pixels.observations, coarse_regions(object_pixels.mask), candidates, progress
    )
    return gauss_newton.initial_estimate(normals, albedo, np.full(len(normals), MATT_ROUGHNESS))


def refined(
    object_pixels: ObjectPixels,
    state: gauss_newton.PixelEstimate,
    rows: TransportModel,
    geometry: SurfaceGeometry,
    passes: int,
    progress: Progress,
) -> gauss_newton.PixelEstimate:
    """Robust Gauss-Newton; the widths of the residuals are measured, and measured again at its answer."""
    parts = pixel_blocks(object_pixels.mask)
    for turn in range(2):
        span = progress.part(turn / 2, (turn + 1) / 2)
        state = gauss_newton.minimize(
            state, rows, geometry, parts, object_pixels.observations, passes, span, reset_scale=True
        )
    # Without a highlight nothing tells the roughness but how a processor rounds.
    return replace(state, roughness=np.full_like(state.roughness, MATT_ROUGHNESS))


def answered(
    object_pixels: ObjectPixels,
    state: gauss_newton.PixelEstimate,
    geometry: SurfaceGeometry,
    depth: Float[np.ndarray, "h w"],
    model_error: float,
) -> Surface:
    """The state as maps, with standard errors from its own system."""
    unknown = np.zeros(len(state.normals))
    certainty = standard_errors(
        state, formal(state.hessian, state.residual_scale), object_pixels.observations, geometry, unknown
    )
    maps = maps_of(state, certainty, np.zeros((len(state.normals), 0, 3)))
    return surface_of(object_pixels.mask, maps, depth[object_pixels.mask], model_error)
