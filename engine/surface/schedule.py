"""The surface under a rough light, in turns with what only the object can tell about that light.

A look at a few hundred pixels says about how far away the object is. Pixels of half the size, of a large picture of
a quarter, are then solved in turns with the light (how far away it stands, how bright its parts are), each turn with the
depth, shadows and bounced light that the last one gave; one turn at each size between follows, and one of all pixels, unless
the object hides nothing of the room from itself. Some views serve: model errors, not noise, are what these turns remove.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.data import initial_maps
from engine.surface.data.initial_maps import StartMaps
from engine.surface.data.observations import thinned
from engine.surface.data.pyramid import finer, halved
from engine.surface.lighting.distance_search import Distance, find_distance
from engine.surface.lighting.emitter_groups import CLIPPED, UNSEEN
from engine.surface.lighting.grouped_light import Parts
from engine.surface.lighting.light_calibration import Setting, divided, doubt, place, settle, untouched
from engine.surface.lighting.probe_density import spaced
from engine.surface.lighting.room_light import Room, parts_at
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.material import kind, same, told
from engine.surface.optimize.pixel_sample import inner, sampled, some_of, voters
from engine.surface.params import SurfaceParams
from engine.surface.passes import improve
from engine.surface.rendering.object_pixels import (
    Subject,
    depth_of,
    search,
    sight_of,
    subject,
)
from engine.surface.rendering.transport import Incident, Lattice, Sight, lattice_around
from engine.surface.uncertainty.standard_errors import Doubt
from engine.types import Frames

HALVED_FROM, SIZES = 6000, 3
"""Object pixels from which on half the size is worth a look, and sizes at most. Light and distance are told by some hundred pixels
whatever their size."""
TELLING = 8000
"""Pixels of half the size from which on an object that is as good as bare is solved so and then in detail: what stands in the way is
all that a halved picture tells worse. But 4000 pixels leave some far off: .46 instead of .41 deg."""
DIRECTIONS = 512
"""At most: never more than the full solve takes. With twice as many these turns find the same surface and take half as
long again; it is the last one that a highlight asks for more."""
NEAREST, FARTHEST, LAYERS = 0.05, 0.8, 9
"""Reach of the first look, in units of the room's size, and the distances tried."""
LOOKS = 12
"""Views of the first look, at most; its curve is the same in twice as many."""
VOTERS = 600
"""Pixels that settle the light."""
WIDE, TIGHT, DRIFT = 1.3, 1.1, 1.04
"""The lattice reaches so many times nearer and farther than the object: as long as its distance is a guess, and then.
Between its layers the light fades over instead of moving, so that a wide lattice makes parallax look weak: the
objects of two near rooms came out 4 and 6 % too near in it, 2.5 and 1.4 % in a tight one. An object that moved by DRIFT
gets another lattice."""
AROUND, OUTLIERS = 1.03, (0.5, 99.5)
"""As soon as there is a depth the lattice reaches so many times nearer and farther than it, and not for the sake of what the
rim says beyond these percentiles of it."""
ACROSS = 2
"""Probes along each image axis of the wide lattice; the tight one has as many as the full solve. With 2 in that as well the
light fades sideways too: 2.4 and 2.3 % too near in a lit room, 1.0 and 1.2 % with 3; more, or more layers, bring half
a percent at most."""
OUTSHONE = 5.0
"""A clipped lamp that the first look found so many times brighter than expected keeps that, and the surface is sought anew."""
STILL = np.radians(0.3)
"""Mean turn of the normals in a turn below which those that are left of this size are left out."""
ROUNDS, PASSES = 4, 2
MORE = 3
"""So many more turns of this size, at most, where light comes from where no photograph looked."""


@dataclass(frozen=True, slots=True, eq=False)
class Rough:
    """What the rough turns have found, of all pixels of the mask."""

    state: gauss_newton.State
    # As the turns of half the size left it, for the pixels of `state`; that itself if none of another size followed.
    coarse: gauss_newton.State
    depth: Float[np.ndarray, "h w"]
    sight: Sight  # its directions are those of `parts`
    setting: Setting
    distance: Distance
    residuals: tuple[float, ...]  # turn by turn
    views: Int[np.ndarray, " n"]  # that served
    room: Room  # in as many parts as it took
    parts: Parts  # its light in those views
    material: Float[np.ndarray, "p 2"] | None  # as in `Subject`
    around: bool  # whether its lattice is around this depth
    halved: bool  # whether the picture was, and is to stay so until its pixels are solved in detail
    doubt: Doubt | None  # what is left of it about the light; None: nothing was open

    def alike(self, directions: int) -> bool:
        """Whether light and sight are told for so many directions."""
        return len(self.parts.incident.directions) == directions


def rough(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    room: Room,
    fitted: Int[np.ndarray, " f"],
    maps: StartMaps | None,
    params: SurfaceParams,
    device: str,
    seed: int,
    progress: Progress,
) -> Rough:
    """All of it; `seed` picks the pixels that vote on the light, `maps` stand for the global search where given."""
    views = thinned(fitted, params.rough_views)
    few = frames.views(views)
    camera = room.poses.camera
    sizes, every = [subject(few, mask, camera, np.arange(len(views)), params)], np.arange(len(views))
    fewer, small, camera_of_small = few, mask, camera
    while small.sum() > HALVED_FROM and len(sizes) < SIZES:
        fewer, small, camera_of_small = halved(fewer, small, camera_of_small)
        sizes.append(subject(fewer, small, camera_of_small, every, params))
    whole, half, smallest = sizes[0], sizes[:2][-1], sizes[-1]
    # What no photograph shows is found part by part, turn by turn.
    turns = params.rough_rounds + MORE * (params.relight and room.emitters.patches > 0)
    levels = [smallest] * (turns - 1) + [half] * (turns > 0)
    if not levels or (params.full_turn and half is not whole):
        levels.append(whole if params.full_turn else half)
    free = params.object_distance <= 0
    distance, tried, misfits = params.object_distance, (), ()
    who, begun = levels[0], None
    open_to_doubt = params.relight & np.isin(room.kind, (CLIPPED, UNSEEN)).any()
    if free or open_to_doubt:
        begun, room, *curve = first_look(who, room, views, params, seed, progress.part(0, 0.2))
        if free:
            distance, (tried, misfits) = begun.distance, curve

    def light_around(lattice: Lattice, span: Progress) -> Parts:
        return parts_at(lattice, room, views, _directions(params), params.probe_face_px, span)

    def first_surface(of: Subject, light: Incident, sight: Sight, span: Progress) -> gauss_newton.State:
        if maps is None:
            return search(of, light, sight, params, span)
        return initial_maps.begun(maps, of, light, sight, params, span)

    margin = WIDE if free else TIGHT
    middle, stderr = distance, 0.0
    wide = lattice_around(camera, mask, (distance / margin, distance * margin), (ACROSS, ACROSS, 2))
    parts = light_around(wide, progress.part(0.2, 0.3))
    setting, sight = untouched(parts, distance), who.flat(distance)
    surprising = parts.unseen
    if begun is not None:
        surprising = parts.clipped & (begun.gain > OUTSHONE * setting.gain).any(1) | parts.unseen
        setting = replace(setting, gain=np.where(surprising[:, None], begun.gain, setting.gain))
    surprised = params.relight and surprising.any()
    state = first_surface(who, parts.under(setting.gain), sight, progress.part(0.3, 0.35))
    residuals, left, coarse = [], None, None
    # The last turn stands where the ones before it have put it.
    placing = max(0, len(levels) - 2) if params.full_turn else len(levels) - 1
    turn, finer_light = 0, False
    while turn < len(levels):
        following = levels[turn] if turn == 0 or not telling(who, half, sight) else who
        begin = 0.35 + 0.65 * turn / len(levels)
        span = progress.part(begin, begin + 0.65 / len(levels))
        if turn == 1 or (turn and drifted(distance, middle)):  # the first turn gives points to put it around
            middle = distance
            nearest, farthest = reach(sight.points[:, 2])
            near_far = min(nearest, middle / TIGHT), max(farthest, middle * TIGHT)
            tight = spaced(
                camera,
                mask,
                near_far,
                room.emitters,
                room.poses.cam_from_world[views],
                params,
                span.part(0, 0.02),
            )
            parts = light_around(tight, span.part(0.02, 0.2))
        light = parts.under(setting.gain, setting.aside)
        if following.mask is not who.mask:
            who, state, depth, sight = finer(following, who, state, sight, distance, span.part(0.2, 0.3))
            coarse = state
        even = who.exposed(setting.drift)
        if surprised and (turn == 1 or finer_light):  # that the last search did not know of
            state = first_surface(even, light, sight, span.part(0.2, 0.3))
        before = state.normals
        state = improve(even, state, light, sight, params, device, span.part(0.3, 0.55))
        if 1 < turn < placing and angle_between(before, state.normals).mean() < STILL:
            # The one at another size is not left out.
            turn = placing - (levels[placing] is not levels[turn])
        if params.material and turn in (0, placing):
            # Metal is plain at once; how much paint mirrors asks for the light as it is settled.
            settled, then = 0 < turn == placing, span.part(0.55, 0.65)
            even, state = made_anew(
                even, state, light, sight, first_surface, settled, params, device, seed, then
            )
            who, sight = replace(who, material=even.material), replace(sight, material=even.material)
        residuals.append(float(np.median(state.spread)))
        depth = depth_of(who, state, distance, span.part(0.65, 0.73))
        sight = sight_of(who, state, depth, light.directions, params, span.part(0.73, 0.8))
        if params.relight or free:
            chosen, sample = voters(
                who, sight, distance, VOTERS, params, seed, spread=state.spread, light=light
            )
            voting = state.part(chosen)
            moving = free and turn <= placing
            made = divided(parts, setting) if params.relight and turn < placing else None
            finer_light = made is not None
            if made is not None:
                parts, setting = made
                room = room.divided(parts.patches)
            setting, voted = settle(
                setting, parts, sample, voting, moving, params.relight, ROUNDS, PASSES, span.part(0.8, 0.9)
            )
            if params.relight and turn == len(levels) - 1:
                some = some_of(inner(who), VOTERS, seed + 1)
                others = sampled(who, sight, distance, some, params, light=light), state.part(some)
                left = Doubt(others[1].normals, doubt(setting, parts, (sample, voted), others))
            if free and turn == placing:
                setting = place(
                    setting, parts, sample, voting, params.relight, ROUNDS // 2, PASSES, span.part(0.9, 1)
                )
                stderr = setting.distance_stderr
            moved, distance = setting.distance / distance, setting.distance
            sight, depth = sight.at(moved), depth * moved
        turn += 1
    if who.mask is not whole.mask and not telling(who, half, sight):
        who, state, depth, sight = finer(whole, who, state, sight, distance, progress.part(0.98, 1))
        coarse = state
    found = Distance(distance, stderr * distance, "light" if free else "given", tried, misfits)
    around = len(levels) > 1 and not drifted(distance, middle)
    return Rough(
        state, coarse or state, depth, sight, setting, found, tuple(residuals), views, room, parts, who.material, around,
        who.mask is not whole.mask, left,
    )  # fmt: skip


def telling(who: Subject, half: Subject, sight: Sight) -> bool:
    """Whether these are the pixels of half the size, and enough: the object is known to hide next to nothing of the room from
    itself."""
    hidden = sight.occlusion
    return who.mask is half.mask and hidden is not None and len(who.rays) >= TELLING and hidden.bare


def made_anew(
    who: Subject,
    state: gauss_newton.State,
    light: Incident,
    sight: Sight,
    first_surface: Callable[[Subject, Incident, Sight, Progress], gauss_newton.State],
    settled: bool,
    params: SurfaceParams,
    device: str,
    seed: int,
    progress: Progress,
) -> tuple[Subject, gauss_newton.State]:
    """The subject of what it turns out to be made of, and its surface as that; both as they were where nothing else turns out.

    How much paint mirrors is only asked where the light is `settled`.
    """
    made = told(who, state, light, sight, settled, params, seed, progress.part(0, 0.3))
    if same(made, who.material):
        return who, state
    turned = kind(made, who) != kind(who.material, who)
    who, sight = replace(who, material=made), replace(sight, material=made)
    if turned.any():
        anew = first_surface(who, light, sight, progress.part(0.3, 0.5))
        state = gauss_newton.either(turned, anew, state)
    return who, improve(who, state, light, sight, params, device, progress.part(0.5, 1))


def reach(z: Float[np.ndarray, " p"]) -> tuple[float, float]:
    """z of the first and the last layer of a lattice around points so far away."""
    nearest, farthest = np.percentile(z, OUTLIERS)
    return float(nearest / AROUND), float(farthest * AROUND)


def drifted(distance: float, middle: float) -> bool:
    """Whether an object has moved too far from where its lattice was put."""
    return not 1 / DRIFT < distance / middle < DRIFT


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
    parts = parts_at(lattice, room, views[every], _directions(params), face_px, span)
    # Flat and shadowless, pixels misfit by more than any drift.
    parts = replace(parts, drift=0.0, astray=0.0)
    _, sample = voters(who, who.flat(1.0), 1.0, VOTERS // 2, params, seed, every)
    found, parts, tried, misfits = find_distance(parts, sample, params, progress.part(0.5, 1))
    return found, room.divided(parts.patches), tried, misfits


def _directions(params: SurfaceParams) -> int:
    """Of the rough turns."""
    return min(DIRECTIONS, params.directions or DIRECTIONS)
