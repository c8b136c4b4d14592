"""What the paper's inverse renderer starts from: normals and materials from elsewhere, depth by integration.

Source: the paper, Sec. 4, "Implementation details", which takes a network's normals and roughness. Here they are
those of our own global search under the room's light, or maps of the user's. The paper does not say what albedo
begins with: here with the search's own, or where maps hold none with the middle of its range. Camera frame.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.io import initial_maps
from engine.progress import Progress
from engine.reference.params import ReferenceParams
from engine.sampling import evenly_spaced
from engine.surface import passes
from engine.surface.lighting.distance_search import CONFIG, Distance, coarse_distance_search
from engine.surface.lighting.emitter_groups import UNSEEN
from engine.surface.lighting.room_light import RoomLight, gather_incident_light
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import depth_from_normals, observe_object, search_initial_normals
from engine.surface.rendering.transport import probe_grid_around
from engine.types import Frames

MIDDLE = 0.5
"""Albedo and roughness of which nothing is known."""


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first surface of the mask's pixels, in row order; depth on the grid of the photographs."""

    normals: Float[np.ndarray, "p 3"]
    albedo: Float[np.ndarray, "p 3"]
    roughness: Float[np.ndarray, " p"]
    depth: Float[np.ndarray, "h w"]  # z, scene units
    distance: Distance


def begin(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    room: RoomLight,
    fitted: Int[np.ndarray, " f"],
    params: ReferenceParams,
    device: str,
    seed: int,
    progress: Progress,
    flip: int = 0,
) -> Start:
    """Distance, normals, roughness and albedo, then depth; maps given are of the upright picture, turned by `flip`.

    Raises:
        SurfaceError: the user's maps cannot be read or do not fit the photographs.
    """
    ours = SurfaceParams(diffuse=params.diffuse)
    views = fitted[evenly_spaced(len(fitted), ours.coarse_views)]
    few = frames.views(views)
    who = observe_object(few, mask, room.poses.camera, np.arange(len(views)), ours)
    distance, begun = Distance(params.object_distance, 0.0, "given"), None
    if params.object_distance <= 0:
        found = coarse_distance_search(who, room, views, ours, seed, progress.part(0, 0.5))
        begun, room = found.light_parameters, room.with_patches_split(found.grouped_light.patches)
        distance = Distance(begun.distance, np.nan, "light", found.distances, found.misfits)
    if params.initial_normals:
        maps = initial_maps.read(Path(params.initial_normals), None, params.normals_frame, mask, True, flip)
        count = len(maps.normals)
        albedo = np.full((count, 3), MIDDLE) if maps.albedo is None else maps.albedo
        roughness = np.full(count, MIDDLE) if maps.roughness is None else maps.roughness
        state = gauss_newton.initial_estimate(maps.normals, albedo, roughness)
    else:
        z = distance.value
        margin = passes.CONFIG.tight_margin
        lattice = probe_grid_around(who.camera, mask, (z / margin, z * margin), (2, 2, 2))
        gain = np.ones((len(room.kind), 3))
        if begun is not None:
            unseen = room.kind == UNSEEN
            gain[unseen] = begun.gain[:-1][unseen]
        light = gather_incident_light(
            lattice, room.with_gains(gain), room.poses.cam_from_world[views], CONFIG.directions, ours.probe_resolution,
            progress.part(0.5, 0.7),
        )  # fmt: skip
        state = search_initial_normals(who, light, who.geometry_at(z), ours, progress.part(0.7, 0.9))
    depth = depth_from_normals(who, state, distance.value, progress.part(0.9, 1))
    return Start(state.normals, state.albedo, state.roughness, depth, distance)
