"""A first surface from maps that were made elsewhere, by a network say, in place of the global search.

The files' normals, and roughness where there is any, stand for every pixel's first answer; albedo, whose scale such
maps do not know, is what explains the photographs best under them, and so is roughness where there is none. Gauss-Newton
goes on from there as from the search. Camera frame, as the sensor lies; files are of the upright picture.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.errors import ImportFault, SurfaceError
from engine.io import normal_maps
from engine.orientation import back, turn_picture, turn_vectors
from engine.parallel import each
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.exhaustive_search import ROUGHNESSES
from engine.surface.params import SurfaceParams


@dataclass(frozen=True, slots=True, eq=False)
class InitialMaps:
    """What the files hold of the mask's pixels."""

    mask: Bool[np.ndarray, "h w"]
    normals: Float[np.ndarray, "p 3"]  # unit
    roughness: Float[np.ndarray, " p"] | None
    albedo: Float[np.ndarray, "p 3"] | None  # linear, of a scale of its own

    def downsampled(self, small: Bool[np.ndarray, "h2 w2"]) -> "InitialMaps":
        """Means over the object's pixels of each 2 x 2, as `Picture.downsampled` has the photographs; `small` is its mask."""
        v, u = np.nonzero(self.mask)
        v, u = v // 2, u // 2
        height, width = small.shape
        kept = (v < height) & (u < width)  # an odd last row or column is cut off
        cell = v[kept] * width + u[kept]
        count = np.maximum(np.bincount(cell, minlength=height * width), 1)

        def mean(values: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
            return (np.bincount(cell, values[kept], height * width) / count)[small.ravel()]

        normals = np.stack([mean(x) for x in self.normals.T], 1)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        roughness = None if self.roughness is None else mean(self.roughness)
        albedo = None if self.albedo is None else np.stack([mean(x) for x in self.albedo.T], 1)
        return InitialMaps(small, normals / np.maximum(length, 1e-9), roughness, albedo)


def read(
    path: Path,
    roughness: Path | None,
    frame: str,
    mask: Bool[np.ndarray, "h w"],
    coloured: bool,
    flip: int = 0,
) -> InitialMaps:
    """The maps at the photographs' size as they are processed, see `engine/io/normal_maps.py`.

    Roughness is `roughness`'s, or what an .npz holds beside its normals; so is albedo where `coloured` asks for it.
    The photographs' `flip` stands them upright (`engine/orientation.py`), as the maps are.

    Raises:
        SurfaceError: a file cannot be read or does not fit, or a pixel of the object has no normal.
    """
    upright = turn_picture(mask, flip)

    def inside(values: np.ndarray) -> np.ndarray:
        return turn_picture(values, back(flip))[mask]

    try:
        normal = turn_vectors(inside(normal_maps.read_normals(path, upright, frame)), back(flip))
        beside = roughness or (path if normal_maps.holds(path, "roughness") else None)
        rough = inside(normal_maps.read_roughness(beside, upright)) if beside else None
        coloured = coloured and normal_maps.holds(path, "albedo")
        albedo = inside(normal_maps.read_albedo(path, upright, "linear")) if coloured else None
    except ImportFault as fault:
        raise SurfaceError(f"start maps: {fault}") from fault
    missing = int((~normal.any(1)).sum())
    if missing:
        raise SurfaceError(
            f"start maps: {path}: {missing} of {len(normal)} object pixels have no normal; make the map with the"
            " session's mask, or do without it"
        )
    return InitialMaps(mask, normal, rough, albedo)


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
