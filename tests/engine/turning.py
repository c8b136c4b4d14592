"""A cheap capture for tests: a distant painted room turns about an object that stays put in the image.

Background: the room looked up along each pixel's ray. Object: albedo times the room's irradiance (order-2
spherical harmonics, Ramamoorthi and Hanrahan 2001) plus a glossy part, the blurred room along the mirror direction.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from engine.types import Frames

ROOM_H, ROOM_W = 256, 512


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    frames: Frames
    mask: np.ndarray


def blob(h: int, w: int) -> np.ndarray:
    """A lobed outline with a hole and a thin handle."""
    y, x = np.mgrid[:h, :w]
    dx, dy = (x + 0.5 - w / 2) / h, (y + 0.5 - h * 0.55) / h
    angle, radius = np.arctan2(dy, dx), np.hypot(dx, dy)
    mask = radius < 0.22 + 0.05 * np.cos(3 * angle) + 0.02 * np.sin(7 * angle)
    mask &= np.hypot(dx - 0.05, dy - 0.02) > 0.045
    ring = np.hypot(dx + 0.27, dy)
    return mask | ((ring < 0.13) & (ring > 0.105))


def disc(h: int, w: int) -> np.ndarray:
    y, x = np.mgrid[:h, :w]
    return np.hypot(x + 0.5 - w * 0.45, y + 0.5 - h * 0.5) < 0.27 * h


def take(
    mask: np.ndarray,
    views: int,
    seed: int,
    texture: float = 0.5,
    gloss: float = 0.1,
    noise: float = 0.01,
    yaw_only: bool = False,
) -> Capture:
    """`texture` is the standard deviation of the room's log paint, 0 for bare walls."""
    rng = np.random.default_rng(seed)
    h, w = mask.shape
    room = _room(rng, texture)
    y, x = np.mgrid[:h, :w]
    rays = np.dstack([(x + 0.5 - w / 2) / (0.9 * w), (y + 0.5 - h / 2) / (0.9 * w), np.ones((h, w))])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    normal = _inflated(mask)
    mirror = rays - 2 * (rays * normal).sum(-1, keepdims=True) * normal
    albedo = 0.3 + 0.5 * (_paint(rng, h, w, 9) > 0.3)[..., None] * rng.uniform(0.4, 1.0, 3)
    soft = cv2.GaussianBlur(room, (0, 0), 12)
    harmonics = _project(room)
    images = []
    for n in range(views):
        turn = Rotation.from_rotvec([0, 2 * np.pi * n / views, 0]) if yaw_only else Rotation.random(rng=rng)
        world = turn.as_matrix().T  # world_from_cam
        light = np.maximum(_irradiance(harmonics, normal @ world.T), 1e-3)
        surface = albedo * light / np.pi + gloss * _look(soft, mirror @ world.T)
        images.append(np.where(mask[..., None], surface, _look(room, rays @ world.T)))
    clean = np.stack(images)
    noisy = clean * (1 + noise * rng.standard_normal(clean.shape))
    flags = np.zeros((views, h, w), bool)
    names = tuple(f"{n:04d}" for n in range(views))
    level = float(np.median(clean))
    frames = Frames(
        names, np.maximum(noisy, 0).astype(np.float32), flags, flags, (noise**2 * level, 1e-4 * level)
    )
    return Capture(frames, mask)


def _paint(rng: np.random.Generator, h: int, w: int, cells: int) -> np.ndarray:
    coarse = rng.standard_normal((max(2, cells * h // w), cells)).astype(np.float32)
    return cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)


def _room(rng: np.random.Generator, texture: float) -> np.ndarray:
    """Equirectangular: six walls of different grey, paint at several scales, two windows and a lamp."""
    v, u = np.mgrid[:ROOM_H, :ROOM_W]
    theta, phi = np.pi * (v + 0.5) / ROOM_H, 2 * np.pi * (u + 0.5) / ROOM_W
    d = np.dstack([np.sin(theta) * np.sin(phi), -np.cos(theta), np.sin(theta) * np.cos(phi)])
    wall = np.abs(d).argmax(-1) * 2 + (np.take_along_axis(d, np.abs(d).argmax(-1)[..., None], 2)[..., 0] > 0)
    room = rng.uniform(0.3, 0.8, (6, 1))[wall] * rng.uniform(0.9, 1.1, (6, 3))[wall]
    for cells in (16, 48, 120):
        for channel in range(3):
            shared = 0.7 * _paint(rng, ROOM_H, ROOM_W, cells) + 0.3 * _paint(rng, ROOM_H, ROOM_W, cells)
            room[..., channel] *= np.exp(texture / np.sqrt(3) * shared)
    room[60:110, 100:140] = (6.0, 6.5, 7.0)
    room[80:120, 330:350] = (9.0, 8.0, 6.0)
    room[150:158, 230:238] = (60.0, 50.0, 40.0)
    return room.astype(np.float32)


def _look(room: np.ndarray, directions: np.ndarray) -> np.ndarray:
    phi = np.arctan2(directions[..., 0], directions[..., 2]) % (2 * np.pi)
    theta = np.arccos(np.clip(-directions[..., 1], -1, 1))
    u = (phi / (2 * np.pi) * ROOM_W - 0.5).astype(np.float32)
    v = (theta / np.pi * ROOM_H - 0.5).astype(np.float32)
    return cv2.remap(room, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)


def _basis(d: np.ndarray) -> np.ndarray:
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    return np.stack(
        [
            np.full_like(x, 0.282095), 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y,
            1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y),
        ],
        axis=-1,
    )  # fmt: skip


def _project(room: np.ndarray) -> np.ndarray:
    v, u = np.mgrid[:ROOM_H, :ROOM_W]
    theta, phi = np.pi * (v + 0.5) / ROOM_H, 2 * np.pi * (u + 0.5) / ROOM_W
    d = np.dstack([np.sin(theta) * np.sin(phi), -np.cos(theta), np.sin(theta) * np.cos(phi)])
    area = np.sin(theta) * (np.pi / ROOM_H) * (2 * np.pi / ROOM_W)
    lobe = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
    return np.einsum("hwb,hwc,hw->bc", _basis(d), room, area) * lobe[:, None]


def _irradiance(harmonics: np.ndarray, normal: np.ndarray) -> np.ndarray:
    return _basis(normal) @ harmonics


def _inflated(mask: np.ndarray) -> np.ndarray:
    """Normals of a cushion over the mask, facing the camera."""
    height = np.sqrt(cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5) + 0.1) * 4
    height = cv2.GaussianBlur(height, (0, 0), 2)
    gy, gx = np.gradient(height)
    normal = np.dstack([-gx, -gy, -np.ones_like(gx)])
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)
