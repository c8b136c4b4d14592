"""Stage *surface*: from photographs and the room's light to normals, albedo, roughness, depth, with standard errors.

`schedule.py` says what is done in which order. Some views are kept out of the fit and re-rendered. Of an object too large to
be solved at once, or one that hides nothing of the room from itself, a smaller picture is solved, and then its pixels tile
by tile (`tiled_solve`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.errors import SurfaceError
from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.data import initial_maps
from engine.surface.data.pyramid import parent_index
from engine.surface.data.scene import Picture, Scene, build_scene, downsample_to, window
from engine.surface.depth.normal_integration import integrate_parts
from engine.surface.estimate import Estimate, Iteration
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.emitter_groups import CLIPPED
from engine.surface.lighting.exposure_offset import EXPOSURE_SIGMA
from engine.surface.lighting.room_light import RoomLight, build_room_light
from engine.surface.params import LEAST_VIEWS, SurfaceParams
from engine.surface.passes import emitters_of
from engine.surface.reflectance.brdf import PAINT, of_pixels
from engine.surface.rendering.object_pixels import image, light_transport, photographed_radiance
from engine.surface.schedule import run, schedule
from engine.surface.tiled_solve import SolvedMaps, evaluate_result, solve_tiles
from engine.surface.uncertainty.standard_errors import FLAGS, grid_refinement_error, unresolved_variance
from engine.types import Emitters, Frames, Gaussians, Lamps, Masks, Poses, Surface, ValidationRenders

VALIDATION_ONE_IN = 8
"""At most one of so many views is kept out of the fit."""
LAMP_DIRECTION_SIGMA = float(np.radians(0.5))
"""How far a lamp's direction may be off before it has to be argued: three pixels of a small photograph."""
MOVING_DEG = 1.0
"""Mean turn of the normals in the fine phases from which on an answer counts as one that still moves."""


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
    history: tuple[Iteration, ...]  # what ran, in order, and what it did
    stderr_normal_deg: float  # median
    flagged: dict[str, int]
    depth_parts: tuple[
        float, ...
    ] = ()  # shares of the pixels of the depth's parts (`Surface.part`), the largest first


def held_out(registered: Bool[np.ndarray, " n"], count: int) -> tuple[Int[np.ndarray, " f"], tuple[int, ...]]:
    """(fitted, held out) view indices: the held-out ones evenly spread over the registered."""
    usable = np.nonzero(registered)[0]
    if len(usable) < LEAST_VIEWS:
        raise SurfaceError(
            f"only {len(usable)} views have a pose and light; at least {LEAST_VIEWS} are needed, add photographs"
        )
    count = min(count, len(usable) // VALIDATION_ONE_IN, len(usable) - LEAST_VIEWS)
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
) -> tuple[Surface, ValidationRenders, Emitters, SurfaceReport]:
    """Solve the surface; `seed` picks the pixels that calibrate the light, start maps are of the upright picture, turned
    by `flip`.

    Raises:
        SurfaceError: too few views, an empty mask, frames without usable object pixels, start maps that cannot be
            read or do not fit, or a device with too little memory.
    """
    mask = masks.object
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    fitted, kept_out = held_out(poses.registered, params.validation_views)
    room = build_room_light(
        gaussians, lamps, frames, masks, poses, params.light_groups, params.light_gain_sigma, seed,
        EXPOSURE_SIGMA * params.models("light_gains", "view_exposures"), LAMP_DIRECTION_SIGMA * params.models("light_gains", "lamp_directions"),
    )  # fmt: skip
    whole = Picture(frames, mask, poses.camera, initial_maps.requested(params, mask, flip)).part(
        *window(mask)
    )
    picture, take = downsample_to(whole, params.tile_above_pixels)
    scene = build_scene(
        picture, replace(poses, camera=picture.camera), fitted, kept_out, params, device, seed
    )
    alone = 0.9 if picture is whole else 0.3
    phases = schedule(params, room.emitters.patches > 0)
    found = run(scene, initial_state(scene, room), phases, progress.part(0, alone))
    assert found.picture is not None
    assert found.light is not None
    assert found.validation is not None
    if found.level:
        take = parent_index(found.picture.mask, picture.mask)[take]
    solved_at_once = found.level == 0 and picture is whole
    here = found.object_pixels.light_transport(found.light, params, device, found.geometry)
    seen = photographed_radiance(found.picture.frames, found.picture.mask, kept_out)
    there = light_transport(seen, found.validation, found.geometry, params, "cpu")
    moving = still_moving(found)
    span = progress.part(alone, 0.98)
    if solved_at_once:
        maps = evaluate_result(
            found.object_pixels,
            found.known_state,
            found.geometry,
            here,
            there,
            found.light_variance,
            moving,
            span,
        )
        z = found.known_depth[picture.mask]
    else:
        maps, depth = solve_tiles(whole, scene.fitted, take, found, moving, here, there, params, span)
        z = depth[whole.mask]
    edges = unresolved_variance(image(mask, maps.normals), mask, image(mask, maps.stderr_normal))[mask]
    maps = replace(maps, stderr_normal=np.minimum(np.sqrt(maps.stderr_normal**2 + edges), np.pi / 2))
    material = of_pixels(found.object_pixels.material, take)
    integrated = integrate_parts(
        poses.camera, image(mask, maps.normals), mask, found.distance.value, progress.part(0.98, 1)
    )
    surface = replace(surface_of(mask, maps, z, params.model_error, material), part=integrated.part)
    pictures = np.zeros((len(kept_out), *mask.shape, 3), np.float32)
    pictures[:, mask] = maps.pictures.transpose(1, 0, 2)
    error = rerendering_error(frames, kept_out, pictures, mask)
    report = report_of(scene, found, maps, material, kept_out, error)
    report = replace(report, depth_parts=integrated.shares)
    return surface, ValidationRenders(kept_out, pictures), emitters_of(found), report


def initial_state(scene: Scene, room: RoomLight) -> Estimate:
    """What is known before the first pass: where the object's pixels look."""
    given = scene.params.object_distance
    object_pixels = scene.coarse[-1].pixels(np.arange(len(scene.coarse_views)), scene.params)
    room = replace(room, poses=scene.poses)
    distance = Distance(given, 0.0, "given" if given > 0 else "light")
    return Estimate(
        scene.smallest,
        scene.coarse_views,
        object_pixels,
        room,
        distance,
        object_pixels.geometry_at_distance(given or 1.0),
    )


def still_moving(found: Estimate) -> Float[np.ndarray, "p 6"] | None:
    """Variances of the unknowns of a surface that the fine phase still turned; None where it stands still."""
    assert found.coarse_state is not None
    assert found.halved_state is not None
    turned = angle_between(found.coarse_state.normals, found.known_state.normals).mean()
    return (
        grid_refinement_error(found.halved_state, found.known_state)
        if np.degrees(turned) > MOVING_DEG
        else None
    )


def report_of(
    scene: Scene,
    found: Estimate,
    maps: SolvedMaps,
    material: Float[np.ndarray, "p 2"] | None,
    kept_out: tuple[int, ...],
    error: float,
) -> SurfaceReport:
    """The facts of a solve; `error` is that of the views kept out."""
    assert found.picture is not None
    assert found.exposure_offset is not None
    lattice, drift = found.incident.probe_grid, np.zeros(len(scene.picture.frames.names))
    drift[scene.fitted] = found.exposure_offset
    return SurfaceReport(
        len(maps.normals),
        int(found.picture.mask.sum()),
        sum(one.phase == "fine" for one in found.history),
        len(scene.fitted),
        kept_out,
        error,
        float(np.median(maps.residual_scale)),
        found.distance,
        (float(lattice.low[2]), float(lattice.high[2])),
        lattice.shape,
        len(found.incident.directions),
        tuple(tuple(map(float, gain)) for gain in found.known_light_parameters.gain),
        *material_facts(material),
        found.known_grouped_light.unseen_share(found.known_light_parameters.gain),
        tuple(int(k) for k in np.nonzero(found.room_light.kind == CLIPPED)[0]),
        tuple(map(float, drift)),
        tuple(map(float, np.degrees(np.linalg.norm(found.known_light_parameters.lamp_offset, axis=1)))),
        found.history,
        float(np.degrees(np.median(maps.stderr_normal))),
        {name: int((maps.flags & bit > 0).sum()) for name, bit in FLAGS.items()},
    )


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


def material_facts(material: Float[np.ndarray, "p 2"] | None) -> tuple[float, tuple[float, float]]:
    """The share of metal, and the range of the specular level of what is none."""
    metal = material is not None and material[:, 1] > 0
    level = PAINT[:1] if material is None or np.all(metal) else material[~metal, 0]
    return float(np.mean(metal)), (float(np.min(level)), float(np.max(level)))


def surface_of(
    mask: Bool[np.ndarray, "h w"],
    maps: SolvedMaps,
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
        image(mask, maps.residual_scale * model_error),
        image(mask, maps.flags).astype(np.uint8),
        None if material is None else image(mask, material),
    )
