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
from engine.surface.optimize.exhaustive_search import global_start
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import Subject, coarse_regions, subject
from engine.surface.rendering.transport import Block, Light, Rows, Sight, blocks
from engine.surface.solve import held_out, surface_of
from engine.surface.tiled_solve import maps_of
from engine.surface.uncertainty.standard_errors import confidence, formal
from engine.types import Frames, Masks, Poses, Surface

MATT_ROUGHNESS = 0.5


def seen_object(
    frames: Frames, masks: Masks, poses: Poses, params: SurfaceParams
) -> tuple[Subject, Int[np.ndarray, " n"]]:
    """The object in all registered views, and which those are.

    Raises:
        SurfaceError: too few views, or an empty mask.
    """
    if not masks.object.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    views = held_out(poses.registered, 0)[0]
    return subject(frames, masks.object, poses.camera, views, params), views


class Matt:
    """Another model's rows with the highlight left out."""

    def __init__(self, rows: Rows):
        self.rows = rows

    @property
    def incident(self) -> Light:
        """The model's light."""
        return self.rows.incident

    def block(self, sight: Sight, pixels: Int[np.ndarray, " p"]) -> Block:
        """The model's block."""
        return self.rows.block(sight, pixels)

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, zeros)."""
        diffuse, _ = self.rows(block, normals, roughness)
        return diffuse, np.zeros_like(diffuse)


def matt_start(
    who: Subject, rows: Rows, sight: Sight, candidates: int, progress: Progress
) -> gauss_newton.State:
    """Our global search, for rows without a highlight."""
    normals, albedo, _ = global_start(rows, sight, who.seen, coarse_regions(who.mask), candidates, progress)
    return gauss_newton.begin(normals, albedo, np.full(len(normals), MATT_ROUGHNESS))


def refined(
    who: Subject, state: gauss_newton.State, rows: Rows, sight: Sight, passes: int, progress: Progress
) -> gauss_newton.State:
    """Robust Gauss-Newton; the widths of the residuals are measured, and measured again at its answer."""
    parts = blocks(who.mask)
    for turn in range(2):
        span = progress.part(turn / 2, (turn + 1) / 2)
        state = gauss_newton.iterate(state, rows, sight, parts, who.seen, passes, span, anew=True)
    # Without a highlight nothing tells the roughness but how a processor rounds.
    return replace(state, roughness=np.full_like(state.roughness, MATT_ROUGHNESS))


def answered(
    who: Subject, state: gauss_newton.State, sight: Sight, depth: Float[np.ndarray, "h w"], model_error: float
) -> Surface:
    """The state as maps, with standard errors from its own system."""
    unknown = np.zeros(len(state.normals))
    certainty = confidence(state, formal(state.system, state.spread), who.seen, sight, unknown)
    maps = maps_of(state, certainty, np.zeros((len(state.normals), 0, 3)))
    return surface_of(who.mask, maps, depth[who.mask], model_error)
