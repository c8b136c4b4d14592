"""What a turning rig logged: where it says the camera was, and how well photographs agree.

A rig obeys, with axes (right-handed) and points in the frame of the camera at pan = tilt = 0, in metres,

    world_from_cam(pan, tilt) = turn(pan_axis, pan_point, pan) . turn(tilt_axis, tilt_point, tilt)

so that its world is the camera's frame at rest: the pan table carries the tilt stage, which carries camera
and object. A session's log counts angles in degrees; here they become radians.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from engine.errors import PoseError
from engine.geometry import compose, inverse


@dataclass(frozen=True, slots=True, eq=False)
class RigLog:
    """Per-view angles, degrees, NaN where a view has none; geometry as written in the session."""

    kind: str  # "turntable" or "gimbal"
    pan_deg: Float[np.ndarray, " n"]
    tilt_deg: Float[np.ndarray, " n"]
    geometry: Mapping[str, Sequence[float]]  # pan_axis, pan_point, tilt_axis, tilt_point; metres


@dataclass(frozen=True, slots=True, eq=False)
class RigFit:
    """How the rig's poses and the photographs' lie to one another."""

    scale: float  # metres per unit of the photographs' model
    scale_stderr: float  # relative, one standard error
    rig_from_world: Float[np.ndarray, "3 4"]  # rigid, applied after scaling the model's world
    rotation_rad: float  # median disagreement
    position_m: float  # median disagreement
    path_m: float  # how far the rig's cameras are from their middle, root mean square
    agree: Bool[np.ndarray, " n"]  # views whose pose is where the rig says, within a generous tolerance

    @property
    def position_share(self) -> float:
        """Of the path: by how much positions disagree."""
        return self.position_m / max(self.path_m, 1e-300)


def _turn(
    axis: Float[np.ndarray, " 3"], point: Float[np.ndarray, " 3"], angle: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3 4"]:
    """Rotations by `angle` (radians) about a line, Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    rotation = np.eye(3) + s * cross + (1 - c) * (cross @ cross)
    return np.concatenate([rotation, (point - rotation @ point)[..., None]], axis=2)


def logged_poses(rig: RigLog) -> Float[np.ndarray, "n 3 4"]:
    """cam_from_world where the rig says the camera was; world is the camera at rest, metres.

    Raises:
        PoseError: the geometry lacks an axis or point, or an axis has no direction.
    """
    places: dict[str, np.ndarray] = {}
    for name in ("pan_axis", "pan_point", "tilt_axis", "tilt_point"):
        value = np.asarray(rig.geometry.get(name, ()), dtype=np.float64)
        if value.shape != (3,) or not np.isfinite(value).all():
            raise PoseError(
                f"session.json: the rig's geometry has no {name} of three numbers; add it, or remove the rig"
            )
        if name.endswith("axis") and np.linalg.norm(value) < 1e-9:
            raise PoseError(f"session.json: the rig's {name} is zero; give its direction, or remove the rig")
        places[name] = value
    pan = _turn(places["pan_axis"], places["pan_point"], np.radians(rig.pan_deg))
    tilt = _turn(places["tilt_axis"], places["tilt_point"], np.radians(rig.tilt_deg))
    return inverse(compose(pan, tilt))


def angle_between(a: Float[np.ndarray, "*n 3 3"], b: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n"]:
    """Angle of the rotation from a to b, radians; exact near zero."""
    half = np.clip(np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(8), 0, 1)
    return np.asarray(2 * np.arcsin(half))


def mean_rotation(rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation nearest to all in the chordal sense."""
    u, _, vt = np.linalg.svd(rotations.sum(0))
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def fit(logged: Float[np.ndarray, "n 3 4"], cam_from_world: Float[np.ndarray, "n 3 4"]) -> RigFit | None:
    """Similarity from the photographs' world to the rig's; None with fewer than four common views.

    Trimmed least squares: views far off are left out and the rest is fitted again, so that a few views
    placed wrongly, or a few wrong angles in the log, do not bend it.
    """
    known = np.asarray(np.isfinite(logged).all((1, 2)) & np.isfinite(cam_from_world).all((1, 2)))
    if known.sum() < 4:
        return None
    rig_from_cam, world_from_cam = inverse(logged), inverse(cam_from_world)
    use = known
    for _ in range(10):
        scale, rig_from_world = _similarity(world_from_cam[use], rig_from_cam[use])
        turned = angle_between(rig_from_world[:, :3] @ world_from_cam[:, :, :3], rig_from_cam[:, :, :3])
        off = scale * world_from_cam[:, :, 3] @ rig_from_world[:, :3].T + rig_from_world[:, 3]
        off = np.linalg.norm(off - rig_from_cam[:, :, 3], axis=1)
        near = known & (turned < _far(turned[known])) & (off < _far(off[known]))
        if near.sum() < 4 or np.array_equal(near, use):
            break
        use = near
    centres = rig_from_cam[use, :, 3]
    extent = np.sqrt(((centres - centres.mean(0)) ** 2).sum())
    noise = np.sqrt((off[use] ** 2).sum() / (3 * use.sum()))
    return RigFit(
        scale, float(noise / max(extent, 1e-300)), rig_from_world, float(np.median(turned[use])),
        float(np.median(off[use])), float(extent / np.sqrt(use.sum())), use,
    )  # fmt: skip


def _similarity(
    world_from_cam: Float[np.ndarray, "n 3 4"], rig_from_cam: Float[np.ndarray, "n 3 4"]
) -> tuple[float, Float[np.ndarray, "3 4"]]:
    """Scale and rigid rig_from_world: rotation from the rotations alone, the rest linear in the centres."""
    rotation = mean_rotation(rig_from_cam[:, :, :3] @ np.swapaxes(world_from_cam[:, :, :3], 1, 2))
    source, target = world_from_cam[:, :, 3] @ rotation.T, rig_from_cam[:, :, 3]
    a, b = source - source.mean(0), target - target.mean(0)
    scale = float((a * b).sum() / max((a * a).sum(), 1e-300))
    return scale, np.column_stack([rotation, target.mean(0) - scale * source.mean(0)])


def _far(distances: Float[np.ndarray, " n"]) -> float:
    """Beyond this a value belongs to another population than the median's."""
    return max(5 * 1.4826 * float(np.median(distances)), 1e-9)
