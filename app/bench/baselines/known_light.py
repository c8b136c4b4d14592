"""Baselines that know the light as ours does but use less of it: as if far away, to second order, or without highlights.

They take the light as the stage *light* found it: how bright its parts are is not refined by the object's shading,
which is our solver's; of a lamp that every photograph shows clipped they know the lower bound. Where a row is to
differ from ours in nothing else, give them the light and the distance that ours found. All registered views are
fitted. Camera frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from app.bench.baselines.flat import HarmonicRows, panoramas, projected
from app.bench.baselines.matt import Matt, answered, matt_start, refined, seen_object
from engine.progress import Progress
from engine.surface.lighting.distance_search import coarse_distance_search
from engine.surface.lighting.probe_density import choose_probe_grid
from engine.surface.lighting.room_light import build_room_light, gather_incident_light
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem, minimize
from engine.surface.optimize.roughness_prior import apply_roughness_prior
from engine.surface.params import Diffuse, SurfaceParams
from engine.surface.rendering.object_pixels import (
    ObjectPixels,
    depth_from_normals,
    geometry_with_visibility,
    search_initial_normals,
)
from engine.surface.rendering.transport import IncidentLight, SurfaceGeometry, pixel_blocks
from engine.types import CapturedScene, Emitters, Poses, Surface

DEPTH_MARGIN = 0.2
"""How much nearer and farther than the object's distance the probes reach, its depth not being known."""


@dataclass(frozen=True, slots=True)
class KnownLightParams:
    """What the person may ask of a baseline that knows the light."""

    object_distance: float = 0.0  # camera to object along z, scene units; 0 = our solver's first look
    directions: int = 1024  # cells on the sphere of incident directions
    probe_face_px: int = 48  # resolution of one face of each probe's cube
    candidates: int = 300  # normals tried by the global search
    passes: int = 6  # Gauss-Newton evaluations in each round
    rounds: int = 3  # solve, integrate, see: how often; nothing is hidden in the first
    visibility: bool = True  # let the object shadow and light itself; second order knows no shadows
    model_error: float = 0.02  # relative misfit expected of a good model

    def ours(self, diffuse: Diffuse) -> SurfaceParams:
        """The same for the parts of our solver, with nothing refined of the light."""
        return SurfaceParams(
            directions=self.directions,
            probe_resolution=self.probe_face_px,
            normal_candidates=self.candidates,
            gauss_newton_steps=self.passes,
            diffuse=diffuse,
            without=("light_gains", *(() if self.visibility else ("self_shadowing", "interreflections"))),
            model_error=self.model_error,
            validation_views=0,
            object_distance=self.object_distance,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The object in all registered views, the room around it, and how far away it is along z."""

    object_pixels: ObjectPixels
    views: Int[np.ndarray, " n"]
    emitters: Emitters
    poses: Poses
    distance: float


Solved = tuple[PixelEstimate, Float[np.ndarray, "h w"]]  # and its depth
Method = Callable[[Scene, KnownLightParams, SurfaceParams, str, Progress], Surface]


def on_stages(diffuse: Diffuse) -> Callable[[Method], Callable[..., Surface]]:
    """Makes a method on a scene one on what the stages left: it takes what `surface/solve.py:solve` takes.

    Raises (the method): SurfaceError: too few views, an empty mask, or light gains of another light.
    """

    def made(method: Method) -> Callable[..., Surface]:
        def solve(
            captured: CapturedScene, params: KnownLightParams, device: str, seed: int, progress: Progress
        ) -> Surface:
            ours = params.ours(diffuse)
            scene = _scene(captured, params, ours, seed, progress.part(0, 0.2))
            return method(scene, params, ours, device, progress.part(0.2, 1))

        return solve

    return made


@on_stages(diffuse="disney")
def far_field(
    scene: Scene, params: KnownLightParams, ours: SurfaceParams, device: str, progress: Progress
) -> Surface:
    """Our solver under a panorama for each view, taken at the object's place: no parallax over the object."""
    return _under_panoramas(scene, _place(scene), params, ours, device, progress)


@on_stages(diffuse="disney")
def one_panorama(
    scene: Scene, params: KnownLightParams, ours: SurfaceParams, device: str, progress: Progress
) -> Surface:
    """Our solver under one panorama, taken in the middle of all cameras, that only turns from view to view."""
    return _under_panoramas(scene, None, params, ours, device, progress)


@on_stages(diffuse="lambert")
def harmonics(
    scene: Scene, params: KnownLightParams, ours: SurfaceParams, device: str, progress: Progress
) -> Surface:
    """Lambert under nine harmonics, per view and channel, of the panorama at the object's place; no shadows.

    Runs on the CPU whatever the device: its rows are nine numbers long.
    """
    light = panoramas(
        scene.emitters,
        scene.poses,
        scene.views,
        _place(scene),
        params.directions,
        params.probe_face_px,
        progress.part(0, 0.25),
    )
    object_pixels, rows = scene.object_pixels, HarmonicRows(projected(light.directions, light.energy[0]))
    geometry = object_pixels.geometry_at(scene.distance)
    problem = PixelProblem(rows, geometry, pixel_blocks(object_pixels.mask), object_pixels.observations)
    state = matt_start(object_pixels, problem, params.candidates, progress.part(0.25, 0.5))
    state = refined(state, problem, params.passes, progress.part(0.5, 0.95))
    depth = depth_from_normals(object_pixels, state, scene.distance, progress.part(0.95, 1))
    return answered(object_pixels, state, geometry, depth, params.model_error)


@on_stages(diffuse="lambert")
def lambert(
    scene: Scene, params: KnownLightParams, ours: SurfaceParams, device: str, progress: Progress
) -> Surface:
    """Lambert under our near-field light, with shadows and bounced light but without highlights."""
    object_pixels, z = scene.object_pixels, scene.distance
    near_far, there = (
        (z * (1 - DEPTH_MARGIN), z * (1 + DEPTH_MARGIN)),
        scene.poses.cam_from_world[scene.views],
    )
    lattice = choose_probe_grid(
        object_pixels.camera,
        object_pixels.mask,
        near_far,
        scene.emitters,
        there,
        ours,
        progress.part(0, 0.05),
    )
    light = gather_incident_light(
        lattice, scene.emitters, there, params.directions, params.probe_face_px, progress.part(0.05, 0.25)
    )

    def under(geometry: SurfaceGeometry) -> PixelProblem:
        problem = object_pixels.problem(light, geometry, ours, device)
        return replace(problem, transport=Matt(problem.transport))

    flat = under(object_pixels.geometry_at(z))
    state = matt_start(object_pixels, flat, params.candidates, progress.part(0.25, 0.4))

    def solved(state: PixelEstimate, geometry: SurfaceGeometry, progress: Progress) -> Solved:
        state = refined(state, under(geometry), params.passes, progress.part(0, 0.9))
        return state, depth_from_normals(object_pixels, state, z, progress.part(0.9, 1))

    state, geometry, depth = _in_turns(
        scene, state, solved, light.directions, ours, params.rounds, progress.part(0.4, 1)
    )
    return answered(object_pixels, state, geometry, depth, params.model_error)


def _scene(captured, params, ours, seed, progress) -> Scene:
    object_pixels, views = seen_object(captured, ours)
    room, distance = build_room_light(captured, ours, seed), params.object_distance
    if distance <= 0:
        found = coarse_distance_search(object_pixels, room, views, ours, seed, progress)
        distance = found.light_parameters.distance
    return Scene(object_pixels, views, room.emitters, captured.poses, distance)


def _place(scene: Scene) -> Float[np.ndarray, " 3"]:
    """The middle of the object, as if it were flat."""
    return scene.object_pixels.geometry_at(scene.distance).points.mean(0)


def _under_panoramas(scene, point, params, ours, device, progress) -> Surface:
    object_pixels = scene.object_pixels
    light = panoramas(
        scene.emitters,
        scene.poses,
        scene.views,
        point,
        params.directions,
        params.probe_face_px,
        progress.part(0, 0.2),
    )
    state = search_initial_normals(
        object_pixels,
        light,
        object_pixels.geometry_at(scene.distance),
        ours,
        progress.part(0.2, 0.3),
    )

    def solved(state: PixelEstimate, geometry: SurfaceGeometry, progress: Progress) -> Solved:
        state = solve_and_expect_roughness(
            object_pixels, state, light, geometry, ours, device, progress.part(0, 0.9)
        )
        return state, depth_from_normals(object_pixels, state, scene.distance, progress.part(0.9, 1))

    state, geometry, depth = _in_turns(
        scene, state, solved, light.directions, ours, params.rounds, progress.part(0.3, 1)
    )
    return answered(object_pixels, state, geometry, depth, params.model_error)


def solve_and_expect_roughness(
    object_pixels: ObjectPixels,
    state: PixelEstimate,
    light: IncidentLight,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
    device: str,
    progress: Progress,
) -> PixelEstimate:
    """The passes `solve_pixels` and `expect_roughness` of our solver, of pixels that no scene knows."""
    problem, steps = object_pixels.problem(light, geometry, params, device), params.gauss_newton_steps
    state = minimize(state, problem, steps, progress.part(0, 0.7), reset_scale=True)
    return apply_roughness_prior(state, problem, object_pixels.mask, steps, progress.part(0.7, 1))


def _in_turns(
    scene: Scene,
    state: PixelEstimate,
    solved: Callable[[PixelEstimate, SurfaceGeometry, Progress], Solved],
    directions: Float[np.ndarray, "d 3"],
    ours: SurfaceParams,
    rounds: int,
    progress: Progress,
) -> tuple[PixelEstimate, SurfaceGeometry, Float[np.ndarray, "h w"]]:
    """The pixels in turns with the depth, which says where the points are and what hides the room from them."""
    object_pixels, z = scene.object_pixels, scene.distance
    geometry = object_pixels.geometry_at(z)
    depth = depth_from_normals(object_pixels, state, z, progress.part(0, 0.05))
    for turn in range(rounds):
        span = progress.part(0.05 + 0.95 * turn / rounds, 0.05 + 0.95 * (turn + 1) / rounds)
        if turn:
            geometry = geometry_with_visibility(
                object_pixels, state, depth, directions, ours, span.part(0, 0.2)
            )
        state, depth = solved(state, geometry, span.part(0.2, 1))
    return state, geometry, depth
