"""Find where in a room the rig may stand: no surface within what camera and object sweep over all poses.

What they sweep is kept as a distance for each of many directions from the rig's centre; a place is free where rays in these
directions meet nothing so near. World frame, metres.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from hardware.errors import StudioError
from hardware.virtual.studio.interior import glow

DIRECTIONS = 2048  # 4 degrees apart
SPREAD_DEG = 6.0  # a thing that is swept past is in the way of directions so far around it
EVERYWHERE = 0.5  # of the farthest reach is wanted free in all directions, whatever few poses sweep
SPARE = 1.06  # of the distance that is needed
CAMERA_M = 0.05  # radius of the camera
CANDIDATES = 3000
OUTDOORS = 0.7  # share of the sphere that sees no surface: such a place is not in the room
BATCH = 256


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """How far camera and object reach from the rig's centre, by direction."""

    directions: Float[np.ndarray, "d 3"]
    reach: Float[np.ndarray, " d"]


def sweep(world_from_cam: Float[np.ndarray, "n 3 4"], body: Float[np.ndarray, "p 3"], scale: float) -> Sweep:
    """Of a journey around the origin; `body`'s points are in the camera's frame."""
    rng = np.random.default_rng(0)
    camera = rng.normal(size=(24, 3))
    camera *= CAMERA_M * scale / np.linalg.norm(camera, axis=1, keepdims=True)
    # The outermost points in many directions stand for the whole.
    probes = rng.normal(size=(96, 3))
    outer = np.unique(np.argmax(body @ probes.T, axis=0))
    points = np.concatenate([camera, body[outer]])
    there = np.einsum("nij,pj->npi", world_from_cam[:, :, :3], points) + world_from_cam[:, None, :, 3]
    there = there.reshape(-1, 3)
    reach = np.linalg.norm(there, axis=1)
    directions = _even(DIRECTIONS)
    near = KDTree(directions).query_ball_point(
        there / np.maximum(reach, 1e-12)[:, None], 2 * np.sin(np.radians(SPREAD_DEG) / 2)
    )
    farthest = np.zeros(DIRECTIONS)
    np.maximum.at(
        farthest, np.concatenate([np.asarray(n, int) for n in near]), np.repeat(reach, [len(n) for n in near])
    )
    return Sweep(directions, np.maximum(farthest, EVERYWHERE * farthest.max()))


def choose(room: glow.Room, bounds: Float[np.ndarray, "2 3"], eye: Float[np.ndarray, "3"] | None,
           given: Float[np.ndarray, "3"] | None, needed: Sweep, name: str) -> Float[np.ndarray, "3"]:  # fmt: skip
    """The place that was given, if it is free, else the one with the most room to spare.

    Raises:
        StudioError: something stands in the way.
    """
    if given is None:
        return search(room, bounds, eye, needed, name)
    check(room, given, needed)
    return given


def check(room: glow.Room, place: Float[np.ndarray, "3"], needed: Sweep) -> None:
    """
    Raises:
        StudioError: something stands in the way at this place.
    """
    free = _free(room, place[None], needed.directions)[0]
    if _outdoors(free[None])[0]:
        raise StudioError("--place: nearly no surface is seen from there; give a place inside the room")
    short = free / np.maximum(needed.reach * SPARE, 1e-9)
    worst = int(short.argmin())
    if short[worst] < 1:
        raise StudioError(
            f"--place: a surface stands {free[worst]:.2f} m from there, where camera and object need"
            f" {needed.reach[worst] * SPARE:.2f} m; choose another place, a smaller --object-size or another --motion"
        )


def search(room: glow.Room, bounds: Float[np.ndarray, "2 3"], eye: Float[np.ndarray, "3"] | None, needed: Sweep,
           name: str) -> Float[np.ndarray, "3"]:  # fmt: skip
    """The place with the most room to spare, of a grid; one that the scene's own camera sees, if it has one.

    Raises:
        StudioError: the rig fits nowhere.
    """
    size = bounds[1] - bounds[0]
    spacing = float((np.prod(np.maximum(size, 1e-3)) / CANDIDATES) ** (1 / 3))
    axes = [np.arange(low + spacing / 2, high, spacing) for low, high in bounds.T]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    if eye is not None:
        grid = np.concatenate([eye[None], grid[_seen(room, eye, grid)]])
    spare = np.concatenate([
        _spare(_free(room, grid[k : k + BATCH], needed.directions), needed) for k in range(0, len(grid), BATCH)
    ])  # fmt: skip
    best = int(spare.argmax())
    if spare[best] < 1:
        radius = needed.reach.max() * SPARE
        raise StudioError(
            f"{name}: the rig fits nowhere in this room: camera and object reach {radius:.2f} m from its centre, the best"
            f" place has room for {100 * max(spare[best], 0):.0f} % of that; choose a smaller --object-size, or --motion gimbal"
        )
    return grid[best]


def _spare(free: Float[np.ndarray, "c d"], needed: Sweep) -> Float[np.ndarray, " c"]:
    """How many times what is needed there is; nothing out of doors."""
    times = (free / np.maximum(needed.reach * SPARE, 1e-9)).min(1)
    return np.where(_outdoors(free), 0.0, np.minimum(times, 1e3))


def _outdoors(free: Float[np.ndarray, "c d"]) -> Bool[np.ndarray, " c"]:
    return ~np.isfinite(free).any(1) | (np.isinf(free).mean(1) > OUTDOORS)


def _free(
    room: glow.Room, places: Float[np.ndarray, "c 3"], directions: Float[np.ndarray, "d 3"]
) -> np.ndarray:
    """Distance of the nearest surface in each direction [c d]; inf: none."""
    origins = np.repeat(places, len(directions), 0)
    return _distances(room, origins, np.tile(directions, (len(places), 1))).reshape(len(places), -1)


def _seen(room: glow.Room, eye: np.ndarray, places: np.ndarray) -> Bool[np.ndarray, " c"]:
    to = places - eye
    far = np.maximum(np.linalg.norm(to, axis=1), 1e-9)
    return _distances(room, np.broadcast_to(eye, to.shape), to / far[:, None]) > far


def _distances(room: glow.Room, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    mi: Any = room.mi
    import drjit as dr

    ray = mi.Ray3f(mi.Point3f(origins.T.astype(np.float32)), mi.Vector3f(directions.T.astype(np.float32)))
    hit = room.scene.ray_intersect_preliminary(ray)
    return np.array(dr.select(hit.is_valid(), hit.t, dr.inf))


def _even(count: int) -> Float[np.ndarray, "n 3"]:
    """A spiral of even steps over the sphere."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    azimuth = np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], 1)
