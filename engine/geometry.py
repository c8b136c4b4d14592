"""Rigid transforms, cameras and directions; all conversions between conventions live here.

Camera model: OpenCV radial-tangential (k1, k2, p1, p2), pixel centres at half integers. OpenGL and glTF
cameras look along -z with y up: `opencv_from_opengl` is the one place that knows.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.types import Camera

# The same 180 degree turn about x maps either way between OpenCV's and OpenGL's camera frames.
opencv_from_opengl = np.diag([1.0, -1.0, -1.0])


def inverse(a_from_b: Float[np.ndarray, "*batch 3 4"]) -> Float[np.ndarray, "*batch 3 4"]:
    """b_from_a of rigid transforms [R | t]."""
    rotation = np.swapaxes(a_from_b[..., :3], -1, -2)
    return np.concatenate([rotation, -rotation @ a_from_b[..., 3:]], axis=-1)


def compose(
    a_from_b: Float[np.ndarray, "*batch 3 4"], b_from_c: Float[np.ndarray, "*batch 3 4"]
) -> Float[np.ndarray, "*batch 3 4"]:
    """a_from_c."""
    rotation = a_from_b[..., :3] @ b_from_c[..., :3]
    shift = a_from_b[..., :3] @ b_from_c[..., 3:] + a_from_b[..., 3:]
    return np.concatenate([rotation, shift], axis=-1)


def transform(
    a_from_b: Float[np.ndarray, "3 4"], points: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Points given in b, expressed in a."""
    return points @ a_from_b[:, :3].T + a_from_b[:, 3]


def check_rigid(a_from_b: Float[np.ndarray, "3 4"], name: str, tolerance: float = 1e-3) -> None:
    """Refuse a matrix whose left block is not a rotation.

    Raises:
        PoseError: not orthonormal within `tolerance`, a reflection, or not finite.
    """
    if not np.isfinite(a_from_b).all():
        raise PoseError(f"{name}: the pose holds NaN or Inf; export the poses again")
    rotation = a_from_b[:, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if off > tolerance:
        raise PoseError(
            f"{name}: the pose's rotation is not orthonormal (off by {off:.3g}, at most {tolerance:g} is"
            " rounding); remove scale and shear from the export"
        )
    if np.linalg.det(rotation) < 0:
        raise PoseError(f"{name}: the pose's rotation mirrors (determinant -1); fix the handedness")


def distort(camera: Camera, xy: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """Ideal image plane (z = 1) to the lens's distorted plane, OpenCV's model."""
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + camera.k1 * r2 + camera.k2 * r2 * r2
    dx = 2 * camera.p1 * x * y + camera.p2 * (r2 + 2 * x * x)
    dy = camera.p1 * (r2 + 2 * y * y) + 2 * camera.p2 * x * y
    return np.stack([x * radial + dx, y * radial + dy], axis=-1)


def project(camera: Camera, cam_points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
    """Pixel coordinates of points in front of the camera; NaN for z <= 0."""
    z = np.where(cam_points[..., 2:] > 0, cam_points[..., 2:], np.nan)
    xy = distort(camera, cam_points[..., :2] / z)
    return xy * [camera.fx, camera.fy] + [camera.cx, camera.cy]


def unproject(camera: Camera, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """Ideal image-plane coordinates (z = 1) of pixels; undoes the lens by fixed-point iteration."""
    target = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    xy = target.copy()
    for _ in range(20):
        xy = xy + (target - distort(camera, xy))
    return xy


def rays(camera: Camera) -> Float[np.ndarray, "h w 3"]:
    """Unit viewing direction of every pixel centre, camera frame."""
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    xy = unproject(camera, np.stack([u, v], axis=-1))
    directions = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def resized(camera: Camera, width: int, height: int) -> Camera:
    """The same camera sampled on another pixel grid over the same field of view."""
    sx, sy = width / camera.width, height / camera.height
    return Camera(
        width, height, camera.fx * sx, camera.fy * sy, camera.cx * sx, camera.cy * sy,
        camera.k1, camera.k2, camera.p1, camera.p2,
    )  # fmt: skip


def cropped(camera: Camera, rows: slice, columns: slice) -> Camera:
    """The same camera with a window of its pixels alone; what of a slice lies beyond the picture is left out."""
    top, bottom, _ = rows.indices(camera.height)
    left, right, _ = columns.indices(camera.width)
    return replace(camera, width=right - left, height=bottom - top, cx=camera.cx - left, cy=camera.cy - top)


def fibonacci_sphere(count: int) -> Float[np.ndarray, "d 3"]:
    """`count` nearly equal-area unit directions (Swinbank and Purser 2006)."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    azimuth = np.pi * (1 + 5**0.5) * i
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)


def angle_between(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
    """Radians between vectors, in double precision; atan2 keeps small angles exact where arccos loses them."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1))


def align_similarity(
    source: Float[np.ndarray, "n 3"], target: Float[np.ndarray, "n 3"]
) -> tuple[float, Float[np.ndarray, "3 4"]]:
    """Scale s and rigid target_from_source with target ~ R (s source) + t, least squares (Umeyama 1991)."""
    mu_s, mu_t = source.mean(0), target.mean(0)
    a, b = source - mu_s, target - mu_t
    u, d, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    scale = float((d * np.diag(sign)).sum() / (a * a).sum())
    return scale, np.concatenate([rotation, (mu_t - scale * rotation @ mu_s)[:, None]], axis=1)


def tangents(
    normals: Float[np.ndarray, "p 3"],
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """Two unit vectors that complete each normal to an orthonormal frame (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    return (
        np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1),
        np.stack([b, sign + y * y * a, -y], 1),
    )


def sphere_solid_angle(
    radius: float | Float[np.ndarray, "..."], distance: float | Float[np.ndarray, "..."]
) -> float | Float[np.ndarray, "..."]:
    """Solid angle of spheres seen from `distance` to their middles, steradians; a point is never taken to be inside."""
    sine = np.minimum(radius / distance, 0.99)
    return 2 * np.pi * (1 - np.sqrt(1 - sine**2))
