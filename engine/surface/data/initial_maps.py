"""A first surface from maps that were made elsewhere, by a network say, in place of the global search.

The files' normals, and roughness where there is any, stand for every pixel's first answer; albedo, whose scale such
maps do not know, is what explains the photographs best under them, and so is roughness where there is none. Gauss-Newton
goes on from there as from the search.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.io.initial_maps import InitialMaps, read
from engine.parallel import each
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.exhaustive_search import ROUGHNESSES
from engine.surface.params import SurfaceParams


def requested(params: SurfaceParams, mask: Bool[np.ndarray, "h w"], flip: int = 0) -> InitialMaps | None:
    """The maps that the parameters name; None where they name none.

    Raises:
        SurfaceError: as `read`.
    """
    if not params.initial_normals:
        return None
    roughness = Path(params.initial_roughness) if params.initial_roughness else None
    return read(Path(params.initial_normals), roughness, params.normals_frame, mask, False, flip)


def estimate_from_maps(
    maps: InitialMaps, problem: gauss_newton.PixelProblem, progress: Progress
) -> gauss_newton.PixelEstimate:
    """The maps, which are of the problem's pixels, as a first surface of them."""
    transport, geometry = problem.transport, problem.geometry
    normals = gauss_newton.clamp_to_visible(maps.normals, geometry.views)
    tried = np.tile(ROUGHNESSES, (len(normals), 1)) if maps.roughness is None else maps.roughness[:, None]
    tried = np.clip(tried, *gauss_newton.ROUGHNESS)
    albedo, roughness = np.zeros((len(normals), 3)), np.zeros(len(normals))

    def begin(pixels: Int[np.ndarray, " _"]) -> None:
        leaning = np.repeat(normals[pixels][:, None], tried.shape[1], 1)
        block = transport.block(geometry, pixels)
        diffuse, specular = transport(block.under(block.light.mean), leaning, tried[pixels])
        best, albedo[pixels] = _explained(diffuse, specular, problem.observations.part(pixels))
        roughness[pixels] = tried[pixels, best]

    each(begin, problem.blocks, progress, "beginning from the maps given")
    return gauss_newton.initial_estimate(normals, albedo, roughness)


def _explained(
    diffuse: Float[np.ndarray, "p k v"], specular: Float[np.ndarray, "p k v"], observations: Observations
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Which of `k` variants explains each pixel best, and its albedo: the one in the middle of all views."""
    eps = observations.eps[:, None, None]
    radiance, valid = observations.radiance[:, None], observations.weight[:, None] > 0
    share = np.where(valid, (radiance - specular) / np.maximum(diffuse, 1e-6), np.nan)
    albedo = np.stack([_middle(share[..., c::3]) for c in range(3)], -1)  # p k 3
    model = np.tile(albedo, diffuse.shape[2] // 3) * diffuse + specular
    logs = np.log((radiance + eps) / (np.maximum(model, 0) + eps))
    best = np.where(valid, np.abs(logs), 0).sum(2).argmin(1)
    return best, albedo[np.arange(len(best)), best]


def _middle(values: Float[np.ndarray, "p k n"]) -> Float[np.ndarray, "p k"]:
    """Median of what is known, within what albedo may be; its middle where nothing is."""
    nothing = np.asarray(np.isnan(values).all(2))
    return np.clip(np.nanmedian(np.where(nothing[..., None], 0.5, values), 2), *gauss_newton.ALBEDO)
