"""About how far the object is, in scene units, from the light's own parallax: a first guess from nothing.

The object never moves in the camera's frame, so it cannot be triangulated; but near lights shift against the
object as the rig moves, by an amount that depends on how far in front of the camera the object is. A small
subset of pixels is solved at a few distances, flat and with nothing hidden; the one with the least misfit
wins. `light_calibration` refines it once the shape is known. In a far room the distance is unobservable and also does
not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from jaxtyping import Int

from engine.progress import Progress
from engine.sampling import evenly_spaced
from engine.surface.lighting.grouped_light import GroupedLight
from engine.surface.lighting.light_calibration import (
    CalibrationConfig,
    LightParameters,
    calibrate,
    prior_light,
    split_groups,
)
from engine.surface.lighting.room_light import RoomLight, gather_grouped_light
from engine.surface.optimize.exhaustive_search import exhaustive_search
from engine.surface.optimize.pixel_sample import PixelSample, interior, random_subset, sample_pixels
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels
from engine.surface.rendering.transport import probe_grid_around


@dataclass(frozen=True, slots=True)
class DistanceSearchConfig:
    """Normals that are sought under too dark a ceiling all look up to it, and no gain leads away from there. A chink in the
    shutters was recorded with a three-hundredth of its light, and from so far away no gain finds the way either.
    """

    candidates: int = 150  # normals, searched
    gauss_newton_steps: int = 3
    calibration_rounds: int = 3
    unseen_levels: tuple[float, ...] = (1.0, 5.0)  # of what no photograph shows, over its surroundings'
    searches: int = 4  # more of normals, under the best gains so far, where there is any of it, as long as
    worthwhile: float = 0.98  # the misfit falls to so many times what it was
    splits: int = 8  # of what no photograph shows, at most, where it is bright;
    searches_per_split: int = 3  # of normals, at most, likewise
    lamp_factors: tuple[float, ...] = (10.0, 100.0, 1000.0)  # tried of clipped lamps: over what is expected,
    lamp_layers: int = 3  # at every so many-th layer
    directions: int = 512  # at most: twice as many find the same surface and take half as long again
    nearest: float = 0.05  # reach of the search, in sizes of the room
    farthest: float = 0.8
    layers: int = 9  # distances tried
    views: int = 12  # that serve, at most; the curve is the same in twice as many
    pixels: int = 300


CONFIG = DistanceSearchConfig()
_misfit = attrgetter("cost")


@dataclass(frozen=True, slots=True)
class Distance:
    """Camera to object along z, scene units, with one standard error; `source` is "given" or "light".

    `tried` and `misfit` are the first look's curve, for the report.
    """

    value: float
    stderr: float
    source: str
    tried: tuple[float, ...] = ()
    misfit: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FoundDistance:
    """The best of the distances tried, with the light that suits it."""

    light_parameters: LightParameters
    grouped_light: GroupedLight  # in as many parts as that took
    distances: tuple[float, ...]  # tried,
    misfits: tuple[float, ...]  # and what each left


def coarse_distance_search(
    object_pixels: ObjectPixels,
    room: RoomLight,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
    seed: int,
    progress: Progress,
) -> FoundDistance:
    """The object's distance to a fifth or so unless it is given, with the light that suits it."""
    every = evenly_spaced(len(views), min(CONFIG.views, len(views) // 2))
    size, layers = room.size(), CONFIG.layers
    near_far = CONFIG.nearest * size, CONFIG.farthest * size
    if params.object_distance > 0:
        near_far, layers = (params.object_distance, params.object_distance), 1
    lattice = probe_grid_around(object_pixels.camera, object_pixels.mask, near_far, (1, 1, layers))
    face_px, span = params.probe_resolution, progress.part(0, 0.5)
    parts = gather_grouped_light(lattice, room, views[every], coarse_directions(params), face_px, span)
    # Flat and shadowless, pixels misfit by more than any drift.
    parts = replace(parts, exposure_sigma=0.0, lamp_offset_sigma=0.0)
    chosen = random_subset(interior(object_pixels), CONFIG.pixels, seed)
    sample = sample_pixels(object_pixels, object_pixels.geometry_at(1.0), 1.0, chosen, params, every)
    return find_distance(parts, sample, params, progress.part(0.5, 1))


def coarse_directions(params: SurfaceParams) -> int:
    """Of the light in the coarse phases."""
    return min(CONFIG.directions, params.directions or CONFIG.directions)


def find_distance(
    grouped_light: GroupedLight, sample: PixelSample, params: SurfaceParams, progress: Progress
) -> FoundDistance:
    """The best of the lattice's layers.

    What no photograph shows, where there is any, is as bright as suits the object best; one brightness serves to begin
    with at every distance, for it hardly depends on that. Where it turns out bright it is divided, and so on, as long as
    that suits it better. Clipped lamps are made brighter as long as that does.
    """
    layers, free = grouped_light.incident.probe_grid.depths(), params.models("light_gains")
    levels = CONFIG.unseen_levels if grouped_light.unseen.any() and free else (1.0,)
    brighter = CONFIG.lamp_factors if grouped_light.clipped.any() and free else ()
    again = CONFIG.searches if len(levels) > 1 else 0
    first, then = progress.part(0, 0.5 if again else 1), progress.part(0.5, 1)
    turns = iter(first.parts(len(levels) + len(brighter) + (CONFIG.searches if brighter else again)))

    def looked(begun: Sequence[LightParameters]) -> list[LightParameters]:
        spans = next(turns).parts(len(begun))
        return [
            _calibrated_from_scratch(one, grouped_light, sample, free, span)
            for one, span in zip(begun, spans, strict=True)
        ]

    best: list[LightParameters] = []
    for level in levels:
        best = _better(best, looked([prior_light(grouped_light, float(z), level) for z in layers]))
    step = CONFIG.lamp_layers
    some_layers = slice(min(step // 2, len(layers) - 1), None, step)
    for factor in brighter:
        some = best[some_layers]
        least = min(some, key=_misfit)
        tried = looked([_brighter_lamps(least, grouped_light, factor, one.distance) for one in some])
        if min(map(_misfit, tried)) > CONFIG.worthwhile * least.cost:
            break
        best[some_layers], again = _better(some, tried), CONFIG.searches
    for _ in range(again):
        least = min(best, key=_misfit)
        best = _better(best, looked([replace(least, distance=float(z)) for z in layers]))
        if _misfit(min(best, key=_misfit)) > CONFIG.worthwhile * least.cost:
            break
    least = min(best, key=_misfit)
    if len(levels) > 1:
        least, grouped_light = _finer(least, grouped_light, sample, then)
    return FoundDistance(least, grouped_light, tuple(map(float, layers)), tuple(map(_misfit, best)))


def _finer(
    least: LightParameters, grouped_light: GroupedLight, sample: PixelSample, progress: Progress
) -> tuple[LightParameters, GroupedLight]:
    """The light with what no photograph shows divided where it is bright, and so on, as long as that suits the object better."""
    spans = iter(progress.parts(CONFIG.splits * CONFIG.searches_per_split))
    for _ in range(CONFIG.splits):
        if (made := split_groups(grouped_light, least)) is None:
            break
        finer, begun = made
        for _ in range(CONFIG.searches_per_split):
            found = _calibrated_from_scratch(begun, finer, sample, True, next(spans))
            if found.cost > CONFIG.worthwhile * least.cost:
                break
            grouped_light, least, begun = finer, found, found
        if grouped_light is not finer:
            break
    return least, grouped_light


def _calibrated_from_scratch(
    begun: LightParameters,
    grouped_light: GroupedLight,
    sample: PixelSample,
    free_light: bool,
    progress: Progress,
) -> LightParameters:
    """The light that suits normals which are sought from nothing under it as it is begun."""
    problem = sample.problem(grouped_light.with_gains(begun.gain), begun.distance)
    start = exhaustive_search(problem, CONFIG.candidates, progress.part(0, 0.4))
    rounds = CONFIG.calibration_rounds if free_light else 0
    config = CalibrationConfig(rounds=rounds, gauss_newton_steps=CONFIG.gauss_newton_steps)
    return calibrate(begun, grouped_light, sample, start, False, free_light, progress.part(0.4, 1), config)[0]


def _brighter_lamps(
    light_parameters: LightParameters, grouped_light: GroupedLight, factor: float, distance: float
) -> LightParameters:
    """A setting in which what is clipped shines so many times brighter than it is expected to."""
    recorded = 1 - grouped_light.clipped_share[:, None]
    brighter = recorded + factor * (prior_light(grouped_light, distance).gain - recorded)
    gain = np.where(grouped_light.clipped[:, None], brighter, light_parameters.gain)
    return replace(light_parameters, distance=distance, gain=gain)


def _better(some: Sequence[LightParameters], others: Sequence[LightParameters]) -> list[LightParameters]:
    return [min(pair, key=_misfit) for pair in zip(some, others, strict=True)] if some else list(others)
