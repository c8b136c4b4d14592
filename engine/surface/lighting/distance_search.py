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
from engine.surface.data.observations import thinned
from engine.surface.lighting.grouped_light import Parts
from engine.surface.lighting.light_calibration import Setting, divided, settle, untouched
from engine.surface.lighting.room_light import Room, parts_at
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.exhaustive_search import global_start
from engine.surface.optimize.pixel_sample import Sample, voters
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import Subject
from engine.surface.rendering.transport import lattice_around

CANDIDATES = 150
PASSES = 3
ROUNDS = 3
LEVELS = (1.0, 5.0)
"""How bright what no photograph shows is at first, in units of its surroundings: normals that are sought under too dark a
ceiling all look up to it, and no gain leads away from there."""
AGAIN, FALLEN = 4, 0.98
"""Where there is any, normals are sought so often once more under the best gains so far, as long as the misfit falls so far."""
FINER, LOOKED = 8, 3
"""What no photograph shows is divided so often at most where it is bright, and after each time normals are sought so often at
most, as long as the misfit falls so far."""
BRIGHTER, EVERY = (10.0, 100.0, 1000.0), 3
"""How many times brighter than expected clipped lamps are tried, at every so many-th layer: a chink in the shutters was
recorded with a three-hundredth of its light, and from so far away no gain finds the way."""
DIRECTIONS = 512
"""Of the light in the coarse phases at most: with twice as many they find the same surface and take half as long again; it is the
fine phase that a highlight asks for more."""
NEAREST, FARTHEST, LAYERS = 0.05, 0.8, 9
"""Reach of the search, in units of the room's size, and the distances tried."""
LOOKS = 12
"""Views that serve, at most; the curve is the same in twice as many."""
VOTERS = 600
"""Pixels that calibrate the light; half of them serve here."""


_misfit = attrgetter("misfit")


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


def first_look(
    who: Subject,
    room: Room,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
    seed: int,
    progress: Progress,
) -> tuple[Setting, Room, tuple[float, ...], tuple[float, ...]]:
    """The object's distance to a fifth or so unless it is given, with the light that suits it; the room in as many parts as
    that took; and the curve: distances tried and their misfits."""
    every = thinned(np.arange(len(views)), min(LOOKS, len(views) // 2))
    near_far, layers = (NEAREST * room.size(), FARTHEST * room.size()), LAYERS
    if params.object_distance > 0:
        near_far, layers = (params.object_distance, params.object_distance), 1
    lattice = lattice_around(who.camera, who.mask, near_far, (1, 1, layers))
    face_px, span = params.probe_face_px, progress.part(0, 0.5)
    parts = parts_at(lattice, room, views[every], coarse_directions(params), face_px, span)
    # Flat and shadowless, pixels misfit by more than any drift.
    parts = replace(parts, drift=0.0, astray=0.0)
    _, sample = voters(who, who.flat(1.0), 1.0, VOTERS // 2, params, seed, every)
    found, parts, tried, misfits = find_distance(parts, sample, params, progress.part(0.5, 1))
    return found, room.divided(parts.patches), tried, misfits


def coarse_directions(params: SurfaceParams) -> int:
    """Of the light in the coarse phases."""
    return min(DIRECTIONS, params.directions or DIRECTIONS)


def find_distance(
    parts: Parts, sample: Sample, params: SurfaceParams, progress: Progress
) -> tuple[Setting, Parts, tuple[float, ...], tuple[float, ...]]:
    """The best of the lattice's layers, with the light that suits it; the light by as many parts as that took; and the
    curve: distances and their misfits.

    What no photograph shows, where there is any, is as bright as suits the object best; one brightness serves to begin
    with at every distance, for it hardly depends on that. Where it turns out bright it is divided, and so on, as long as
    that suits it better. Clipped lamps are made brighter as long as that does.
    """
    layers = parts.incident.lattice.depths()
    levels = LEVELS if parts.unseen.any() and params.relight else (1.0,)
    brighter = BRIGHTER if parts.clipped.any() and params.relight else ()
    again = AGAIN if len(levels) > 1 else 0
    first, then = progress.part(0, 0.5 if again else 1), progress.part(0.5, 1)
    turns = iter(first.parts(len(levels) + len(brighter) + (AGAIN if brighter else again)))

    def looked(begun: Sequence[Setting]) -> list[Setting]:
        spans = next(turns).parts(len(begun))
        return [_settled(one, parts, sample, params, span) for one, span in zip(begun, spans, strict=True)]

    best: list[Setting] = []
    for level in levels:
        best = _better(best, looked([untouched(parts, float(z), level) for z in layers]))
    some_layers = slice(min(EVERY // 2, len(layers) - 1), None, EVERY)
    for factor in brighter:
        some = best[some_layers]
        least = min(some, key=_misfit)
        tried = looked([_outshone(least, parts, factor, one.distance) for one in some])
        if min(map(_misfit, tried)) > FALLEN * least.misfit:
            break
        best[some_layers], again = _better(some, tried), AGAIN
    for _ in range(again):
        least = min(best, key=_misfit)
        best = _better(best, looked([replace(least, distance=float(z)) for z in layers]))
        if _misfit(min(best, key=_misfit)) > FALLEN * least.misfit:
            break
    least = min(best, key=_misfit)
    if len(levels) > 1:
        least, parts = _finer(least, parts, sample, params, then)
    return least, parts, tuple(map(float, layers)), tuple(map(_misfit, best))


def _finer(
    least: Setting, parts: Parts, sample: Sample, params: SurfaceParams, progress: Progress
) -> tuple[Setting, Parts]:
    """The light with what no photograph shows divided where it is bright, and so on, as long as that suits the object better."""
    spans = iter(progress.parts(FINER * LOOKED))
    for _ in range(FINER):
        if (made := divided(parts, least)) is None:
            break
        finer, begun = made
        for _ in range(LOOKED):
            found = _settled(begun, finer, sample, params, next(spans))
            if found.misfit > FALLEN * least.misfit:
                break
            parts, least, begun = finer, found, found
        if parts is not finer:
            break
    return least, parts


def _settled(
    begun: Setting, parts: Parts, sample: Sample, params: SurfaceParams, progress: Progress
) -> Setting:
    """The light that suits normals which are sought from nothing under it as it is begun."""
    responses, sight = sample.responses(parts.under(begun.gain)), sample.at(begun.distance)
    start = global_start(responses, sight, sample.seen, sample.regions, CANDIDATES, progress.part(0, 0.4))
    rounds = ROUNDS if params.relight else 0
    return settle(
        begun,
        parts,
        sample,
        gauss_newton.begin(*start),
        False,
        params.relight,
        rounds,
        PASSES,
        progress.part(0.4, 1),
    )[0]


def _outshone(setting: Setting, parts: Parts, factor: float, distance: float) -> Setting:
    """A setting whose clipped lamps shine so many times brighter than they are expected to."""
    expected = factor * untouched(parts, distance).gain
    gain = np.where(parts.clipped[:, None], expected, setting.gain)
    return replace(setting, distance=distance, gain=gain)


def _better(some: Sequence[Setting], others: Sequence[Setting]) -> list[Setting]:
    return [min(pair, key=_misfit) for pair in zip(some, others, strict=True)] if some else list(others)
