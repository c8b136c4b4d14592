"""Photographs as the light sees them: ideal pinholes at chosen sizes, with what may be trusted.

A lens is undone at full size by bilinear lookup, on a pinhole wide enough to keep every pixel; smaller sizes
are area means over background pixels only, so the object never bleeds into the room and energy is kept.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from engine.geometry import distort, unproject
from engine.light.gaussians.rasterize import Pinhole
from engine.types import Camera, Frames, Masks, Poses

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}


@dataclass(frozen=True, slots=True, eq=False)
class Photographs:
    """Views of one size. `weight` is the share of a pixel that shows the room; 0 where nothing does."""

    cam_from_world: Float[np.ndarray, "n 3 4"]
    lens: Float[np.ndarray, " 4"]  # fx fy cx cy
    radiance: Float[np.ndarray, "n h w 3"]
    weight: Float[np.ndarray, "n h w"]
    clipped: Bool[np.ndarray, "n h w"]  # radiance is a lower bound

    def pinhole(self, view: int) -> Pinhole:
        """The camera of one view."""
        _, height, width = self.weight.shape
        return Pinhole(self.cam_from_world[view], self.lens, width, height)

    def of_views(self, views: Int[np.ndarray, " k"]) -> "Photographs":
        """Some of the views."""
        some = (x[views] for x in (self.radiance, self.weight, self.clipped))
        return Photographs(self.cam_from_world[views], self.lens, *some)

    def image_of(
        self, point: Float[np.ndarray, " 3"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 3"]]:
        """Where a world point falls in every view (u, v; NaN behind the camera), and where it is in its frame."""
        cam = self.cam_from_world[:, :, :3] @ point + self.cam_from_world[:, :, 3]
        z = np.where(cam[:, 2] > 0, cam[:, 2], np.nan)
        return self.lens[:2] * cam[:, :2] / z[:, None] + self.lens[2:], cam


# Inlined: a cached kernel that calls another does not see it change, and may round differently with it.
@njit(inline="always", **_FLAGS)
@no_type_check
def world_point(pose, lens, u, v, z):
    """The world point at depth z of a pixel's middle."""
    a = (u + 0.5 - lens[2]) / lens[0] * z - pose[0, 3]
    b = (v + 0.5 - lens[3]) / lens[1] * z - pose[1, 3]
    c = z - pose[2, 3]
    return (
        pose[0, 0] * a + pose[1, 0] * b + pose[2, 0] * c,
        pose[0, 1] * a + pose[1, 1] * b + pose[2, 1] * c,
        pose[0, 2] * a + pose[1, 2] * b + pose[2, 2] * c,
    )


@njit(inline="always", **_FLAGS)
@no_type_check
def project_point(pose, lens, x, y, z):
    """Where a world point falls in one view (u, v; both -1 behind the camera), and its depth: `image_of` for kernels."""
    far = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    if far <= 0:
        return -1.0, -1.0, far
    right = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
    low = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
    return lens[0] * right / far + lens[2], lens[1] * low / far + lens[3], far


def window_around(
    height: int, width: int, u: float, v: float, reach: float
) -> tuple[slice, slice, Float[np.ndarray, "a b"]]:
    """A picture's rows and columns within `reach` of a place, and each of those pixels' distance from it."""
    rows = slice(max(0, int(v - reach)), min(height, int(v + reach) + 2))
    columns = slice(max(0, int(u - reach)), min(width, int(u + reach) + 2))
    y, x = np.mgrid[rows, columns] + 0.5
    return rows, columns, np.hypot(x - u, y - v)


def pinhole_of(camera: Camera, width: int) -> tuple[Float[np.ndarray, " 4"], int, int]:
    """Lens (fx fy cx cy), width and height of the ideal pinhole, `width` for the camera's own width.

    With distortion the picture grows as far as the undistorted pixels reach.
    """
    left, top, right, bottom = 0.0, 0.0, float(camera.width), float(camera.height)
    if camera.k1 or camera.k2 or camera.p1 or camera.p2:
        u, v = np.linspace(0, camera.width, 65), np.linspace(0, camera.height, 65)
        edge = np.concatenate(
            [np.stack([u, np.full_like(u, y)], 1) for y in (0, camera.height)]
            + [np.stack([np.full_like(v, x), v], 1) for x in (0, camera.width)]
        )
        ideal = unproject(camera, edge.astype(np.float64)) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        left, top = np.floor(ideal.min(0))
        right, bottom = np.ceil(ideal.max(0))
    scale = width / camera.width
    wide, high = max(1, round((right - left) * scale)), max(1, round((bottom - top) * scale))
    sx, sy = wide / (right - left), high / (bottom - top)
    lens = np.array([camera.fx * sx, camera.fy * sy, (camera.cx - left) * sx, (camera.cy - top) * sy])
    return lens, wide, high


@lru_cache(2)  # asked for every photograph of one camera
def _undistort_maps(camera: Camera) -> tuple[np.ndarray, np.ndarray] | None:
    """Source pixel of every full-size pinhole pixel, OpenCV's corner convention; None for an ideal lens."""
    if not (camera.k1 or camera.k2 or camera.p1 or camera.p2):
        return None
    lens, width, height = pinhole_of(camera, camera.width)
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    xy = np.stack([(u - lens[2]) / lens[0], (v - lens[3]) / lens[1]], axis=-1)
    source = distort(camera, xy) * [camera.fx, camera.fy] + [camera.cx, camera.cy] - 0.5
    return source[..., 0].astype(np.float32), source[..., 1].astype(np.float32)


def _straight(picture: np.ndarray, maps: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    return picture if maps is None else cv2.remap(picture, *maps, cv2.INTER_LINEAR, borderValue=0)


def _smaller(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    if picture.shape[:2] == (height, width):
        return picture
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def shown_background(
    background: Bool[np.ndarray, "h w"], camera: Camera, width: int
) -> Bool[np.ndarray, "small_h small_w"]:
    """Where a small ideal view is mostly background."""
    _, wide, high = pinhole_of(camera, width)
    return _smaller(_straight(background.astype(np.float32), _undistort_maps(camera)), wide, high) > 0.5


def partly_marked(
    picture: Bool[np.ndarray, "h w"], camera: Camera, width: int
) -> Bool[np.ndarray, "small_h small_w"]:
    """Where a small ideal view holds any of what is marked."""
    _, wide, high = pinhole_of(camera, width)
    return _smaller(_straight(picture.astype(np.float32), _undistort_maps(camera)), wide, high) > 0


def resample(frames: Frames, masks: Masks, poses: Poses, views: np.ndarray, width: int) -> Photographs:
    """The views at `width` pixels for the camera's width (at most that), on ideal pinholes."""
    camera = poses.camera
    lens, wide, high = pinhole_of(camera, min(width, camera.width))
    maps = _undistort_maps(camera)
    radiance = np.zeros((len(views), high, wide, 3), np.float32)
    weight = np.zeros((len(views), high, wide), np.float32)
    clipped = np.zeros((len(views), high, wide), bool)
    for i, view in enumerate(views):
        good = masks.background[view]
        share = good.astype(np.float32)
        room = np.where(good[..., None], frames.radiance[view], np.float32(0))
        weight[i] = _smaller(_straight(share, maps), wide, high)
        room = _smaller(_straight(room, maps), wide, high)
        radiance[i] = room / np.maximum(weight[i], 1e-6)[..., None]
        cut = (frames.clipped[view] & good).astype(np.float32)
        if cut.any():
            # One clipped pixel makes a mean a lower bound too.
            clipped[i] = _smaller(_straight(cut, maps), wide, high) > 0
    weight[weight < 0.5] = 0
    return Photographs(np.ascontiguousarray(poses.cam_from_world[views]), lens, radiance, weight, clipped)


def camera_centres(photographs: Photographs) -> Float[np.ndarray, "n 3"]:
    """Centres of projection, world frame."""
    poses = photographs.cam_from_world
    return -np.einsum("nij,ni->nj", poses[:, :, :3], poses[:, :, 3])
