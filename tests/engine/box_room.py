"""A textured room of boxes, ray cast in numpy: views with known poses for the tests of `engine.sfm.reconstruct`.

World frame: y down, metres; the room is 5 x 2.8 x 4 with its centre at the origin. Every face of every box
has its own band-limited noise texture, so nothing in it repeats. Radiance has a lamp-lit falloff.
"""

import cv2
import numpy as np

from engine.geometry import inverse, rays
from engine.types import Camera

ROOM = np.array([5.0, 2.8, 4.0]) / 2


def _texture(rng: np.random.Generator, size: int = 512) -> np.ndarray:
    total = np.zeros((size, size, 3), np.float32)
    for cells, weight in ((6, 1.0), (20, 0.8), (60, 0.6), (170, 0.35)):
        coarse = rng.normal(size=(cells, cells, 1)) + 0.4 * rng.normal(size=(cells, cells, 3))
        total += weight * cv2.resize(coarse.astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC)
    return np.exp(0.5 * total) * 0.3


def _boxes(rng: np.random.Generator, count: int) -> np.ndarray:
    """[b 2 3] corners; the first is the room itself, seen from inside; none reaches the middle."""
    boxes = [np.stack([-ROOM, ROOM])]
    while len(boxes) <= count:
        size = rng.uniform(0.3, 1.0, 3)
        centre = rng.uniform(-ROOM, ROOM)
        # Furniture: kept a metre from the middle horizontally, where the camera moves.
        if np.hypot(centre[0], centre[2]) > 1.2 + np.hypot(size[0], size[2]) / 2:
            boxes.append(np.stack([centre - size / 2, centre + size / 2]))
    return np.stack(boxes)


def render(
    camera: Camera, poses: np.ndarray, seed: int = 0, boxes: int = 12, noise: float = 0.01
) -> np.ndarray:
    """Radiance [n h w 3] at every cam_from_world of `poses`."""
    rng = np.random.default_rng(seed)
    corners = _boxes(rng, boxes)
    atlas = np.stack([_texture(rng) for _ in range(6 * len(corners))])
    lamp = np.array([1.0, -1.1, 0.5])
    ray = rays(camera).reshape(-1, 3).astype(np.float32)
    corners = corners.astype(np.float32)
    out = np.empty((len(poses), camera.height, camera.width, 3), np.float32)
    for n, world_from_cam in enumerate(inverse(poses)):
        direction = ray @ world_from_cam[:, :3].T.astype(np.float32)
        origin = world_from_cam[:, 3].astype(np.float32)
        along = np.ascontiguousarray(direction.T)  # rays last: numpy is slow along an axis of three
        with np.errstate(divide="ignore", invalid="ignore"):
            slabs = (corners - origin)[..., None] / along  # b 2 3 r
        near, far = slabs.min(1), slabs.max(1)
        t_in, t_out = near.max(1), far.min(1)
        t = np.where((t_in < t_out) & (t_in > 1e-6), t_in, np.inf)
        t[0] = t_out[0]
        box = t.argmin(0)
        r = np.arange(len(ray))
        axis = np.where(box == 0, far[0].argmin(0), near[box, :, r].argmax(1))
        hit = origin + direction * t[box, r][:, None]
        side = hit[r, axis] > corners[box].mean(1)[r, axis]
        u = hit[r, (axis + 1) % 3] / 2.5 + 0.5
        v = hit[r, (axis + 2) % 3] / 2.5 + 0.5
        face = box * 6 + axis * 2 + side
        # Bilinear lookup, mirrored at the texture's border.
        uv = np.stack([u, v], 1) * 511
        uv = 511 - np.abs(511 - np.mod(uv, 1022))
        i = np.clip(np.floor(uv).astype(int), 0, 510)
        f = (uv - i)[..., None]
        colour = (
            atlas[face, i[:, 1], i[:, 0]] * (1 - f[:, 0]) * (1 - f[:, 1])
            + atlas[face, i[:, 1], i[:, 0] + 1] * f[:, 0] * (1 - f[:, 1])
            + atlas[face, i[:, 1] + 1, i[:, 0]] * (1 - f[:, 0]) * f[:, 1]
            + atlas[face, i[:, 1] + 1, i[:, 0] + 1] * f[:, 0] * f[:, 1]
        )
        colour = colour / (0.3 + ((hit - lamp) ** 2).sum(1))[:, None]
        image = colour.reshape(camera.height, camera.width, 3)
        out[n] = image * (1 + noise * rng.normal(size=image.shape))
    return np.maximum(out, 1e-5)


def distance_to_surfaces(points: np.ndarray, seed: int = 0, boxes: int = 12) -> np.ndarray:
    """Metres from each point to the nearest face of a box of `render`'s room."""
    corners = _boxes(np.random.default_rng(seed), boxes)
    over = np.maximum(corners[:, 0] - points[:, None], points[:, None] - corners[:, 1])  # m b 3
    outside = np.linalg.norm(np.maximum(over, 0), axis=-1)
    return np.where(outside > 0, outside, np.abs(over).min(-1)).min(1)


def look(yaw: float, pitch: float, roll: float, centre: np.ndarray) -> np.ndarray:
    """cam_from_world of a camera at `centre`, turned about y, then x, then z (radians)."""
    turn = cv2.Rodrigues(np.array([0, 0, roll]))[0] @ cv2.Rodrigues(np.array([pitch, 0, 0]))[0]
    rotation = turn @ cv2.Rodrigues(np.array([0, yaw, 0]))[0]
    return np.column_stack([rotation, -rotation @ centre])


def handheld(count: int, seed: int = 0, reach: float = 0.3) -> np.ndarray:
    """Two turns about the vertical, nodding and rolling, at places within `reach` of the middle."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / count
    wander = rng.normal(size=(count, 3)) * reach / 3
    nod = 0.5 * np.sin(2 * np.pi * 5 * t) + rng.normal(size=count) * 0.05
    roll = 0.35 * np.sin(2 * np.pi * 3 * t + 1) + rng.normal(size=count) * 0.05
    return np.stack([look(4 * np.pi * t[i], nod[i], roll[i], wander[i]) for i in range(count)])


def on_arm(pan: float, radius: float) -> np.ndarray:
    forward = cv2.Rodrigues(np.array([0, pan, 0]))[0].T @ np.array([0, 0, 1.0])
    return -radius * forward
