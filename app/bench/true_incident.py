"""The studio's own light as the surface solver takes it: energy at a lattice of probes, and globes as lamps.

Rays are followed from every probe into the baked room, jittered anew in every view, and sorted into direction cells as
the product sorts its Gaussians. Where a ray meets a globe of a built-in room it brings nothing: globes are lamps, as exact
as the studio knows them. The light is a function of the place in the world, so nothing is rendered but what arrives. Camera
frame, the studio's metres.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_matrix

from engine.geometry import inverse
from engine.light.incident.direction_grid import FACES, deconvolve, interpolated_cells, pixel_solid_angles
from engine.progress import Progress
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.transport import IncidentLight, ProbeGrid, direction_cells
from hardware.errors import StudioError
from hardware.virtual.studio import tracer
from hardware.virtual.studio.glow import Glow
from hardware.virtual.studio.interior.around import Around
from hardware.virtual.studio.surroundings import Surroundings

SIDE = 64  # pixels along a cube's edge: 1.4 degrees, of four rays each
FINER = 2  # strata along each edge of a pixel
SHADOW_RAYS = 256  # from the middle of the lattice to each globe, in each view

Look = Callable[[Any], np.ndarray]
"""Radiance along Mitsuba rays in the world, [r 3]."""


def incident_of(
    around: Surroundings,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    lattice: ProbeGrid,
    directions: int,
    session_per_studio: float,
    seed: int,
    progress: Progress,
) -> IncidentLight:
    """What arrives at the lattice in each view, in the session's radiance.

    Raises:
        StudioError: Mitsuba has no vectorised variant here.
    """
    if isinstance(around, Around):
        glow, room = None, around.room
        mi: Any = room.mi

        def look(ray: Any) -> np.ndarray:
            return np.array(room.meet(ray).radiance).T

    else:
        own: Any = around  # `surroundings.BuiltIn`
        mi = tracer.load(own.device)
        if not tracer.is_vectorised(mi):
            raise StudioError(
                "Mitsuba finds no libLLVM here and would follow one ray at a time; install it (Debian: libllvm19)"
            )
        glow = built = Glow(mi, own.room, own.atlas)

        def look(ray: Any) -> np.ndarray:
            met = built.look(ray)
            globe = np.array(met.is_lamp & (met.lamp < len(built.globes)))
            return np.where(globe[:, None], 0, np.array(met.radiance).T)

    cells, points = direction_cells(directions), lattice.points()
    sorted_into = interpolated_cells(cells, SIDE)
    omega = np.broadcast_to(pixel_solid_angles(SIDE), (6, SIDE, SIDE))
    entries = (sorted_into.share * omega[..., None]).ravel()
    pixels = np.repeat(np.arange(omega.size), 3)
    matrix = csr_matrix((entries, (sorted_into.index.ravel(), pixels)), (directions, omega.size))
    rng = np.random.default_rng(seed)
    energy = np.zeros((len(points), directions, len(cam_from_world), 3), np.float32)
    for view, pose in enumerate(cam_from_world):
        progress.step(view / len(cam_from_world), "looking at the room from the object")
        for probe, seen in enumerate(_looked(mi, look, pose, points, _jittered(rng))):
            energy[probe, :, view] = session_per_studio * (matrix @ seen)
    flat = energy.reshape(len(points), directions, -1)
    near = AreaLights.none(len(cam_from_world), directions)
    if glow is not None and glow.globes:
        near = _globes(glow, cam_from_world, points.mean(0), directions, session_per_studio, rng)
    return IncidentLight(lattice, cells, deconvolve(flat, cells), near)


def _jittered(rng: np.random.Generator) -> Float[np.ndarray, "r 3"]:
    """One direction in each of the strata of every pixel of a cube map, a pixel's own in a row."""
    row, column = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    stratum = np.stack(np.meshgrid(np.arange(FINER), np.arange(FINER), indexing="ij"), -1).reshape(-1, 2)
    at = np.stack([row, column], -1)[None, :, :, None] + (
        (stratum + rng.random((6, SIDE, SIDE, FINER**2, 2))) / FINER
    )
    y, x = np.moveaxis(at / SIDE * 2 - 1, -1, 0)
    local = np.stack([x, y, np.ones_like(x)], -1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return np.einsum("fhwri,fij->fhwrj", local, FACES).reshape(-1, 3)


def _looked(
    mi: Any,
    look: Look,
    cam_from_world: Float[np.ndarray, "3 4"],
    points: Float[np.ndarray, "m 3"],
    directions: Float[np.ndarray, "r 3"],
) -> Iterator[Float[np.ndarray, "q 3"]]:
    """Probe by probe the mean radiance of each pixel of its cube map, the studio's scale."""
    world_from_cam = inverse(cam_from_world)
    towards = directions @ world_from_cam[:, :3].T
    origins = points @ world_from_cam[:, :3].T + world_from_cam[:, 3]
    for origin in origins:
        ray = mi.Ray3f(mi.Point3f(np.repeat(origin[:, None], len(towards), 1)), mi.Vector3f(towards.T))
        yield look(ray).reshape(-1, FINER**2, 3).mean(1)


def _globes(
    glow: Glow,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    middle: Float[np.ndarray, " 3"],
    directions: int,
    session_per_studio: float,
    rng: np.random.Generator,
) -> AreaLights:
    """The globes as lamps, each as far as the room leaves it open."""
    globes = glow.globes
    mi: Any = glow.mi
    centres = np.stack([globe.centre for globe in globes])
    open_share = np.zeros((len(cam_from_world), len(globes)))
    for view, pose in enumerate(cam_from_world):
        there = inverse(pose) @ np.append(middle, 1.0)
        point = mi.Point3f(np.repeat(there[:, None], SHADOW_RAYS, 1))
        for k in range(len(globes)):
            aim = glow.aim(
                mi.UInt32(np.full(SHADOW_RAYS, k)), point, mi.Point2f(rng.random((2, SHADOW_RAYS)))
            )
            open_share[view, k] = np.array(glow.arriving(point, None, aim, aim.density > 0)[0]).mean()
    radiance = session_per_studio * np.stack([globe.radiance for globe in globes])
    return AreaLights(
        centres @ np.swapaxes(cam_from_world[:, :, :3], 1, 2) + cam_from_world[:, None, :, 3],
        np.array([globe.radius_m for globe in globes]),
        (open_share[..., None] * radiance).astype(np.float32),
        directions,
    )
