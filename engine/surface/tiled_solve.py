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
from engine.surface.data.observations import numbered
from engine.surface.data.scene import Picture
from engine.surface.depth.normal_integration import integrate_normals
from engine.surface.estimate import Estimate
from engine.surface.optimize.gauss_newton import State, begin, iterate
from engine.surface.optimize.spatial_regularization import SWEEPS, accord
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.interreflection import guessed_share
from engine.surface.rendering.object_pixels import Subject, painted, subject
from engine.surface.rendering.transport import BLOCK, Responses, Sight, blocks
from engine.surface.uncertainty.standard_errors import Confidence, Doubt, confidence, jackknifed

TILE = 8 * BLOCK
"""Pixels along a tile's side: its photographs in 150 views take 60 MB."""
HALO = SWEEPS + 2
"""Pixels around a tile that are solved with it and then left to its neighbours: so far does a neighbour's word carry."""


@dataclass(frozen=True, slots=True, eq=False)
class Maps:
    """What is known of every pixel of a mask (row order), and pictures of the views kept out."""

    normals: Float[np.ndarray, "p 3"]
    albedo: Float[np.ndarray, "p 3"]
    roughness: Float[np.ndarray, " p"]
    spread: Float[np.ndarray, " p"]
    stderr_normal: Float[np.ndarray, " p"]  # radians
    stderr_albedo: Float[np.ndarray, " p"]
    stderr_roughness: Float[np.ndarray, " p"]
    flags: UInt8[np.ndarray, " p"]
    pictures: Float[np.ndarray, "p k 3"]


def maps_of(state: State, certainty: Confidence, pictures: Float[np.ndarray, "p k 3"]) -> Maps:
    """A state of all pixels, what its answers are worth, and what it looks like in some views."""
    return Maps(
        state.normals, state.albedo, state.roughness, state.spread, certainty.normal,
        certainty.albedo, certainty.roughness, certainty.flags, pictures,
    )  # fmt: skip


def judged(
    who: Subject,
    state: State,
    sight: Sight,
    here: Responses,
    there: Responses,
    doubt: Doubt | None,
    unsure: Float[np.ndarray, "p 6"] | None,
    progress: Progress,
) -> Maps:
    """Errors, flags and pictures of pixels that have their answer; `unsure` are variances besides what the photographs and the
    `doubt` tell."""
    parts = blocks(who.mask)
    state, variance = jackknifed(state, here, sight, parts, who.seen, progress)
    if doubt is not None:
        variance = variance + doubt.of(state.normals)
    if unsure is not None:
        variance = variance + unsure
    certainty = confidence(state, variance, who.seen, sight, guessed_share(state, here, sight, parts))
    return maps_of(state, certainty, painted(there, sight, parts, state))


def in_detail(
    picture: Picture,
    fitted: Int[np.ndarray, " n"],
    take: Int[np.ndarray, " p"],
    found: Estimate,
    moving: Float[np.ndarray, "p 6"] | None,
    here: Responses,
    there: Responses,
    params: SurfaceParams,
    progress: Progress,
) -> tuple[Maps, Float[np.ndarray, "h w"]]:
    """Every pixel of a picture, from what a smaller one of it has `found`; and the depth.

    `take` names the smaller one's pixel for each; `here` and `there` answer the light of the views that are fitted and
    kept out, their photographed light that of the smaller picture's pixels.
    """
    assert found.exposure_offset is not None
    mask, index = picture.mask, numbered(picture.mask)
    ranges = enlarged(found.who.mask, found.known_depth, mask)
    maps: Maps | None = None
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
        who = subject(part.frames, part.mask, part.camera, fitted, params).exposed(found.exposure_offset)
        who = replace(who, material=of_pixels(found.who.material, take[pixels]))
        state = found.known_state.part(take[pixels])
        gloss = state.gloss
        state = begin(state.normals, state.albedo, state.roughness)
        state = replace(state, gloss=gloss)
        hidden = found.sight.occlusion.part(take[pixels]) if found.sight.occlusion is not None else None
        sight = replace(who.standing(ranges[wide], params.follow_depth), occlusion=hidden)
        parts = blocks(part.mask)
        state = iterate(state, here, sight, parts, who.seen, params.passes, span.part(0, 0.75), anew=True)
        unsure = None if moving is None else moving[take[pixels]]
        if found.regularized:
            state = accord(state, part.mask)
        told = judged(who, state, sight, here, there, found.light_variance, unsure, span.part(0.8, 1))
        inside = np.zeros(mask.shape, bool)
        inside[core] = mask[core]
        own = inside[wide][part.mask]
        if maps is None:
            maps = Maps(*(
                np.zeros((len(take), *getattr(told, name).shape[1:]), _stored(getattr(told, name).dtype))
                for name in Maps.__slots__
            ))  # fmt: skip
        for name in Maps.__slots__:
            getattr(maps, name)[pixels[own]] = getattr(told, name)[own]
    assert maps is not None  # a mask has pixels
    normals = np.zeros((*mask.shape, 3), np.float32)
    normals[mask] = maps.normals
    distance = float(found.known_depth[found.who.mask].mean())
    return maps, integrate_normals(picture.camera, normals, mask, distance, integrating)


def _stored(kind: np.dtype) -> np.dtype:
    """Single precision for what is kept of millions of pixels."""
    return np.dtype(np.float32) if kind.kind == "f" else kind


def enlarged(
    small: Bool[np.ndarray, "h2 w2"], values: Float[np.ndarray, "h2 w2"], mask: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Values of a halved picture's pixels on the whole one's grid, linear between them, of the nearest beyond their rim."""
    nearest = distance_transform_edt(~small, return_distances=False, return_indices=True)
    whole = values[tuple(nearest)]  # pyright: ignore[reportArgumentType]
    by = 2 ** round(np.log2(mask.shape[0] / small.shape[0]))
    v, u = ((np.arange(side) + 0.5) / by - 0.5 for side in mask.shape)
    at = np.meshgrid(v, u, indexing="ij")
    return map_coordinates(whole, np.array(at), order=1, mode="nearest")
