"""What the baselines share: the object in all views, fits without a highlight, the result as a `Surface`.

Roughness is not observable without a highlight: it stays at MATT_ROUGHNESS, and its score says no more than that
constant does. Camera frame.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from engine.errors import SurfaceError
from engine.progress import Progress
from engine.sampling import held_out
from engine.surface.optimize.exhaustive_search import exhaustive_search
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem, minimize
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels, coarse_regions, observe_object
from engine.surface.rendering.transport import Block, Light, SurfaceGeometry, TransportModel
from engine.surface.solve import surface_of
from engine.surface.tiled_solve import maps_of
from engine.surface.uncertainty.standard_errors import formal, standard_errors
from engine.types import CapturedScene, Surface

MATT_ROUGHNESS = 0.5


def seen_object(captured: CapturedScene, params: SurfaceParams) -> tuple[ObjectPixels, Int[np.ndarray, " n"]]:
    """The object in all registered views, and which those are.

    Raises:
        SurfaceError: too few views, or an empty mask.
    """
    mask, poses = captured.masks.object, captured.poses
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    views = held_out(poses.registered, 0)[0]
    return observe_object(captured.frames, mask, poses.camera, views, params), views


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
    object_pixels: ObjectPixels, problem: PixelProblem, candidates: int, progress: Progress
) -> PixelEstimate:
    """Our global search, for rows without a highlight."""
    problem = replace(problem, blocks=coarse_regions(object_pixels.mask))
    found = exhaustive_search(problem, candidates, progress)
    return replace(found, roughness=np.full_like(found.roughness, MATT_ROUGHNESS))


def refined(state: PixelEstimate, problem: PixelProblem, passes: int, progress: Progress) -> PixelEstimate:
    """Robust Gauss-Newton; the widths of the residuals are measured, and measured again at its answer."""
    for span in progress.parts(2):
        state = minimize(state, problem, passes, span, reset_scale=True)
    # Without a highlight nothing tells the roughness but how a processor rounds.
    return replace(state, roughness=np.full_like(state.roughness, MATT_ROUGHNESS))


def answered(
    object_pixels: ObjectPixels,
    state: PixelEstimate,
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
