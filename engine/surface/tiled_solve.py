"""Objects of more pixels than are solved together: a smaller picture first, then every pixel, tile by tile.

How bright the light's parts are, how far away the object stands and what hides the room from a point is told by a
picture of some hundred thousand pixels as well as by one of millions. Under that light pixels are independent: tiles
of them begin at what the smaller picture found, and memory is that of one tile and of the maps. What a pixel sees of
the object is what its nearest pixel of the smaller picture sees. Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import distance_transform_edt, map_coordinates

from engine.progress import Progress
from engine.surface.data.observations import pixel_index
from engine.surface.data.scene import Picture
from engine.surface.depth.normal_integration import integrate_normals
from engine.surface.estimate import Estimate
from engine.surface.optimize.gauss_newton import PixelEstimate, initial_estimate, minimize
from engine.surface.optimize.spatial_regularization import RegularizationConfig, regularize_spatially
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.interreflection import hidden_light_fraction
from engine.surface.rendering.object_pixels import ObjectPixels, observe_object, render_pixels
from engine.surface.rendering.transport import BLOCK, LightTransport, SurfaceGeometry, pixel_blocks
from engine.surface.uncertainty.standard_errors import (
    LightVariance,
    StandardErrors,
    jackknife,
    standard_errors,
)

TILE = 8 * BLOCK
"""Pixels along a tile's side: its photographs in 150 views take 60 MB."""
HALO = RegularizationConfig().sweeps + 2
"""Pixels around a tile that are solved with it and then left to its neighbours: so far does a neighbour's word carry."""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedMaps:
    """What is known of every pixel of a mask (row order), and pictures of the views kept out."""

    normals: Float[np.ndarray, "p 3"]
    albedo: Float[np.ndarray, "p 3"]
    roughness: Float[np.ndarray, " p"]
    residual_scale: Float[np.ndarray, " p"]
    stderr_normal: Float[np.ndarray, " p"]  # radians
    stderr_albedo: Float[np.ndarray, " p"]
    stderr_roughness: Float[np.ndarray, " p"]
    flags: UInt8[np.ndarray, " p"]
    pictures: Float[np.ndarray, "p k 3"]


def maps_of(
    state: PixelEstimate, certainty: StandardErrors, pictures: Float[np.ndarray, "p k 3"]
) -> SolvedMaps:
    """A state of all pixels, what its answers are worth, and what it looks like in some views."""
    return SolvedMaps(
        state.normals, state.albedo, state.roughness, state.residual_scale, certainty.normal,
        certainty.albedo, certainty.roughness, certainty.flags, pictures,
    )  # fmt: skip


def evaluate_result(
    object_pixels: ObjectPixels,
    state: PixelEstimate,
    geometry: SurfaceGeometry,
    here: LightTransport,
    there: LightTransport,
    doubt: LightVariance | None,
    unsure: Float[np.ndarray, "p 6"] | None,
    progress: Progress,
) -> SolvedMaps:
    """Errors, flags and pictures of pixels that have their answer; `unsure` are variances besides what the photographs and the
    `light_variance` tell."""
    parts = pixel_blocks(object_pixels.mask)
    state, variance = jackknife(state, here, geometry, parts, object_pixels.observations, progress)
    if doubt is not None:
        variance = variance + doubt.of(state.normals)
    if unsure is not None:
        variance = variance + unsure
    certainty = standard_errors(
        state,
        variance,
        object_pixels.observations,
        geometry,
        hidden_light_fraction(state, here, geometry, parts),
    )
    return maps_of(state, certainty, render_pixels(there, geometry, parts, state))


def solve_tiles(
    picture: Picture,
    fitted: Int[np.ndarray, " n"],
    take: Int[np.ndarray, " p"],
    found: Estimate,
    moving: Float[np.ndarray, "p 6"] | None,
    here: LightTransport,
    there: LightTransport,
    params: SurfaceParams,
    progress: Progress,
) -> tuple[SolvedMaps, Float[np.ndarray, "h w"]]:
    """Every pixel of a picture, from what a smaller one of it has `found`; and the depth.

    `take` names the smaller one's pixel for each; `here` and `there` answer the light of the views that are fitted and
    kept out, their photographed light that of the smaller picture's pixels.
    """
    assert found.exposure_offset is not None
    mask, index = picture.mask, pixel_index(picture.mask)
    ranges = upsample(found.object_pixels.mask, found.known_depth, mask)
    maps: SolvedMaps | None = None
    tiles = [
        (slice(v, v + TILE), slice(u, u + TILE))
        for v in range(0, mask.shape[0], TILE)
        for u in range(0, mask.shape[1], TILE)
        if mask[v : v + TILE, u : u + TILE].any()
    ]
    solving, integrating = progress.part(0, 0.9), progress.part(0.9, 1)
    for i, core in enumerate(tiles):
        span = solving.part(i / len(tiles), (i + 1) / len(tiles))
        wide = tuple(slice(max(side.start - HALO, 0), side.stop + HALO) for side in core)
        part = picture.part(*wide)
        pixels = index[wide][part.mask]
        object_pixels = observe_object(
            part.frames, part.mask, part.camera, fitted, params
        ).with_exposure_compensated(found.exposure_offset)
        object_pixels = replace(object_pixels, material=of_pixels(found.object_pixels.material, take[pixels]))
        state = found.known_state.part(take[pixels])
        gloss = state.roughness_prior
        state = initial_estimate(state.normals, state.albedo, state.roughness)
        state = replace(state, roughness_prior=gloss)
        hidden = (
            found.geometry.visibility.part(take[pixels]) if found.geometry.visibility is not None else None
        )
        geometry = replace(object_pixels.geometry_of_depth(ranges[wide]), visibility=hidden)
        parts = pixel_blocks(part.mask)
        state = minimize(
            state,
            here,
            geometry,
            parts,
            object_pixels.observations,
            params.gauss_newton_steps,
            span.part(0, 0.75),
            reset_scale=True,
        )
        unsure = None if moving is None else moving[take[pixels]]
        if found.regularized:
            state = regularize_spatially(state, part.mask)
        told = evaluate_result(
            object_pixels, state, geometry, here, there, found.light_variance, unsure, span.part(0.8, 1)
        )
        inside = np.zeros(mask.shape, bool)
        inside[core] = mask[core]
        own = inside[wide][part.mask]
        if maps is None:
            maps = SolvedMaps(*(
                np.zeros((len(take), *getattr(told, name).shape[1:]), _stored(getattr(told, name).dtype))
                for name in SolvedMaps.__slots__
            ))  # fmt: skip
        for name in SolvedMaps.__slots__:
            getattr(maps, name)[pixels[own]] = getattr(told, name)[own]
    assert maps is not None  # a mask has pixels
    normals = np.zeros((*mask.shape, 3), np.float32)
    normals[mask] = maps.normals
    distance = float(found.known_depth[found.object_pixels.mask].mean())
    return maps, integrate_normals(picture.camera, normals, mask, distance, integrating)


def _stored(kind: np.dtype) -> np.dtype:
    """Single precision for what is kept of millions of pixels."""
    return np.dtype(np.float32) if kind.kind == "f" else kind


def upsample(
    small: Bool[np.ndarray, "h2 w2"], values: Float[np.ndarray, "h2 w2"], mask: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Values of a halved picture's pixels on the whole one's grid, linear between them, of the nearest beyond their rim."""
    nearest = distance_transform_edt(~small, return_distances=False, return_indices=True)
    whole = values[tuple(nearest)]  # pyrefly: ignore[bad-argument-type]
    by = 2 ** round(np.log2(mask.shape[0] / small.shape[0]))
    v, u = ((np.arange(side) + 0.5) / by - 0.5 for side in mask.shape)
    at = np.meshgrid(v, u, indexing="ij")
    return map_coordinates(whole, np.array(at), order=1, mode="nearest")
