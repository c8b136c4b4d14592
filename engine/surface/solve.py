"""Stage *surface*: from photographs and the room's light to normals, albedo, roughness, depth, with errors.

Coarse to fine: `rough` finds a first surface together with the object's distance and the brightness of the light's
parts; under that light, now in all views and many directions, every pixel is solved again, with the depth,
shadows and bounced light of the last round. Some views are kept out of the fit and re-rendered. Of an object too large
for that, or one that hides nothing of the room from itself, a smaller picture is solved so, and then its pixels tile by
tile (`tiled_solve`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.errors import SurfaceError
from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.data import initial_maps
from engine.surface.data.observations import thinned
from engine.surface.data.pyramid import doubled
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.emitter_groups import CLIPPED
from engine.surface.lighting.exposure_offset import DRIFT, drift_of
from engine.surface.lighting.probe_density import enough, spaced
from engine.surface.lighting.room_light import Room, furnished, light_at
from engine.surface.optimize.gauss_newton import State
from engine.surface.optimize.spatial_regularization import accord
from engine.surface.params import LEAST_VIEWS, SurfaceParams
from engine.surface.passes import improve
from engine.surface.reflectance.brdf import PAINT, of_pixels
from engine.surface.rendering.object_pixels import (
    Subject,
    answering,
    depth_of,
    image,
    photographed_in,
    sight_of,
    subject,
)
from engine.surface.rendering.transport import Incident, Sight
from engine.surface.schedule import Rough, reach, rough
from engine.surface.tiled_solve import Maps, Picture, Solved, in_detail, judged, smaller, window
from engine.surface.uncertainty.standard_errors import FLAGS, unsettled
from engine.types import Emitters, Frames, Gaussians, Lamps, Masks, Poses, Renders, Surface

SPARE = 8
"""At most one of so many views is kept out of the fit."""
ASTRAY = float(np.radians(0.5))
"""How far a lamp's direction may be off before it has to be argued: three pixels of a small photograph."""
STILL = np.radians(1.0)
"""Mean turn of the normals in a round from which on another follows. What hides and lights whom is told by the shape, so that
recesses deepen from round to round, while what is convex stands still at once."""


@dataclass(frozen=True, slots=True)
class SurfaceReport:
    """Facts of one solve, fit for JSON."""

    pixels: int
    together: (
        int  # pixels of the picture that was solved at once; fewer than `pixels`: the rest followed in tiles
    )
    rounds: int  # on all of these
    fitted_views: int
    held_out_views: tuple[int, ...]
    held_out_error: float  # median relative error of the re-rendered radiance
    residual: float  # median weighted residual spread
    distance: Distance
    probe_reach: tuple[float, float]  # z of the nearest and the farthest layer of probes
    probes: tuple[int, int, int]  # along each axis of their lattice
    directions: int  # of light
    light_gains: tuple[tuple[float, ...], ...]  # per group and channel; without refinement the belief
    metal: float  # share of the pixels that are taken for metal
    specular_level: tuple[float, float]  # least and most of the others
    unseen_light: float  # share of the light on the object that no photograph shows, under those gains
    clipped_groups: tuple[int, ...]  # those whose brightness only the object's shading tells
    exposure_drift: tuple[float, ...]  # of every frame's log exposure; 0 of those that were not fitted
    lamp_shifts_deg: tuple[float, ...]  # how far every lamp has moved, as seen from amid the cameras
    rough_residuals: tuple[float, ...]  # median weighted residual spread, turn by turn
    stderr_normal_deg: float  # median
    flagged: dict[str, int]


def held_out(registered: Bool[np.ndarray, " n"], count: int) -> tuple[Int[np.ndarray, " f"], tuple[int, ...]]:
    """(fitted, held out) view indices: the held-out ones evenly spread over the registered."""
    usable = np.nonzero(registered)[0]
    if len(usable) < LEAST_VIEWS:
        raise SurfaceError(
            f"only {len(usable)} views have a pose and light; at least {LEAST_VIEWS} are needed, add photographs"
        )
    count = min(count, len(usable) // SPARE, len(usable) - LEAST_VIEWS)
    out = usable[np.linspace(0, len(usable) - 1, count + 2).astype(int)[1:-1]]
    return np.setdiff1d(usable, out), tuple(int(i) for i in out)


def solve(
    frames: Frames,
    masks: Masks,
    poses: Poses,
    gaussians: Gaussians,
    lamps: Lamps,
    params: SurfaceParams,
    device: str,
    seed: int,
    progress: Progress,
    flip: int = 0,
) -> tuple[Surface, Renders, Emitters, SurfaceReport]:
    """Solve the surface; `seed` picks the pixels that vote on the light, start maps are of the upright picture, turned
    by `flip`.

    Raises:
        SurfaceError: too few views, an empty mask, frames without usable object pixels, start maps that cannot be
            read or do not fit, or a device with too little memory.
    """
    mask = masks.object
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    fitted, kept_out = held_out(poses.registered, params.held_out)
    room = furnished(
        gaussians, lamps, frames, masks, poses, params.relight_groups, params.relight_prior, seed,
        DRIFT * (params.relight and params.exposure_drift), ASTRAY * (params.relight and params.lamp_shift),
    )  # fmt: skip
    whole = Picture(frames, mask, poses.camera, initial_maps.asked(params, mask, flip)).part(*window(mask))
    picture, take = smaller(whole, params.together)
    room = replace(room, poses=replace(poses, camera=picture.camera))
    alone = 0.9 if picture is whole else 0.3
    found, first, fitted, emitters, turns = together(
        picture, room, fitted, kept_out, params, device, seed, progress.part(0, alone)
    )
    if found.picture is not picture:
        take, picture = doubled(found.picture.mask, picture.mask)[take], found.picture
    here = found.who.responses(found.here, params, device, found.sight)
    seen = photographed_in(picture.frames, picture.mask, kept_out)
    there = answering(seen, found.there, found.sight, params, "cpu")
    span = progress.part(alone, 1)
    if picture is whole:
        maps = judged(found.who, found.state, found.sight, here, there, found.doubt, found.unsure, span)
        z = found.depth[picture.mask]
    else:
        maps, depth = in_detail(whole, fitted, take, found, here, there, params, span)
        z = depth[whole.mask]
    made = of_pixels(first.material, take)
    surface = surface_of(mask, maps, z, params.model_error, made)
    pictures = np.zeros((len(kept_out), *mask.shape, 3), np.float32)
    pictures[:, mask] = maps.pictures.transpose(1, 0, 2)
    lattice, drift = found.here.lattice, np.zeros(len(frames.names))
    drift[fitted] = found.drift
    report = SurfaceReport(
        len(z),
        int(picture.mask.sum()),
        turns,
        len(fitted),
        kept_out,
        rerendering_error(frames, kept_out, pictures, mask),
        float(np.median(maps.spread)),
        first.distance,
        (float(lattice.low[2]), float(lattice.high[2])),
        lattice.shape,
        len(found.here.directions),
        tuple(tuple(map(float, gain)) for gain in first.setting.gain),
        *made_of(made),
        first.parts.unseen_share(first.setting.gain),
        tuple(int(k) for k in np.nonzero(first.room.kind == CLIPPED)[0]),
        tuple(map(float, drift)),
        tuple(map(float, np.degrees(np.linalg.norm(first.setting.aside, axis=1)))),
        first.residuals,
        float(np.degrees(np.median(maps.stderr_normal))),
        {name: int((maps.flags & bit > 0).sum()) for name, bit in FLAGS.items()},
    )
    return surface, Renders(kept_out, pictures), emitters, report


def together(
    picture: Picture,
    room: Room,
    fitted: Int[np.ndarray, " f"],
    kept_out: tuple[int, ...],
    params: SurfaceParams,
    device: str,
    seed: int,
    progress: Progress,
) -> tuple[Solved, Rough, Int[np.ndarray, " n"], Emitters, int]:
    """All pixels of a picture at once, or of its half where that tells as much: the surface, what the rough turns found, the
    views that were fitted, the light that they settled, and how many rounds it took.

    The poses of `room` have the picture's camera.
    """
    first = rough(
        picture.frames, picture.mask, room, fitted, picture.start, params, device, seed, progress.part(0, 0.5)
    )
    picture = picture.halved() if first.halved else picture
    frames, mask, poses = picture.frames, picture.mask, replace(room.poses, camera=picture.camera)
    state, depth, sight = first.state, first.depth, first.sight
    fitted = thinned(fitted, params.views or len(fitted))
    who, z = subject(frames, mask, poses.camera, fitted, params), first.distance.value
    who = replace(who, material=first.material)
    aside = first.setting.aside
    emitters = first.room.under(first.setting.gain[:-1], first.parts.shift(aside))
    views = np.concatenate([fitted, np.array(kept_out, int)])
    if not params.directions:
        there = poses.cam_from_world[views]
        params = replace(
            params, directions=enough(state, sight, emitters, there, params, progress.part(0.5, 0.52))
        )
    light = whole_light(first, mask, emitters, poses, views, params, progress.part(0.52, 0.67))
    here = light.views(np.arange(len(fitted)))
    if not first.alike(params.directions):
        sight = sight_of(who, state, depth, light.directions, params, progress.part(0.66, 0.67))
    drift = np.zeros(len(poses.registered))
    drift[first.views] = first.setting.drift
    drift, who = drift[fitted], who.exposed(drift[fitted])
    if room.drift:
        left = drift_of(state, who.responses(here, params, device, sight), sight, who)
        settled = np.isin(fitted, first.views)
        # Settled views stay, and with them the scale.
        left = np.where(settled, 0, left - left[settled if settled.any() else slice(None)].mean())
        drift, who = drift + left, who.exposed(left)

    state, depth, turns = until_still(
        who, state, depth, sight, here, z, params, device, progress.part(0.67, 0.99)
    )
    moving = angle_between(first.state.normals, state.normals).mean() > STILL
    left = unsettled(first.coarse, state) if moving else None
    # What the depth that is given out hides: a picture made from the stored results later is then the same picture.
    sight = sight_of(who, state, depth, light.directions, params, progress.part(0.99, 1))
    there = light.views(np.arange(len(fitted), len(fitted) + len(kept_out)))
    found = Solved(picture, who, state, depth, sight, here, there, drift, first.doubt, left)
    return found, first, fitted, emitters, turns


def until_still(
    who: Subject,
    state: State,
    depth: Float[np.ndarray, "h w"],
    sight: Sight,
    light: Incident,
    distance: float,
    params: SurfaceParams,
    device: str,
    progress: Progress,
) -> tuple[State, Float[np.ndarray, "h w"], int]:
    """All pixels under a light that is settled, round by round with their depth; and how many rounds it took.

    `sight` is what the depth hides, for the light's directions.
    """
    turn, going = 0, True
    while going:
        span = progress.part(0.95 * turn / params.rounds, 0.95 * (turn + 1) / params.rounds)
        if turn:
            sight = sight_of(who, state, depth, light.directions, params, span.part(0, 0.1))
        before = state.normals
        state = improve(who, state, light, sight, params, device, span.part(0.1, 0.6))
        turn += 1
        going = turn < params.rounds and angle_between(before, state.normals).mean() > STILL
        if going:
            depth = depth_of(who, state, distance, span.part(0.6, 0.7))
    if params.accord:
        state = accord(state, who.mask)
    return state, depth_of(who, state, distance, progress.part(0.95, 1)), turn


def whole_light(
    first: Rough,
    mask: Bool[np.ndarray, "h w"],
    emitters: Emitters,
    poses: Poses,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
    progress: Progress,
) -> Incident:
    """The light that the rough turns have settled, at some views: what they have gathered already, and the rest."""
    if first.alike(params.directions) and first.around:
        lattice, known = first.parts.incident.lattice, first.views
    else:
        near_far, everywhere = reach(first.depth[mask]), poses.cam_from_world[views]
        lattice = spaced(poses.camera, mask, near_far, emitters, everywhere, params, progress.part(0, 0.1))
        known = views[:0]
    rest = np.setdiff1d(views, known)
    there = poses.cam_from_world[rest]
    light = light_at(lattice, emitters, there, params.directions, params.probe_face_px, progress)
    if len(known):
        gathered = first.parts.under(first.setting.gain, first.setting.aside)
        light, rest = gathered.beside(light), np.concatenate([known, rest])
    order = np.argsort(rest)
    return light.views(order[np.searchsorted(rest[order], views)])


def rerendering_error(
    frames: Frames,
    views: tuple[int, ...],
    pictures: Float[np.ndarray, "k h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> float:
    """Median relative error of pictures of some views; 0 without pictures."""
    if not views:
        return 0.0
    truth, answer = frames.radiance[list(views)][:, mask], pictures[:, mask]
    return float(np.median(np.abs(answer - truth) / np.maximum(truth, 0.02 * np.median(truth))))


def made_of(material: Float[np.ndarray, "p 2"] | None) -> tuple[float, tuple[float, float]]:
    """The share of metal, and the range of the specular level of what is none."""
    metal = material is not None and material[:, 1] > 0
    level = PAINT[:1] if material is None or np.all(metal) else material[~metal, 0]
    return float(np.mean(metal)), (float(np.min(level)), float(np.max(level)))


def surface_of(
    mask: Bool[np.ndarray, "h w"],
    maps: Maps,
    z: Float[np.ndarray, " p"],
    model_error: float,
    material: Float[np.ndarray, "p 2"] | None = None,
) -> Surface:
    """What is known of the mask's pixels as maps."""
    return Surface(
        mask,
        image(mask, maps.normals),
        image(mask, maps.albedo),
        image(mask, maps.roughness),
        image(mask, z),
        image(mask, maps.stderr_normal),
        image(mask, maps.stderr_albedo),
        image(mask, maps.stderr_roughness),
        image(mask, maps.spread * model_error),
        image(mask, maps.flags).astype(np.uint8),
        None if material is None else image(mask, material),
    )
