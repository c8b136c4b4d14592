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
from engine.surface.depth import part_offsets
from engine.surface.estimate import Estimate, known
from engine.surface.lighting import light_calibration
from engine.surface.lighting.distance_search import coarse_directions, coarse_distance_search
from engine.surface.lighting.emitter_groups import CLIPPED, UNSEEN
from engine.surface.lighting.exposure_offset import exposure_offset_of
from engine.surface.lighting.probe_density import choose_direction_count, choose_probe_grid
from engine.surface.lighting.room_light import gather_grouped_light, gather_incident_light
from engine.surface.optimize import pixel_sample
from engine.surface.optimize.gauss_newton import PixelEstimate, minimize, where
from engine.surface.optimize.material import classify, kind, same
from engine.surface.optimize.roughness_prior import apply_roughness_prior
from engine.surface.optimize.spatial_regularization import regularize_spatially
from engine.surface.rendering.object_pixels import (
    depth_from_normals,
    geometry_with_visibility,
    search_initial_normals,
)  # fmt: skip
from engine.surface.rendering.transport import probe_grid_around
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
    changed_light: float = 0.1  # share of it in other groups since normals were sought: they are again
    unseen_iterations: int = 3  # coarse ones more, at most, where light comes from where no photograph looked
    calibration_pixels: int = 600  # that calibrate the light


CONFIG = PassesConfig()


def search_distance(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The object's distance to a fifth or so unless it is given, with the light that suits it where part of that is open."""
    params = scene.params
    free = params.object_distance <= 0
    if not free and not (
        params.models("light_gains") and np.isin(now.room_light.kind, (CLIPPED, UNSEEN)).any()
    ):
        return now
    found = coarse_distance_search(now.object_pixels, now.room_light, now.views, params, scene.seed, progress)
    distance = now.distance
    if free:
        value = found.light_parameters.distance
        distance = replace(distance, value=value, tried=found.distances, misfit=found.misfits)
    return replace(
        now, room_light=now.room_light.with_patches_split(found.grouped_light.patches),
        first_light_parameters=found.light_parameters, distance=distance,
        geometry=now.object_pixels.geometry_at(distance.value),
    )  # fmt: skip


def place_probes(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The light at probes around the object, by groups; again as soon as there is a depth, and where the object has moved."""
    params, picture, distance = scene.params, scene.picture, now.distance.value
    face_px, directions = params.probe_resolution, coarse_directions(params)
    if now.depth is None and now.grouped_light is not None:
        return now
    if now.depth is None:
        margin = CONFIG.wide_margin if params.object_distance <= 0 else CONFIG.tight_margin
        near_far, few = (distance / margin, distance * margin), CONFIG.wide_probes
        wide = probe_grid_around(picture.camera, picture.mask, near_far, (few, few, 2))
        parts = gather_grouped_light(wide, now.room_light, now.views, directions, face_px, progress)
        setting, first = light_calibration.prior_light(parts, distance), now.first_light_parameters
        if first is not None:
            asked = (parts.unseen | parts.clipped)[:, None]
            setting = replace(setting, gain=np.where(asked, first.gain, setting.gain))
        return replace(now, grouped_light=parts, light_parameters=setting)
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
    """Normals from nothing, or from the maps that were given; again where the light has turned out
    otherwise: divided into more groups, or shared out among them differently."""
    shares = known(now.grouped_light).shares(known(now.light_parameters).gain)
    before = now.searched_shares
    alike = len(before) == len(shares) and np.abs(shares - before).sum() / 2 <= CONFIG.changed_light
    if now.state is not None and alike:
        return now
    return replace(now, state=_initial_state(scene, now, progress), searched_shares=tuple(shares))


def _initial_state(scene: Scene, now: Estimate, progress: Progress) -> PixelEstimate:
    given = scene.coarse[now.level].initial_maps
    if given is not None:
        return initial_maps.estimate_from_maps(given, now.problem(scene), progress)
    return search_initial_normals(now.compensated_pixels, now.incident, now.geometry, scene.params, progress)


def solve_pixels(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Gauss-Newton on every pixel, under what the depth says hides the room from it."""
    steps = scene.params.gauss_newton_steps
    return replace(
        now, state=minimize(known(now.state), now.problem(scene), steps, progress, reset_scale=True)
    )


def expect_roughness(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Pixels expect the roughness of those that look alike; those far off it are solved a second time from there."""
    mask, steps = now.object_pixels.mask, scene.params.gauss_newton_steps
    return replace(
        now, state=apply_roughness_prior(known(now.state), now.problem(scene), mask, steps, progress)
    )


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
        object_pixels, known(now.state), now.incident, now.geometry, settled, scene.params, scene.seed, span
    )
    if same(made, object_pixels.material):
        return now
    turned = kind(made, object_pixels) != kind(object_pixels.material, object_pixels)
    now = now.with_material(made)
    if turned.any():
        anew = _initial_state(scene, now, progress.part(0.3, 0.5))
        now = replace(now, state=where(turned, anew, known(now.state)))
    now = solve_pixels(scene, now, progress.part(0.5, 0.85))
    return expect_roughness(scene, now, progress.part(0.85, 1))


def integrate_depth(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The depth that the normals tell, its parts drawn together."""
    depth = depth_from_normals(now.object_pixels, known(now.state), now.distance.value, progress)
    return replace(now, depth=depth)


def place_parts(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The depth that the normals tell, and how far its parts stand behind one another by what they hide of the room."""
    parts, pixels = now.depth_parts(progress.part(0, 0.2)), now.compensated_pixels
    if len(parts.offset) > 1 and scene.params.models("self_shadowing"):
        likelihood = part_offsets.likelihood_of(pixels, known(now.state), now.incident, scene.params)
        parts = part_offsets.place(parts, likelihood, scene.seed, progress.part(0.2, 1))
    return now.with_parts(parts)


def trace_visibility(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """What the depth hides of the room from every pixel, and the object's own light instead."""
    geometry = geometry_with_visibility(
        now.object_pixels, known(now.state), known(now.depth), now.incident.directions, scene.params, progress
    )
    return replace(now, geometry=geometry)


def split_light(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The brightest parts of the room that no photograph shows, each in several."""
    if not scene.params.models("light_gains"):
        return now
    made = light_calibration.split_groups(known(now.grouped_light), known(now.light_parameters))
    if made is None:
        return now
    parts, setting = made
    room = now.room_light.with_patches_split(parts.patches)
    return replace(now, grouped_light=parts, light_parameters=setting, room_light=room)


def calibrate_light(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The brightness of the light's groups, and the object's distance, by the shading of some pixels."""
    return _calibrated(scene, now, scene.params.object_distance <= 0, progress)


def calibrate_light_in_place(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The same with the object where it is."""
    return _calibrated(scene, now, False, progress)


def _calibrated(scene: Scene, now: Estimate, free: bool, progress: Progress) -> Estimate:
    gains = scene.params.models("light_gains")
    if not (gains or free):
        return now
    sample, state = _calibration_pixels(scene, now)
    setting, voted = light_calibration.calibrate(
        known(now.light_parameters), known(now.grouped_light), sample, state, free, gains, progress
    )
    return replace(now.with_light_parameters(setting), calibration_pixels=(sample, voted))


def refine_distance(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The distance at which the light that suits it best misfits least."""
    params = scene.params
    if params.object_distance > 0:
        return now
    config = replace(light_calibration.CONFIG, rounds=light_calibration.CONFIG.rounds // 2)
    setting = light_calibration.calibrate_with_distance(
        known(now.light_parameters), known(now.grouped_light), *_calibration_pixels(scene, now),
        params.models("light_gains"), progress, config,
    )  # fmt: skip
    now = now.with_light_parameters(setting)
    stderr = setting.distance_stderr * setting.distance
    return replace(now, distance=replace(now.distance, stderr=stderr))


def _calibration_pixels(scene: Scene, now: Estimate) -> tuple[pixel_sample.PixelSample, PixelEstimate]:
    some = pixel_sample.well_explained(
        pixel_sample.interior(now.object_pixels), known(now.state).residual_scale
    )
    return _sampled(scene, now, pixel_sample.random_subset(some, CONFIG.calibration_pixels, scene.seed))


def _sampled(
    scene: Scene, now: Estimate, some: Int[np.ndarray, " p"]
) -> tuple[pixel_sample.PixelSample, PixelEstimate]:
    sample = pixel_sample.sample_pixels(
        now.object_pixels, now.geometry, now.distance.value, some, scene.params, light=now.incident
    )
    return sample, known(now.state).part(some)


def estimate_light_variance(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """What the calibration leaves open of the light, as variances of other pixels' unknowns."""
    if not scene.params.models("light_gains") or now.calibration_pixels is None:
        return now
    some = pixel_sample.random_subset(
        pixel_sample.interior(now.object_pixels), CONFIG.calibration_pixels, scene.seed + 1
    )
    others = _sampled(scene, now, some)
    variance = light_calibration.light_variance(
        known(now.light_parameters), known(now.grouped_light), now.calibration_pixels, others
    )
    return replace(now, light_variance=LightVariance(others[1].normals, variance))


def gather_light(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """The settled light in all views, in as many directions as the surface asks for; from here on the pixels are seen in all."""
    params, placed = scene.params, known(now.light_parameters)
    views, count = np.concatenate([scene.fitted, scene.validation]), len(scene.fitted)
    emitters, there = emitters_of(now), scene.cam_from_world(views)
    directions = params.directions or choose_direction_count(
        known(now.state), now.geometry, emitters, there, params, progress.part(0, 0.1)
    )
    span = progress.part(0.1, 1)
    alike = len(known(now.grouped_light).incident.directions) == directions
    if alike and now.probe_distance and not outside_probes(now.distance.value, now.probe_distance):
        # What the coarse phases have gathered already, and the rest.
        lattice, gathered = known(now.grouped_light).incident.probe_grid, now.views
    else:
        near_far, gathered = depth_range(known(now.depth)[now.object_pixels.mask]), views[:0]
        camera, mask = now.object_pixels.camera, now.object_pixels.mask
        lattice = choose_probe_grid(camera, mask, near_far, emitters, there, params, span.part(0, 0.1))
    rest, face_px = np.setdiff1d(views, gathered), params.probe_resolution
    light = gather_incident_light(lattice, emitters, scene.cam_from_world(rest), directions, face_px, span)
    if len(gathered):
        light, rest = now.incident.beside(light), np.concatenate([gathered, rest])
    order = np.argsort(rest)
    light = light.views(order[np.searchsorted(rest[order], views)])
    picture, offset = scene.at(now.level), np.zeros(len(scene.poses.registered))
    offset[now.views] = placed.exposure_offset
    offset = offset[scene.fitted]
    object_pixels = picture.pixels(scene.fitted, params).with_exposure_compensated(offset)
    return replace(
        now, picture=picture, object_pixels=replace(object_pixels, material=now.object_pixels.material), views=scene.fitted, exposure_offset=offset,
        light=light.views(np.arange(count)), validation=light.views(np.arange(count, len(views))),
        coarse_state=known(now.state), halved_state=now.halved_state or known(now.state),
    )  # fmt: skip


def estimate_exposure(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """How far the exposure of the views is off that did not serve before, where exposures may waver."""
    if not now.room_light.exposure_sigma or now.exposure_offset is None:
        return now
    left = exposure_offset_of(known(now.state), now.problem(scene))
    settled = np.isin(scene.fitted, scene.coarse_views)
    # Settled views stay, and with them the scale.
    left = np.where(settled, 0, left - left[settled if settled.any() else slice(None)].mean())
    object_pixels = now.object_pixels.with_exposure_compensated(left)
    return replace(now, object_pixels=object_pixels, exposure_offset=now.exposure_offset + left)


def regularize(scene: Scene, now: Estimate, progress: Progress) -> Estimate:
    """Neighbours decide what a pixel's photographs leave open."""
    return replace(
        now, state=regularize_spatially(known(now.state), now.object_pixels.mask), regularized=True
    )


def emitters_of(now: Estimate) -> Emitters:
    """The room's emitters under the calibration."""
    placed = known(now.light_parameters)
    return now.room_light.with_gains(
        placed.gain[:-1], known(now.grouped_light).lamp_shift(placed.lamp_offset)
    )


def depth_range(z: Float[np.ndarray, " p"]) -> tuple[float, float]:
    """z of the first and the last layer of probes around points so far away."""
    nearest, farthest = np.percentile(z, CONFIG.depth_percentiles)
    return float(nearest / CONFIG.depth_margin), float(farthest * CONFIG.depth_margin)


def outside_probes(distance: float, middle: float) -> bool:
    """Whether an object has moved too far from where its probes were put."""
    return not 1 / CONFIG.moved < distance / middle < CONFIG.moved
