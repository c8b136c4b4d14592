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

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.data.observations import pixel_index
from engine.surface.data.scene import Picture, Scene
from engine.surface.depth.part_offsets import DepthParts
from engine.surface.estimate import Estimate, known
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem, initial_estimate, minimize
from engine.surface.optimize.spatial_regularization import RegularizationConfig, regularize_spatially
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.interreflection import hidden_light_fraction
from engine.surface.rendering.object_pixels import render_pixels
from engine.surface.rendering.transport import BLOCK, LightTransport, TransportModel, pixel_blocks
from engine.surface.uncertainty.standard_errors import (
    StandardErrors,
    grid_refinement_error,
    jackknife,
    standard_errors,
)

TILE = 8 * BLOCK
"""Pixels along a tile's side: its photographs in 150 views take 60 MB."""
HALO = RegularizationConfig().sweeps + 2
"""Pixels around a tile that are solved with it and then left to its neighbours: so far does a neighbour's word carry."""
MOVING_DEG = 1.0
"""Mean turn of the normals in the fine phases from which on an answer counts as one that still moves."""


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


def evaluate_solution(scene: Scene, found: Estimate, progress: Progress) -> SolvedMaps:
    """Of pixels that were all solved at once."""
    there, problem = found.validation_transport(scene), found.problem(scene)
    return _evaluate(found, problem, known(found.state), there, still_moving(found), progress)


def _evaluate(
    found: Estimate,
    problem: PixelProblem,
    state: PixelEstimate,
    there: LightTransport,
    unsure: Float[np.ndarray, "p 6"] | None,
    progress: Progress,
) -> SolvedMaps:
    """Errors, flags and pictures of pixels that have their answer; `unsure` are variances besides what the photographs and the
    light's variance tell."""
    state, variance = jackknife(state, problem, progress)
    if found.light_variance is not None:
        variance = variance + found.light_variance.of(state.normals)
    if unsure is not None:
        variance = variance + unsure
    guessed, geometry = hidden_light_fraction(state, problem), problem.geometry
    certainty = standard_errors(state, variance, problem.observations, geometry, guessed)
    return maps_of(state, certainty, render_pixels(there, geometry, problem.blocks, state))


def still_moving(found: Estimate) -> Float[np.ndarray, "p 6"] | None:
    """Variances of the unknowns of a surface that the fine phase still turned; None where it stands still."""
    turned = angle_between(known(found.coarse_state).normals, known(found.state).normals).mean()
    if np.degrees(turned) <= MOVING_DEG:
        return None
    return grid_refinement_error(known(found.halved_state), known(found.state))


def solve_tiles(
    scene: Scene, picture: Picture, take: Int[np.ndarray, " p"], found: Estimate, progress: Progress
) -> tuple[SolvedMaps, DepthParts]:
    """Every pixel of a picture, from what a smaller one of it has `found`; and the depth.

    `take` names the smaller one's pixel for each. What throws light at a tile are the smaller picture's pixels, as photographed.
    """
    mask, index = picture.mask, pixel_index(picture.mask)
    ranges, moving = upsample(found.object_pixels.mask, known(found.depth), mask), still_moving(found)
    here, there = found.problem(scene).transport, found.validation_transport(scene)
    maps: SolvedMaps | None = None
    tiles = [
        (slice(v, v + TILE), slice(u, u + TILE))
        for v in range(0, mask.shape[0], TILE)
        for u in range(0, mask.shape[1], TILE)
        if mask[v : v + TILE, u : u + TILE].any()
    ]
    solving, integrating = progress.part(0, 0.9), progress.part(0.9, 1)
    for core, span in zip(tiles, solving.parts(len(tiles)), strict=True):
        wide = tuple(slice(max(side.start - HALO, 0), side.stop + HALO) for side in core)
        part = picture.part(*wide)
        pixels = index[wide][part.mask]
        problem = _of_tile(scene, part, found, take[pixels], here, ranges[wide])
        state = _solve_tile(scene, part.mask, problem, found, take[pixels], span.part(0, 0.75))
        unsure = None if moving is None else moving[take[pixels]]
        told = _evaluate(found, problem, state, there, unsure, span.part(0.8, 1))
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
    distance = float(known(found.depth)[found.object_pixels.mask].mean())
    small, offset = found.object_pixels.mask, found.part_offset
    if offset is not None:
        offset = np.stack([upsample(small, one, mask) for one in np.moveaxis(offset, -1, 0)], -1)
    return maps, DepthParts.of(picture.camera, mask, maps.normals, distance, offset, integrating)


def _of_tile(
    scene: Scene,
    part: Picture,
    found: Estimate,
    take: Int[np.ndarray, " q"],
    here: TransportModel,
    z: Float[np.ndarray, "h w"],
) -> PixelProblem:
    """A tile's pixels under the light, at their depths; hidden from them is what is from the pixels that they `take`."""
    pixels = part.pixels(scene.fitted, scene.params).with_exposure_compensated(known(found.exposure_offset))
    pixels = replace(pixels, material=of_pixels(found.object_pixels.material, take))
    hidden = found.geometry.visibility and found.geometry.visibility.part(take)
    geometry = replace(pixels.geometry_at(z[part.mask]), visibility=hidden)
    return PixelProblem(here, geometry, pixel_blocks(part.mask), pixels.observations)


def _solve_tile(
    scene: Scene,
    mask: Bool[np.ndarray, "h w"],
    problem: PixelProblem,
    found: Estimate,
    take: Int[np.ndarray, " q"],
    progress: Progress,
) -> PixelEstimate:
    begun = known(found.state).part(take)
    state = initial_estimate(begun.normals, begun.albedo, begun.roughness)
    state = replace(state, roughness_prior=begun.roughness_prior)
    state = minimize(state, problem, scene.params.gauss_newton_steps, progress, reset_scale=True)
    return regularize_spatially(state, mask) if found.regularized else state


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
