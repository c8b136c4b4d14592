"""Stage *surface*: from photographs and the room's light to normals, albedo, roughness, depth, with standard errors.

`schedule.py` says what is done in which order. Some views are kept out of the fit and re-rendered. Of an object too large to
be solved at once, or one that hides nothing of the room from itself, a smaller picture is solved, and then its pixels tile
by tile (`tiled_solve`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from engine.errors import SurfaceError
from engine.progress import Progress
from engine.rerendering import object_shift, rerendering_error
from engine.sampling import held_out
from engine.surface.data import initial_maps
from engine.surface.data.observations import parent_index
from engine.surface.data.scene import Picture, Scene, build_scene, downsample_to, window
from engine.surface.depth.part_offsets import DepthParts
from engine.surface.estimate import Estimate, Iteration, known
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.room_light import RoomLight, build_room_light
from engine.surface.optimize.gauss_newton import medoid
from engine.surface.params import SurfaceParams
from engine.surface.passes import emitters_of
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.object_pixels import image
from engine.surface.schedule import run, schedule
from engine.surface.tiled_solve import SolvedMaps, evaluate_solution, solve_tiles
from engine.surface.uncertainty.model_parts import PartWorth, part_worths
from engine.surface.uncertainty.standard_errors import FLAGS, unresolved_variance
from engine.types import CapturedScene, SolvedScene, Surface, ValidationRenders


@dataclass(frozen=True, slots=True)
class SurfaceReport:
    """Facts of one solve, fit for JSON."""

    pixels: int
    together: int  # pixels of the picture that was solved at once; if fewer, the rest followed in tiles
    fitted_views: int
    held_out_views: tuple[int, ...]
    held_out_error: float  # median relative error of the re-rendered radiance
    object_shift_px: float  # that the object stands apart in two views kept out, at least
    residual: float  # median weighted residual spread
    distance: Distance
    probe_reach: tuple[float, float]  # z of the nearest and the farthest layer of probes
    probes: tuple[int, int, int]  # along each axis of their lattice
    directions: int  # of light
    light_gains: tuple[tuple[float, ...], ...]  # per group and channel; without refinement the belief
    metal: float  # share of the pixels that are taken for metal
    unseen_light: float  # share of the light on the object that no photograph shows, under those gains
    exposure_drift: tuple[float, ...]  # of every frame's log exposure; 0 of those that were not fitted
    history: tuple[Iteration, ...]  # what ran, in order, and what it did
    stderr_normal_deg: float  # median
    flagged: dict[str, int]
    depth_parts: tuple[float, ...]  # shares of the pixels of `Surface.part`s, the largest first
    part_stderr_px: tuple[float, ...]  # of where each stands beside the others, widths of a pixel
    part_worths: tuple[PartWorth, ...]  # what the parts of the model are worth to the views kept out


def solve(
    captured: CapturedScene, params: SurfaceParams, device: str, seed: int, progress: Progress, flip: int = 0
) -> SolvedScene:
    """Solve the surface; `seed` picks the pixels that calibrate the light, start maps are of the upright picture, turned
    by `flip`.

    Raises:
        SurfaceError: too few views, an empty mask, frames without usable object pixels, start maps that cannot be
            read or do not fit, or a device with too little memory.
    """
    frames, mask, poses = captured.frames, captured.masks.object, captured.poses
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    fitted, kept_out = held_out(poses.registered, params.validation_views)
    start = initial_maps.requested(params, mask, flip)
    whole = Picture(frames, mask, poses.camera, start).part(*window(mask))
    picture, take = downsample_to(whole, params.tile_above_pixels)
    scene = build_scene(
        picture, replace(poses, camera=picture.camera), fitted, kept_out, params, device, seed
    )
    alone = 0.9 if picture is whole else 0.3
    found = settle(scene, captured, progress.part(0, alone))
    if found.level:
        take = parent_index(known(found.picture).mask, picture.mask)[take]
    span = progress.part(alone, 1)
    if found.level == 0 and picture is whole:
        maps, parts = evaluate_solution(scene, found, span), known(found.parts)
    else:
        maps, parts = solve_tiles(scene, whole, take, found, span)
    edges = unresolved_variance(image(mask, maps.normals), mask, image(mask, maps.stderr_normal))[mask]
    maps = replace(maps, stderr_normal=np.minimum(np.sqrt(maps.stderr_normal**2 + edges), np.pi / 2))
    material = of_pixels(found.object_pixels.material, take)
    z = parts.placed[whole.mask]
    surface = replace(
        surface_of(mask, maps, z, params.model_error, material),
        part=image(mask, parts.together.part[whole.mask]).astype(np.int16),
        stderr_part=image(mask, parts.told[whole.mask][:, 1] * z * (len(parts.offset) > 1)),
    )
    pictures = np.zeros((len(kept_out), *mask.shape, 3), np.float32)
    pictures[:, mask] = maps.pictures.transpose(1, 0, 2)
    renders = ValidationRenders(kept_out, pictures)
    error, shift = rerendering_error(frames, renders, mask), object_shift(frames, renders, mask)
    report = report_of(scene, found, maps, material, parts, error, shift)
    return SolvedScene(surface, renders, emitters_of(found), report)


def settle(scene: Scene, captured: CapturedScene, progress: Progress) -> Estimate:
    """The end of all phases. Of several solves, which calibrate the light by other pixels and end a little elsewhere each, it is
    the first with the medoid of their states, solved once more."""

    def once(seed: int, span: Progress) -> Estimate:
        room = build_room_light(captured, scene.params, seed)
        phases = schedule(scene.params, room.emitters.patches > 0)
        return run(replace(scene, seed=seed), initial_state(scene, room), phases, span)

    if scene.params.solves == 1:
        return once(scene.seed, progress)
    *spans, last = progress.parts(scene.params.solves + 1)
    first = once(scene.seed, spans[0])
    others = (once(seed, span) for seed, span in enumerate(spans[1:], scene.seed + 1))
    states = [known(first.state), *(known(end.state) for end in others if end.level == first.level)]
    after = [phase for phase in schedule(scene.params, False) if phase.name in ("fine", "finish")]
    return run(scene, replace(first, state=medoid(states)), after, last)


def initial_state(scene: Scene, room: RoomLight) -> Estimate:
    """What is known before the first pass: where the object's pixels look."""
    given, views = scene.params.object_distance, scene.coarse_views
    pixels = scene.coarse[-1].pixels(np.arange(len(views)), scene.params)
    distance = Distance(given, 0.0, "given" if given > 0 else "light")
    room = replace(room, poses=scene.poses)
    return Estimate(scene.smallest, views, pixels, room, distance, pixels.geometry_at(given or 1.0))


def report_of(
    scene: Scene,
    found: Estimate,
    maps: SolvedMaps,
    material: Float[np.ndarray, "p 2"] | None,
    parts: DepthParts,
    error: float,
    shift: float,
) -> SurfaceReport:
    """The facts of a solve; `error` and `shift` are those of the views kept out."""
    lattice, drift = found.incident.probe_grid, np.zeros(len(scene.picture.frames.names))
    drift[scene.fitted] = known(found.exposure_offset)
    metal = np.zeros(1, bool) if material is None else material[:, 1] > 0
    placed = known(found.light_parameters)
    return SurfaceReport(
        pixels=len(maps.normals),
        together=int(known(found.picture).mask.sum()),
        fitted_views=len(scene.fitted),
        held_out_views=tuple(map(int, scene.validation)),
        held_out_error=error,
        object_shift_px=shift,
        residual=float(np.median(maps.residual_scale)),
        distance=found.distance,
        probe_reach=(float(lattice.low[2]), float(lattice.high[2])),
        probes=lattice.shape,
        directions=len(found.incident.directions),
        light_gains=tuple(tuple(map(float, gain)) for gain in placed.gain),
        metal=float(np.mean(metal)),
        unseen_light=known(found.grouped_light).unseen_share(placed.gain),
        exposure_drift=tuple(map(float, drift)),
        history=found.history,
        stderr_normal_deg=float(np.degrees(np.median(maps.stderr_normal))),
        flagged={name: int((maps.flags & bit > 0).sum()) for name, bit in FLAGS.items()},
        depth_parts=parts.together.shares,
        part_stderr_px=parts.stderr_px,
        part_worths=part_worths(scene, found),
    )


def surface_of(
    mask: Bool[np.ndarray, "h w"],
    maps: SolvedMaps,
    z: Float[np.ndarray, " p"],
    model_error: float,
    material: Float[np.ndarray, "p 2"] | None = None,
) -> Surface:
    """What is known of the mask's pixels as maps."""
    values = (
        maps.normals, maps.albedo, maps.roughness, z, maps.stderr_normal, maps.stderr_albedo, maps.stderr_roughness,
        maps.residual_scale * model_error,
    )  # fmt: skip
    flags, made = image(mask, maps.flags), None if material is None else image(mask, material)
    return Surface(mask, *(image(mask, x) for x in values), flags=flags.astype(np.uint8), material=made)
