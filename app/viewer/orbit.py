"""The eye of the 3D view: turns about a target, pans, zooms; pure functions.

World frame, scene units, radians. A pixel (x, y) is measured from the picture's upper left corner, so the first
pixel's centre is (0.5, 0.5). As everywhere, the eye's own frame is x right, y down, z forward. `up` need
not be an axis of the world: it is guessed from the cameras.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

Vector = tuple[float, float, float]

FOV = math.radians(40.0)
NEAREST, FURTHEST = 1e-4, 1e6
"""Limits of the distance between eye and target, scene units."""
WIDEST, NARROWEST = math.radians(100.0), math.radians(6.0)
VIEWS: dict[str, tuple[float, float]] = {  # azimuth and elevation, radians
    "front": (0.0, 0.0),
    "back": (math.pi, 0.0),
    "left": (-math.pi / 2, 0.0),
    "right": (math.pi / 2, 0.0),
    "top": (0.0, math.pi / 2),
    "bottom": (0.0, -math.pi / 2),
}
THREE_QUARTERS = (math.radians(32.0), math.radians(24.0))


@dataclass(frozen=True, slots=True)
class Orbit:
    """Where the eye is: `distance` away from `target`, at azimuth 0 looking along `front`."""

    target: Vector
    distance: float
    azimuth: float = 0.0  # about `up`; grows as the eye moves to the right
    elevation: float = 0.0  # -pi/2 .. pi/2 above the target's horizon
    up: Vector = (0.0, -1.0, 0.0)  # unit
    front: Vector = (0.0, 0.0, 1.0)  # unit, at right angles to `up`
    fov: float = FOV  # between the picture's upper and lower edge
    roll: float = 0.0  # of the eye about its own viewing direction


def axes(orbit: Orbit) -> Float[np.ndarray, "3 3"]:
    """Rows: the eye's right, down and forward in the world; rotation part of `cam_from_world`."""
    up, front = np.array(orbit.up), np.array(orbit.front)
    side = np.cross(front, up)
    ca, sa = math.cos(orbit.azimuth), math.sin(orbit.azimuth)
    ce, se = math.cos(orbit.elevation), math.sin(orbit.elevation)
    right = ca * side + sa * front
    forward = ce * (ca * front - sa * side) - se * up
    down = np.cross(forward, right)
    cr, sr = math.cos(orbit.roll), math.sin(orbit.roll)
    return np.stack([cr * right + sr * down, cr * down - sr * right, forward])


def eye(orbit: Orbit) -> Float[np.ndarray, " 3"]:
    return np.array(orbit.target) - orbit.distance * axes(orbit)[2]


def cam_from_world(orbit: Orbit) -> Float[np.ndarray, "3 4"]:
    rotation = axes(orbit)
    shift = -rotation @ np.array(orbit.target) + [0.0, 0.0, orbit.distance]
    return np.concatenate([rotation, shift[:, None]], axis=1)


def focal_px(orbit: Orbit, height: int) -> float:
    return height / 2 / math.tan(orbit.fov / 2)


def ray(orbit: Orbit, x: float, y: float, width: int, height: int) -> Float[np.ndarray, " 3"]:
    """Unit direction, world frame, in which a pixel looks."""
    focal = focal_px(orbit, height)
    seen = np.array([(x - width / 2) / focal, (y - height / 2) / focal, 1.0]) @ axes(orbit)
    return seen / np.linalg.norm(seen)


def project(
    orbit: Orbit, points: Float[np.ndarray, "*n 3"], width: int, height: int
) -> Float[np.ndarray, "*n 3"]:
    """x and y in pixels, and the depth; x and y are NaN behind the eye."""
    pose = cam_from_world(orbit)
    cam = points @ pose[:, :3].T + pose[:, 3]
    z = cam[..., 2:]
    xy = cam[..., :2] / np.where(z > 1e-9, z, np.nan) * focal_px(orbit, height) + [width / 2, height / 2]
    return np.concatenate([xy, z], axis=-1)


def turned(orbit: Orbit, right: float, up: float) -> Orbit:
    """The eye moves about the target by so many radians, as its own picture has right and up."""
    cr, sr = math.cos(orbit.roll), math.sin(orbit.roll)
    right, up = cr * right + sr * up, cr * up - sr * right
    elevation = min(max(orbit.elevation + up, -math.pi / 2), math.pi / 2)
    return replace(orbit, azimuth=_wrapped(orbit.azimuth + right), elevation=elevation)


def panned(orbit: Orbit, right_px: float, down_px: float, height: int) -> Orbit:
    """What lies at the target's depth moves by so many pixels."""
    across, down, _ = axes(orbit)
    size = orbit.distance / focal_px(orbit, height)
    return _aimed(orbit, np.array(orbit.target) - size * (right_px * across + down_px * down))


def zoomed(
    orbit: Orbit, factor: float, at: tuple[float, float] | None = None, size: tuple[int, int] = (1, 1)
) -> Orbit:
    """`factor` times as near (above 1) or as far; what is under pixel `at` of a picture of `size` stays there."""
    distance = min(max(orbit.distance / factor, NEAREST), FURTHEST)
    nearer = replace(orbit, distance=distance)
    if at is None:
        return nearer
    width, height = size
    direction = ray(orbit, *at, width, height)
    forward = axes(orbit)[2]
    offset = direction * orbit.distance / (direction @ forward) - forward * orbit.distance
    return _aimed(nearer, np.array(orbit.target) + offset * (1 - distance / orbit.distance))


def aimed(orbit: Orbit, point: Float[np.ndarray, " 3"]) -> Orbit:
    """Turns about `point` from now on; the eye stays as far from its new target as that one is deep."""
    depth = float(axes(orbit)[2] @ (point - eye(orbit)))
    return replace(_aimed(orbit, point), distance=min(max(depth, NEAREST), FURTHEST))


def standing(orbit: Orbit, view: str) -> Orbit:
    """One of VIEWS, about the same target."""
    azimuth, elevation = VIEWS[view]
    return replace(orbit, azimuth=azimuth, elevation=elevation, roll=0.0)


def fitted(orbit: Orbit, centre: Vector, radius: float, aspect: float) -> Orbit:
    """A ball fills the picture's shorter side; `aspect` is width over height."""
    half = orbit.fov / 2 if aspect >= 1 else math.atan(math.tan(orbit.fov / 2) * aspect)
    distance = radius / math.sin(half)
    return replace(orbit, target=centre, distance=min(max(distance, NEAREST), FURTHEST), roll=0.0)


def through(orbit: Orbit, pose: Float[np.ndarray, "3 4"], depth: float, fov: float) -> Orbit:
    """As a photograph saw it: the eye at `pose` (cam_from_world), its target `depth` in front."""
    rotation = pose[:, :3]
    forward = rotation[2]
    up, front = np.array(orbit.up), np.array(orbit.front)
    elevation = math.asin(min(max(-float(forward @ up), -1.0), 1.0))
    level = forward - (forward @ up) * up
    if np.linalg.norm(level) < 1e-6:  # straight up or down: the picture's right tells the azimuth
        level = np.cross(up, rotation[0])
    azimuth = math.atan2(-float(level @ np.cross(front, up)), float(level @ front))
    fov = min(max(fov, NARROWEST), WIDEST)
    seen = replace(orbit, azimuth=azimuth, elevation=elevation, distance=depth, fov=fov, roll=0.0)
    right, down, _ = axes(seen)
    roll = math.atan2(float(rotation[0] @ down), float(rotation[0] @ right))
    place = -rotation.T @ pose[:, 3]
    return _aimed(replace(seen, roll=roll), place + depth * forward)


def between(a: Orbit, b: Orbit, share: float) -> Orbit:
    """On the way from a (0) to b (1), the short way round; distances change by equal factors."""
    if share >= 1:
        return b

    def mix(x: float, y: float) -> float:
        return x + (y - x) * share

    target = tuple(mix(x, y) for x, y in zip(a.target, b.target, strict=True))
    return replace(
        b,
        target=(target[0], target[1], target[2]),
        distance=math.exp(mix(math.log(a.distance), math.log(b.distance))),
        azimuth=_wrapped(a.azimuth + share * _wrapped(b.azimuth - a.azimuth)),
        elevation=mix(a.elevation, b.elevation),
        fov=mix(a.fov, b.fov),
        roll=_wrapped(a.roll + share * _wrapped(b.roll - a.roll)),
    )


def scale_bar(orbit: Orbit, height: int, longest_px: float) -> tuple[float, float]:
    """A round length (1, 2 or 5 times a power of ten), and its pixels at the target's depth."""
    per_px = orbit.distance / focal_px(orbit, height)
    longest = per_px * longest_px
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1 + 1e-9))
    return length, length / per_px


def _aimed(orbit: Orbit, target: Float[np.ndarray, " 3"]) -> Orbit:
    x, y, z = (float(value) for value in target)
    return replace(orbit, target=(x, y, z))


def _wrapped(angle: float) -> float:
    """The same direction in -pi .. pi."""
    return math.remainder(angle, 2 * math.pi)
