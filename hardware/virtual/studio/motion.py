"""Move the rig: where camera and object are in each view, and what a rig would report about it.

`world_from_cam` poses, world z up, metres; camera frame x right, y down, z forward. A turning rig obeys

    world_from_cam(pan, tilt) = world_from_cam(0, 0) . turn(pan_axis, pan_point, pan) . turn(tilt_axis, tilt_point, tilt)

with axes and points in the frame of the camera at pan = tilt = 0 and right-handed angles: the pan table
carries the tilt stage, which carries camera and object.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from hardware import plan
from hardware.errors import StudioError
from hardware.interfaces import Angles, Geometry
from hardware.virtual.studio.order import MOTIONS

REPORT_NOISE_DEG = 0.02  # what an encoder and some backlash leave
PITCHES_DEG = {"turntable": 8.0, "gimbal": 0.0}  # how far down the camera at rest looks, by kind of rig
PIVOT_M = 0.25  # the rig turns about a point this far before the camera, between camera and object
WANDER_M = 0.28  # how far hands move the rig from the room's centre
WANDERS = (1.0, 0.5, 0.25, 0.0)  # of that, the first that has room

PIVOT = np.array([0.03, 0.06, PIVOT_M])  # camera frame: no bracket centres the lens perfectly

# A level camera that looks along world +x: its axes in world coordinates, as columns.
_LEVEL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


@dataclass(frozen=True, slots=True, eq=False)
class Journey:
    """Poses of all views, and the rig's own log: `reports` per view and `geometry` (None for hands)."""

    world_from_cam: Float[np.ndarray, "n 3 4"]
    reports: tuple[dict[str, float | str] | None, ...]
    geometry: dict[str, list[float]] | None


def turn(
    axis: Float[np.ndarray, "3"], point: Float[np.ndarray, "3"], angle: float
) -> Float[np.ndarray, "3 4"]:
    """Rigid rotation by `angle` (radians, right-handed) about a line."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return np.concatenate([rotation, (point - rotation @ point)[:, None]], axis=1)


def handheld(views: int, centre: Float[np.ndarray, "3"], seed: int, wander_m: float = WANDER_M) -> Journey:
    """A person turning every way: a spiral of gazes from floor to ceiling, rolling and wandering on the way.

    Gazes lie evenly on the sphere; 48 to 96 views are 17 to 24 degrees apart, roll included.
    """
    rng = np.random.default_rng(seed)
    stride = min(np.sqrt(4 * np.pi / (1.4 * views)), np.radians(19))
    turns = max(1.0, stride * views / 4)  # so that rows lie 4 pi / (views stride) apart
    polar = np.linspace(0.02, np.pi - 0.02, 20001)
    length = np.cumsum(np.hypot(1.0, 2 * turns * np.sin(polar)))
    polar = np.interp((np.arange(views) + 0.5) / views * length[-1], length, polar)
    azimuth = 2 * turns * polar + rng.uniform(0, 2 * np.pi)
    gazes = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), -np.cos(polar)], 1)
    roll = np.radians(60) * np.sin(2 * np.pi * (views / 100 * np.arange(views) / views + rng.uniform()))
    pivots = centre + np.stack([_drift(rng, views, 1.0) for _ in range(3)], 1) * (wander_m / np.sqrt(3))
    right = np.array([-np.sin(azimuth[0]), np.cos(azimuth[0]), 0.0])
    poses = []
    for gaze, rho, pivot in zip(gazes, roll, pivots, strict=True):
        # "Right" is carried along without twisting: an upright horizon would spin at the poles.
        right = right - gaze * (right @ gaze)
        right /= np.linalg.norm(right)
        frame = np.stack([right, np.cross(gaze, right), gaze], 1)
        rotation = frame @ turn(np.array([0.0, 0, 1]), np.zeros(3), rho)[:, :3]
        poses.append(np.column_stack([rotation, pivot - rotation @ np.array([0, 0, PIVOT_M])]))
    return Journey(np.stack(poses), (None,) * views, None)


def scattered(views: int, centre: Float[np.ndarray, "3"], seed: int, wander_m: float = WANDER_M) -> Journey:
    """Every way up and round at random, each pose by itself: rotations uniform on SO(3), pivots in a ball about the centre."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_quat(rng.normal(size=(views, 4))).as_matrix()
    away = rng.normal(size=(views, 3))
    away *= wander_m * np.cbrt(rng.random((views, 1))) / np.linalg.norm(away, axis=1, keepdims=True)
    places = centre + away - turns @ [0, 0, PIVOT_M]
    return Journey(np.concatenate([turns, places[:, :, None]], 2), (None,) * views, None)


def turntable(views: int, centre: Float[np.ndarray, "3"], seed: int) -> Journey:
    """Camera and object on one table that turns about a vertical axis through a full circle."""
    return _logged("turntable", plan.turntable(views), centre, seed)


def gimbal(views: int, centre: Float[np.ndarray, "3"], seed: int) -> Journey:
    """Rows of pan angles at tilts from floor to ceiling, back and forth, thinner towards the poles."""
    return _logged("gimbal", plan.gimbal(views), centre, seed)


def geometry_of(kind: str) -> Geometry:
    """Where the axes of the virtual rig called `kind` are.

    Raises:
        StudioError: no such rig.
    """
    tilt_point = PIVOT + [0, -0.02, 0.015]
    return Geometry(
        _triple(_rest(kind).T @ np.array([0.0, 0, 1])), _triple(PIVOT), (1.0, 0.0, 0.0), _triple(tilt_point)
    )


def pose_of(
    kind: str, centre: Float[np.ndarray, "3"], pan_deg: float, tilt_deg: float
) -> Float[np.ndarray, "3 4"]:
    """world_from_cam of the virtual rig called `kind`, whose pivot stands at `centre`.

    Raises:
        StudioError: no such rig.
    """
    rest, geometry = _rest(kind), geometry_of(kind)
    pose = np.column_stack([rest, centre - rest @ PIVOT])
    for axis, point, angle in (
        (geometry.pan_axis, geometry.pan_point, pan_deg),
        (geometry.tilt_axis, geometry.tilt_point, tilt_deg),
    ):
        pose = _after(pose, turn(np.array(axis), np.array(point), np.radians(angle)))
    return pose


def _rest(kind: str) -> Float[np.ndarray, "3 3"]:
    """How the camera looks at pan = tilt = 0, its axes in the world as columns."""
    if kind not in PITCHES_DEG:
        raise StudioError(f"there is no virtual rig called {kind!r}; choose one of {', '.join(PITCHES_DEG)}")
    return _LEVEL @ turn(np.array([-1.0, 0, 0]), np.zeros(3), np.radians(PITCHES_DEG[kind]))[:, :3]


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _logged(kind: str, places: plan.Plan, centre: np.ndarray, seed: int) -> Journey:
    """A journey with a rig, and what its encoders would say of it."""
    rng = np.random.default_rng(seed)
    poses, reports = [], []
    for place in places:
        angles = place.angles or Angles(0.0)
        poses.append(pose_of(kind, centre, angles.pan_deg, angles.tilt_deg))
        noise = rng.normal(0, REPORT_NOISE_DEG, 2)
        pan = round(float(angles.pan_deg + noise[0]), 4)
        tilt = round(float(angles.tilt_deg + noise[1]), 4) if kind == "gimbal" else 0.0
        reports.append({"kind": kind, "pan_deg": pan, "tilt_deg": tilt})
    geometry = {name: list(value) for name, value in asdict(geometry_of(kind)).items()}
    return Journey(np.stack(poses), tuple(reports), geometry)


def _after(a_from_b: np.ndarray, b_from_c: np.ndarray) -> np.ndarray:
    return np.column_stack(
        [a_from_b[:, :3] @ b_from_c[:, :3], a_from_b[:, :3] @ b_from_c[:, 3] + a_from_b[:, 3]]
    )


def _drift(rng: np.random.Generator, views: int, size: float) -> Float[np.ndarray, " n"]:
    """A slow smooth wander within +-`size`."""
    share = np.arange(views) / views
    waves = [np.sin(2 * np.pi * (share * k + rng.uniform())) / k**0.5 for k in rng.uniform(1.0, 4.0, 4)]
    total = np.sum(waves, 0)
    return size * total / max(np.abs(total).max(), 1e-9)


FREE: dict[str, Callable[[int, np.ndarray, int, float], Journey]] = {
    "handheld": handheld,
    "random": scattered,
}
"""Those that no rig carries: they wander, less where less room is free, and report nothing."""
RIGS: dict[str, Callable[[int, np.ndarray, int], Journey]] = {"turntable": turntable, "gimbal": gimbal}


def carried(journey: Journey, centre: Float[np.ndarray, "3"], scale: float) -> Journey:
    """A journey around the origin, `scale` times as large, around `centre`."""
    poses = journey.world_from_cam.copy()
    poses[:, :, 3] = poses[:, :, 3] * scale + centre
    geometry = journey.geometry
    if geometry is not None:
        geometry = {
            name: [scale * x for x in value] if name.endswith("point") else value
            for name, value in geometry.items()
        }
    return Journey(poses, journey.reports, geometry)


def travel(
    motion: str, views: int, centre: Float[np.ndarray, "3"], seed: int, wander_m: float = WANDER_M
) -> Journey:
    """The journey called `motion`.

    Raises:
        StudioError: no such motion, or no views.
    """
    if motion not in FREE and motion not in RIGS:
        raise StudioError(f"there is no motion called {motion!r}; choose one of {', '.join(MOTIONS)}")
    if views < 1:
        raise StudioError(f"{views} views were asked for; at least 1 is needed")
    if motion in FREE:
        return FREE[motion](views, centre, seed, wander_m)
    return RIGS[motion](views, centre, seed)


def calmer(motion: str, views: int, seed: int, scale: float) -> Iterator[tuple[Journey, tuple[str, ...]]]:
    """Journeys around the origin, `scale` times as large, each wandering less than the one before; and what to say of it.

    Raises:
        StudioError: as `travel`.
    """
    for share in WANDERS if motion in FREE else (1.0,):
        wander_m = WANDER_M * share
        journey = carried(travel(motion, views, np.zeros(3), seed, wander_m), np.zeros(3), scale)
        told = f"the rig wanders {100 * wander_m * scale:.0f} cm about its place: no more is free"
        yield journey, () if share == 1 else (told,)
