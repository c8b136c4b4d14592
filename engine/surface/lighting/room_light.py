"""The room around the object as the solver reads it: energy at probes, and which emitters it comes from.

Gaussians live in the world frame; probes and directions in the camera frame of each view.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from engine.color import luminance
from engine.geometry import inverse, tangents
from engine.light.fitting.lamp_model import with_lamps, without_lamps
from engine.light.gaussians.gaussians import joined
from engine.light.incident.direction_grid import FACES, deconvolve, face_directions
from engine.light.incident.inpainting import inpaint_energy, neighbourhood
from engine.light.incident.probe_interpolation import interpolate
from engine.light.incident.probes import gather_probes
from engine.light.incident.unseen_patches import DIRECTIONS, unseen_patches
from engine.progress import Progress
from engine.surface.lighting.emitter_groups import (
    CLIPPED,
    FILLED,
    KNOWN,
    UNSEEN,
    EmitterGroupsConfig,
    EnvironmentPatches,
    clipped_shares,
    group_emitters,
    group_patches,
    nearest_emitter,
    scale_groups,
)
from engine.surface.lighting.grouped_light import GroupedLight
from engine.surface.lighting.quadratic_probes import quadratic_probes
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import lobe_floor, rows
from engine.surface.rendering.area_lights import AreaLights, area_lights_of
from engine.surface.rendering.transport import IncidentLight, ProbeGrid, direction_cells
from engine.types import CapturedScene, Emitters, Poses


@dataclass(frozen=True, slots=True)
class RoomLightConfig:
    """The ball that tells how much light matters is glossy, for highlights move most.

    Shutters and flicker make a few hundredths of a view's exposure, sky that comes in through windows and is taken for a light in
    the pane a tenth. Pixels tell a view's to a few permille, so that its prior decides little; with 0.01 the joint step stopped at
    58 % of a drift of 3 %, where the prior outweighed what was left.
    """

    ball_normals: int = 96  # all around it; those that face the camera
    ball_facing: float = 0.2  # by this cosine count
    ball_albedo: float = 0.3
    ball_roughness: float = 0.4
    many_probes: int = 1000  # of all views, whose light is foretold from some of them;
    foretold_error: float = 0.01  # what a ball of it may be off by
    photographed_share: float = 0.5  # of a cell, at least, for its light to count as somebody's
    exposure_sigma: float = 0.1  # spread of the logarithm of a view's exposure that is expected
    lamp_offset_sigma: float = math.radians(0.5)  # of a lamp's direction: three pixels of a small photograph


CONFIG = RoomLightConfig()


@dataclass(frozen=True, slots=True, eq=False)
class RoomLight:
    """The room's light, how its emitters are grouped, and where the camera stood."""

    emitters: Emitters  # as the photographs have them
    poses: Poses
    group: Int[np.ndarray, " k"]  # of every Gaussian of the field; the lamps are the groups after these
    kind: UInt8[np.ndarray, " g"]  # of each group, lamps included: KNOWN, CLIPPED or UNSEEN
    clipped_share: Float[np.ndarray, " g"]  # of each group's light: recorded as a lower bound
    gain_sigma: float  # spread of a known group's log gain
    exposure_sigma: float  # spread of a view's log exposure; 0: none drifts
    lamp_offset_sigma: float  # of the lamps' directions, radians; 0: all stand where they were found

    def patches(self) -> EnvironmentPatches | None:
        """What closes the room where no photograph looked; None where it is closed."""
        count = self.emitters.patches
        if not count:
            return None
        towards = self.emitters.field().means[-count:] - mean_camera_centre(self.poses)
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        return EnvironmentPatches(towards, self.group[-count:], 4 * np.pi / DIRECTIONS)

    def with_patches_split(self, patches: EnvironmentPatches | None) -> "RoomLight":
        """The same with what closes it in other groups."""
        if patches is None:
            return self
        known = len(self.group) - len(patches.group)
        first, last = int(patches.group.min()), int(self.group.max())
        more = int(patches.group.max()) - last
        return replace(
            self,
            group=np.concatenate([self.group[:known], patches.group]),
            kind=np.insert(self.kind, first, np.full(more, UNSEEN, np.uint8)),
            clipped_share=np.insert(self.clipped_share, first, np.zeros(more)),
        )

    def size(self) -> float:
        """Median distance from the cameras to the Gaussians."""
        centres = inverse(self.poses.cam_from_world[self.poses.registered])[..., 3]
        return float(np.median(np.linalg.norm(self.emitters.field().means[None] - centres[:, None], axis=2)))

    def with_gains(
        self, gain: Float[np.ndarray, "g 3"], shift: Float[np.ndarray, "l 3"] | None = None
    ) -> Emitters:
        """The emitters, every group under its gain, every lamp `shift` (world) from where it was."""
        lamps = self.emitters.lamps
        count = len(gain) - len(lamps.radii)
        field = scale_groups(self.emitters.field(), self.group, gain[:count])
        centres = lamps.centres if shift is None else lamps.centres + shift
        lamps = replace(lamps, centres=centres, radiance=lamps.radiance * gain[count:])
        return replace(self.emitters, gaussians=with_lamps(field, lamps), lamps=lamps)


def mean_camera_centre(poses: Poses) -> Float[np.ndarray, " 3"]:
    """The middle of the cameras, world frame."""
    return inverse(poses.cam_from_world[poses.registered])[..., 3].mean(0)


def build_room_light(captured: CapturedScene, params: SurfaceParams, seed: int) -> RoomLight:
    """The room closed, and its emitters grouped: whatever is bright one by one, `light_groups` for the rest, the unseen by
    direction.

    The lamps are taken from the Gaussians, whose last they are.
    """
    poses, lamps, middle = captured.poses, captured.lamps, mean_camera_centre(captured.poses)
    field = without_lamps(captured.gaussians, lamps)
    unseen, group = unseen_patches(field, middle), group_emitters(field, middle, params.light_groups, seed)
    beyond = group_patches(unseen, middle, DIRECTIONS, seed)
    seen = clipped_shares(field, group, captured.frames, captured.masks, poses)
    none = np.zeros(beyond.max(initial=-1) + 1)
    clipped = np.concatenate([seen, none, lamps.clipped])
    kind = np.where(clipped > EmitterGroupsConfig().clipped_share, CLIPPED, KNOWN).astype(np.uint8)
    kind[len(seen) : len(seen) + len(none)] = UNSEEN
    emitters = Emitters(with_lamps(joined(field, unseen), lamps), lamps, len(unseen.means))
    every = np.concatenate([group, len(seen) + beyond])
    exposure = CONFIG.exposure_sigma * params.models("light_gains", "view_exposures")
    astray = CONFIG.lamp_offset_sigma * params.models("light_gains", "lamp_directions")
    return RoomLight(emitters, poses, every, kind, clipped, params.light_gain_sigma, exposure, astray)


def gather_incident_light(
    lattice: ProbeGrid,
    emitters: Emitters,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    directions: int,
    face_px: int,
    progress: Progress,
) -> IncidentLight:
    """The energy at the lattice for some views, small holes of the room filled."""
    cells, asked = direction_cells(directions), quadratic_probes(lattice)
    field, points = emitters.field(), asked.points
    if len(cam_from_world) * len(points) < CONFIG.many_probes:
        energy = gather_probes(field, cam_from_world, points, cells, face_px, True, progress).energy
    else:
        # What it looks like from all sides: the places are few, and turned otherwise in every view.
        rays = face_directions(face_px).reshape(-1, 3)
        takes = np.concatenate([ball(rays @ turn.T, True) for turn in FACES])
        error = CONFIG.foretold_error
        energy = interpolate(field, cam_from_world, points, cells, face_px, takes, error, progress)
    middle = lattice.points().mean(0)
    near = area_lights_of(emitters.lamps, emitters.shown(), cam_from_world, middle, directions)
    return IncidentLight(lattice, cells, asked.everywhere(deconvolve(_stacked(energy), cells)), near)


def gather_grouped_light(
    lattice: ProbeGrid,
    room: RoomLight,
    views: Int[np.ndarray, " n"],
    directions: int,
    face_px: int,
    progress: Progress,
) -> GroupedLight:
    """The same, group by group."""
    cells, poses = direction_cells(directions), room.poses.cam_from_world[views]
    asked, field = quadratic_probes(lattice), room.emitters.field()
    found = gather_probes(field, poses, asked.points, cells, face_px, False, progress)
    energy, seen = found.energy, found.seen
    lit = luminance(energy) > 0
    source = np.ascontiguousarray(nearest_emitter(found.places, lit, field).transpose(1, 2, 0))
    # Small holes are filled in from their surroundings, whose level they keep.
    source[seen.transpose(1, 2, 0) < CONFIG.photographed_share] = -1
    around, sphere = neighbourhood(cells), np.full(len(cells), 4 * np.pi / len(cells))
    for view in range(len(views)):
        for probe, share in enumerate(seen[view].astype(np.float64)):
            energy[view, probe] = inpaint_energy(energy[view, probe], share, share, sphere, around)
    stacked = _stacked(energy)
    source = asked.brightest(stacked, source)
    filled, patches = len(room.kind), room.patches()
    came_from = np.where(source < 0, filled, room.group[source])
    patch = None if patches is None else np.maximum(source - (len(room.group) - len(patches.group)), -1)
    middle = lattice.points().mean(0)
    near = area_lights_of(room.emitters.lamps, room.emitters.shown(), poses, middle, directions)
    no_lamps = AreaLights.none(len(views), directions)
    total = IncidentLight(lattice, cells, asked.everywhere(deconvolve(stacked, cells)), no_lamps)
    return GroupedLight(
        total, came_from, near, np.append(room.kind, np.uint8(FILLED)), np.append(room.clipped_share, 0.0),
        room.gain_sigma, np.ascontiguousarray(poses[:, :, :3]), lamp_tangents(room), room.exposure_sigma,
        room.lamp_offset_sigma, patches, patch,
    )  # fmt: skip


def lamp_tangents(room: RoomLight) -> Float[np.ndarray, "l 2 3"]:
    """The two ways, world frame, in which a lamp moves across as seen from amid the cameras: a step per radian."""
    away = room.emitters.lamps.centres - mean_camera_centre(room.poses)
    distance = np.linalg.norm(away, axis=1)
    return np.stack(tangents(away / np.maximum(distance, 1e-12)[:, None]), 1) * distance[:, None, None]


def _stacked(energy: Float[np.ndarray, "n m d 3"]) -> Float[np.ndarray, "m d v"]:
    """Views and channels on one axis, view-major; float32."""
    n, m, d, _ = energy.shape
    return np.ascontiguousarray(energy.transpose(1, 2, 0, 3).reshape(m, d, 3 * n), dtype=np.float32)


def ball(cells: Float[np.ndarray, "d 3"], full_diffuse: bool) -> Float[np.ndarray, "m d"]:
    """What every direction's light sends to the camera from the half of a ball that faces it."""
    normals = direction_cells(CONFIG.ball_normals)
    normals = normals[normals[:, 2] < -CONFIG.ball_facing]
    views = np.tile([0.0, 0.0, -1.0], (len(normals), 1))
    roughness = np.full(len(normals), CONFIG.ball_roughness)
    diffuse, specular = rows(normals, roughness, views, cells, full_diffuse, lobe_floor(len(cells)))
    return CONFIG.ball_albedo * diffuse + specular
