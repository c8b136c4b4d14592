"""The passes of a surface solve: each takes what is known and returns more.

A pass reads the `Scene`, which never changes, and an `Estimate`; `schedule.py` says in which order they run. Camera frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface.data import initial_maps
from engine.surface.data.scene import Scene
from engine.surface.estimate import Estimate
from engine.surface.lighting.distance_search import coarse_directions, coarse_distance_search
from engine.surface.lighting.emitter_groups import CLIPPED, UNSEEN
from engine.surface.lighting.exposure_offset import exposure_offset_of
from engine.surface.lighting.light_calibration import (
    calibrate,
    calibrate_with_distance,
    light_variance,
    prior_light,
    split_groups,
)  # fmt: skip
from engine.surface.lighting.probe_density import choose_direction_count, choose_probe_grid
from engine.surface.lighting.room_light import gather_grouped_light, gather_incident_light
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.material import classify, kind, same
from engine.surface.optimize.pixel_sample import (
    PixelSample,
    calibration_pixels,
    interior,
    random_subset,
    sample_pixels,
)  # fmt: skip
from engine.surface.optimize.roughness_prior import apply_roughness_prior
from engine.surface.optimize.spatial_regularization import regularize_spatially
from engine.surface.rendering.object_pixels import (
    depth_from_normals,
    geometry_with_visibility,
    search_initial_normals,
)  # fmt: skip
from engine.surface.rendering.transport import pixel_blocks, probe_grid_around
from engine.surface.uncertainty.standard_errors import LightVariance
from engine.types import Emitters

Pass = Callable[[Scene, Estimate, Progress], Estimate]


@dataclass(frozen=True, slots=True)
class PassesConfig:
    """Margins: so many times nearer and farther than the object the probes reach.

    Between their layers the light fades over instead of moving, so that wide ones make parallax look weak: the objects of two
    near rooms came out 4 and 6 % too near in them, 2.5 and 1.4 % in tight ones.
    """

    wide_margin: float = 1.3  # as long as the distance is a guess,
    tight_margin: float = 1.1  # and then,
    depth_margin: float = 1.03  # and as soon as there is a depth; for this,
    depth_percentiles: tuple[float, float] = (0.5, 99.5)  # beyond which the rim may say anything
    moved: float = 1.04  # an object that has moved so many times nearer or farther gets others
    wide_probes: int = 2  # along each image axis; the tight lattice has as many as the fine phase
    surprising_gain: float = 5.0  # over the expected, from which a clipped lamp keeps what the search found
    unseen_iterations: int = 3  # coarse ones more, at most, where light comes from where no photograph looked
    calibration_pixels: int = 600  # that calibrate the light,
    calibration_rounds: int = 4  # so often,
    gauss_newton_steps: int = 2  # with so many steps of the pixels each time


CONFIG = PassesConfig()


def search_distance(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The object's distance to a fifth or so unless it is given, with the light that suits it where part of that is open."""
    params = scene.params
    free = params.object_distance <= 0
    if not free and not (
        params.models("light_gains") and np.isin(now.room_light.kind, (CLIPPED, UNSEEN)).any()
    ):
        return now
    first, room, tried, misfit = coarse_distance_search(
        now.object_pixels, now.room_light, now.views, params, scene.seed, progress
    )
    distance = replace(now.distance, tried=tried, misfit=misfit)
    distance = replace(distance, value=first.distance) if free else now.distance
    return replace(
        now,
        room_light=room,
        first_light_parameters=first,
        distance=distance,
        geometry=now.object_pixels.geometry_at_distance(distance.value),
    )


def place_probes(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The light at probes around the object, by groups; again as soon as there is a depth, and where the object has moved."""
    params, picture, distance = scene.params, scene.picture, now.distance.value
    face_px, directions = params.probe_resolution, coarse_directions(params)
    if now.depth is None:
        margin = CONFIG.wide_margin if params.object_distance <= 0 else CONFIG.tight_margin
        near_far = distance / margin, distance * margin
        wide = probe_grid_around(
            picture.camera, picture.mask, near_far, (CONFIG.wide_probes, CONFIG.wide_probes, 2)
        )
        parts = gather_grouped_light(wide, now.room_light, now.views, directions, face_px, progress)
        setting = prior_light(parts, distance)
        surprising = parts.unseen
        if now.first_light_parameters is not None:
            surprising = surprising | parts.clipped & (
                now.first_light_parameters.gain > CONFIG.surprising_gain * setting.gain
            ).any(1)
            setting = replace(
                setting, gain=np.where(surprising[:, None], now.first_light_parameters.gain, setting.gain)
            )
        surprised = params.models("light_gains") and bool(surprising.any())
        return replace(now, grouped_light=parts, light_parameters=setting, lit_by_shading=surprised)
    if now.probe_distance and not outside_probes(distance, now.probe_distance):
        return now
    nearest, farthest = depth_range(now.geometry.points[:, 2])
    near_far = min(nearest, distance / CONFIG.tight_margin), max(farthest, distance * CONFIG.tight_margin)
    there, span = scene.cam_from_world(now.views), progress.part(0, 0.1)
    tight = choose_probe_grid(
        picture.camera, picture.mask, near_far, now.room_light.emitters, there, params, span
    )
    parts = gather_grouped_light(tight, now.room_light, now.views, directions, face_px, progress.part(0.1, 1))
    return replace(now, grouped_light=parts, probe_distance=distance)


def search_normals(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Normals from nothing, or from the maps that were given; again where the light has turned out otherwise."""
    if now.state is not None and not now.search_again:
        return now
    return replace(now, state=_initial_state(scene, now, progress), search_again=False)


def _initial_state(scene: Scene, now: Estimate, progress: Progress) -> gauss_newton.PixelEstimate:
    given = scene.coarse[now.level].initial_maps
    if given is None:
        return search_initial_normals(
            now.compensated_pixels, now.incident, now.geometry, scene.params, progress
        )
    return initial_maps.estimate_from_maps(
        given, now.compensated_pixels, now.incident, now.geometry, scene.params, progress
    )


def solve_pixels(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Gauss-Newton on every pixel, under what the depth says hides the room from it."""
    object_pixels, steps = now.compensated_pixels, scene.params.gauss_newton_steps
    transport = object_pixels.light_transport(now.incident, scene.params, scene.device, now.geometry)
    state = gauss_newton.minimize(
        now.known_state,
        transport,
        now.geometry,
        pixel_blocks(object_pixels.mask),
        object_pixels.observations,
        steps,
        progress,
        reset_scale=True,
    )
    return replace(now, state=state)


def expect_roughness(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Pixels expect the roughness of those that look alike; those far off it are solved a second time from there."""
    object_pixels = now.compensated_pixels
    transport = object_pixels.light_transport(now.incident, scene.params, scene.device, now.geometry)
    state = apply_roughness_prior(
        now.known_state,
        transport,
        now.geometry,
        pixel_blocks(object_pixels.mask),
        object_pixels.observations,
        object_pixels.mask,
        scene.params.gauss_newton_steps,
        progress,
    )
    return replace(now, state=state)


def detect_metal(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """What is metal, which is plain at once; in the first iteration."""
    return now if now.residuals else _update_material(scene, now, False, progress)


def classify_material(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """What is metal, and how much the rest mirrors, which asks for the light as it is settled."""
    return _update_material(scene, now, bool(now.residuals), progress)


def _update_material(scene: Scene, now: Estimate, settled: bool, progress: Progress) -> Estimate:
    """What the object turns out to be made of, and its surface as that; the same where nothing else turns out."""
    object_pixels, span = now.compensated_pixels, progress.part(0, 0.3)
    made = classify(
        object_pixels, now.known_state, now.incident, now.geometry, settled, scene.params, scene.seed, span
    )
    if same(made, object_pixels.material):
        return now
    turned = kind(made, object_pixels) != kind(object_pixels.material, object_pixels)
    now = now.with_material(made)
    if turned.any():
        anew = _initial_state(scene, now, progress.part(0.3, 0.5))
        now = replace(now, state=gauss_newton.where(turned, anew, now.known_state))
    now = solve_pixels(scene, now, progress.part(0.5, 0.85))
    return expect_roughness(scene, now, progress.part(0.85, 1))


def integrate_depth(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The depth that the normals tell."""
    return replace(
        now, depth=depth_from_normals(now.object_pixels, now.known_state, now.distance.value, progress)
    )


def trace_visibility(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """What the depth hides of the room from every pixel, and the object's own light instead."""
    directions = now.incident.directions
    return replace(
        now,
        geometry=geometry_with_visibility(
            now.object_pixels, now.known_state, now.known_depth, directions, scene.params, progress
        ),
    )


def split_light(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The brightest parts of the room that no photograph shows, each in several."""
    if not scene.params.models("light_gains"):
        return now
    made = split_groups(now.known_grouped_light, now.known_light_parameters)
    # The first calibration tells what normals could not be sought under.
    again = now.lit_by_shading and (made is not None or len(now.residuals) == 0)
    if made is None:
        return replace(now, search_again=again)
    parts, setting = made
    return replace(
        now,
        grouped_light=parts,
        light_parameters=setting,
        room_light=now.room_light.with_patches_split(parts.patches),
        search_again=again,
    )


def calibrate_light(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The brightness of the light's groups, and the object's distance, by the shading of some pixels."""
    return _calibrated(scene, now, scene.params.object_distance <= 0, progress)


def calibrate_light_in_place(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The same with the object where it is."""
    return _calibrated(scene, now, False, progress)


def _calibrated(scene: Scene, now: Estimate, free: bool, progress: Progress) -> Estimate:
    params = scene.params
    if not (params.models("light_gains") or free):
        return now
    chosen, sample = _calibration_pixels(scene, now)
    setting, voted = calibrate(
        now.known_light_parameters,
        now.known_grouped_light,
        sample,
        now.known_state.part(chosen),
        free,
        params.models("light_gains"),
        CONFIG.calibration_rounds,
        CONFIG.gauss_newton_steps,
        progress,
    )
    return replace(now.with_light_parameters(setting), calibration_pixels=(sample, voted))


def refine_distance(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The distance at which the light that suits it best misfits least."""
    params = scene.params
    if params.object_distance > 0:
        return now
    chosen, sample = _calibration_pixels(scene, now)
    voting = now.known_state.part(chosen)
    setting = calibrate_with_distance(
        now.known_light_parameters,
        now.known_grouped_light,
        sample,
        voting,
        params.models("light_gains"),
        CONFIG.calibration_rounds // 2,
        CONFIG.gauss_newton_steps,
        progress,
    )
    stderr = setting.distance_stderr * setting.distance
    now = now.with_light_parameters(setting)
    return replace(now, distance=replace(now.distance, stderr=stderr))


def _calibration_pixels(scene: Scene, now: Estimate) -> tuple[Int[np.ndarray, " p"], PixelSample]:
    return calibration_pixels(
        now.object_pixels, now.geometry, now.distance.value, CONFIG.calibration_pixels, scene.params, scene.seed,
        spread=now.known_state.residual_scale, light=now.incident,
    )  # fmt: skip


def estimate_light_variance(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """What the calibration leaves open of the light, as variances of other pixels' unknowns."""
    if not scene.params.models("light_gains") or now.calibration_pixels is None:
        return now
    object_pixels, light = now.object_pixels, now.incident
    some = random_subset(interior(object_pixels), CONFIG.calibration_pixels, scene.seed + 1)
    others = (
        sample_pixels(object_pixels, now.geometry, now.distance.value, some, scene.params, light=light),
        now.known_state.part(some),
    )
    variance = light_variance(
        now.known_light_parameters, now.known_grouped_light, now.calibration_pixels, others
    )
    return replace(now, light_variance=LightVariance(others[1].normals, variance))


def gather_light(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The settled light in all views, in as many directions as the surface asks for; from here on the pixels are seen in all."""
    params, placed = scene.params, now.known_light_parameters
    views, count = np.concatenate([scene.fitted, scene.validation]), len(scene.fitted)
    emitters, there = emitters_of(now), scene.cam_from_world(views)
    directions = params.directions or choose_direction_count(
        now.known_state, now.geometry, emitters, there, params, progress.part(0, 0.1)
    )
    span = progress.part(0.1, 1)
    alike = len(now.known_grouped_light.incident.directions) == directions
    if alike and now.probe_distance and not outside_probes(now.distance.value, now.probe_distance):
        # What the coarse phases have gathered already, and the rest.
        lattice, known = now.known_grouped_light.incident.probe_grid, now.views
    else:
        near_far, known = depth_range(now.known_depth[now.object_pixels.mask]), views[:0]
        camera, mask = now.object_pixels.camera, now.object_pixels.mask
        lattice = choose_probe_grid(camera, mask, near_far, emitters, there, params, span.part(0, 0.1))
    rest = np.setdiff1d(views, known)
    cam_from_world = scene.cam_from_world(rest)
    light = gather_incident_light(
        lattice, emitters, cam_from_world, directions, params.probe_resolution, span
    )
    if len(known):
        light, rest = now.incident.beside(light), np.concatenate([known, rest])
    order = np.argsort(rest)
    light = light.views(order[np.searchsorted(rest[order], views)])
    picture = scene.at(now.level)
    object_pixels = picture.pixels(scene.fitted, params)
    offset = np.zeros(len(scene.poses.registered))
    offset[now.views] = placed.exposure_offset
    offset = offset[scene.fitted]
    object_pixels = replace(object_pixels, material=now.object_pixels.material)
    return replace(
        now, picture=picture, object_pixels=object_pixels.with_exposure_compensated(offset), views=scene.fitted, exposure_offset=offset,
        light=light.views(np.arange(count)), validation=light.views(np.arange(count, len(views))),
        coarse_state=now.known_state, halved_state=now.halved_state or now.known_state,
    )  # fmt: skip


def estimate_exposure(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """How far the exposure of the views is off that did not serve before, where exposures may waver."""
    if not now.room_light.exposure_sigma or now.exposure_offset is None:
        return now
    object_pixels = now.object_pixels
    transport = object_pixels.light_transport(now.incident, scene.params, scene.device, now.geometry)
    left = exposure_offset_of(now.known_state, transport, now.geometry, object_pixels)
    settled = np.isin(scene.fitted, scene.coarse_views)
    # Settled views stay, and with them the scale.
    left = np.where(settled, 0, left - left[settled if settled.any() else slice(None)].mean())
    return replace(
        now,
        object_pixels=object_pixels.with_exposure_compensated(left),
        exposure_offset=now.exposure_offset + left,
    )


def regularize(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Neighbours decide what a pixel's photographs leave open."""
    return replace(now, state=regularize_spatially(now.known_state, now.object_pixels.mask), regularized=True)


def emitters_of(now: Estimate) -> Emitters:
    """The room's emitters under the calibration."""
    placed = now.known_light_parameters
    return now.room_light.with_gains(placed.gain[:-1], now.known_grouped_light.lamp_shift(placed.lamp_offset))


def depth_range(z: Float[np.ndarray, " p"]) -> tuple[float, float]:
    """z of the first and the last layer of probes around points so far away."""
    nearest, farthest = np.percentile(z, CONFIG.depth_percentiles)
    return float(nearest / CONFIG.depth_margin), float(farthest * CONFIG.depth_margin)


def outside_probes(distance: float, middle: float) -> bool:
    """Whether an object has moved too far from where its probes were put."""
    return not 1 / CONFIG.moved < distance / middle < CONFIG.moved
