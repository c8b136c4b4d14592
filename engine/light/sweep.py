"""How far is the room behind each patch of background? Depths by agreement between views.

A plane sweep on small pictures: a patch of view i at depth z is seen by other views too, and at the right z
they agree. Where nothing has texture every depth agrees, and a prior decides: the depth of the SfM points
near that direction if there are any, else the typical depth of patches that are certain. Depths are z of
the view; world frame elsewhere; the misfit is in log radiance.
"""

from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float
from numba import njit

from engine.light.photographs import Photographs, camera_centres
from engine.light.rasterise import Run

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
# A misfit in log radiance that texture must exceed before it outweighs the prior by one e-fold of depth.
_PULL = 0.01
FEW_POINTS = 30  # from so many SfM points on, a sweep has something to lean on
_CAP = 0.5  # misfit beyond which two views simply do not show the same thing


@njit(**_FLAGS)
@no_type_check
def _misfit(poses, lens, pictures, weight, depths, view, others, out):
    """Mean capped difference of log radiance to other views, per pixel and depth; -1 where none looks."""
    _, height, width, _ = pictures.shape
    pose = poses[view]
    for v in range(height):
        for u in range(width):
            x, y = (u + 0.5 - lens[2]) / lens[0], (v + 0.5 - lens[3]) / lens[1]
            for d in range(depths.shape[0]):
                z = depths[d]
                a, b, c = x * z - pose[0, 3], y * z - pose[1, 3], z - pose[2, 3]
                wx = pose[0, 0] * a + pose[1, 0] * b + pose[2, 0] * c
                wy = pose[0, 1] * a + pose[1, 1] * b + pose[2, 1] * c
                wz = pose[0, 2] * a + pose[1, 2] * b + pose[2, 2] * c
                total, count = 0.0, 0
                for o in others:
                    other = poses[o]
                    far = other[2, 0] * wx + other[2, 1] * wy + other[2, 2] * wz + other[2, 3]
                    if far <= 0:
                        continue
                    right = other[0, 0] * wx + other[0, 1] * wy + other[0, 2] * wz + other[0, 3]
                    low = other[1, 0] * wx + other[1, 1] * wy + other[1, 2] * wz + other[1, 3]
                    s, t = lens[0] * right / far + lens[2] - 0.5, lens[1] * low / far + lens[3] - 0.5
                    if s < 0 or t < 0 or s > width - 1 or t > height - 1:
                        continue
                    i, j = min(int(s), width - 2), min(int(t), height - 2)
                    upper = min(weight[o, j, i], weight[o, j, i + 1])
                    if min(upper, weight[o, j + 1, i], weight[o, j + 1, i + 1]) <= 0:
                        continue
                    fs, ft = s - i, t - j
                    gap = 0.0
                    for ch in range(3):
                        top = pictures[o, j, i, ch] * (1 - fs) + pictures[o, j, i + 1, ch] * fs
                        bottom = pictures[o, j + 1, i, ch] * (1 - fs) + pictures[o, j + 1, i + 1, ch] * fs
                        gap += abs(top * (1 - ft) + bottom * ft - pictures[view, v, u, ch])
                    total += min(gap / 3, _CAP)
                    count += 1
                out[v, u, d] = total / count if count >= 2 else -1.0


def depth_range(centres: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "m 3"]) -> tuple[float, float]:
    """Nearest and farthest depth worth asking for, scene units.

    From the SfM points' distances if there are enough of them, else from how far the camera travelled: a room
    is neither much nearer than the path is long nor beyond where its parallax could be seen.
    """
    if len(points) >= FEW_POINTS:
        distance = np.linalg.norm(points[None] - centres[:, None], axis=-1)
        near, far = np.quantile(distance, [0.005, 0.98])
        return float(near) * 0.7, float(far) * 1.5
    travel = float(np.linalg.norm(centres - centres.mean(0), axis=1).max())
    if travel <= 0:
        return 0.5, 50.0  # a pure rotation: depth cannot be seen and does not matter
    return 0.3 * travel, 40 * travel


def sweep(
    photographs: Photographs, points: Float[np.ndarray, "m 3"], count: int, run: Run
) -> tuple[Float[np.ndarray, "n h w"], Float[np.ndarray, "n h w"]]:
    """Depth of every background pixel (NaN elsewhere), and how sure it is (0 prior only .. 1)."""
    n, height, width = photographs.weight.shape
    knee = knee_of(photographs)
    pictures = np.log(knee + photographs.radiance).astype(np.float32)
    poses, lens = photographs.cam_from_world, photographs.lens
    near, far = depth_range(camera_centres(photographs), points)
    depths = np.geomspace(near, far, count)
    forward = poses[:, 2, :3]
    cost = np.full((n, height, width, count), -1.0, np.float32)

    def some(part: int, parts: int) -> None:
        for i in range(part, n, parts):
            # Views that look the same way; among them a spread, so that both short and long baselines occur.
            close = np.argsort(-(forward @ forward[i]), kind="stable")[1:25]
            _misfit(poses, lens, pictures, photographs.weight, depths, i, close, cost[i])
            known = (cost[i] >= 0).astype(np.float32)
            total = cv2.blur(np.maximum(cost[i], 0), (3, 3), borderType=cv2.BORDER_REPLICATE)
            share = cv2.blur(known, (3, 3), borderType=cv2.BORDER_REPLICATE)
            cost[i] = np.where(share > 0.3, total / np.maximum(share, 1e-6), -1)

    run(some, ())
    shown = photographs.weight > 0
    blind = (cost < 0).all(-1)
    best = np.where(cost < 0, np.inf, cost)
    lowest = np.where(blind, 0, best.min(-1))
    # Contrast between the best depth and the average one is what texture bought.
    typical = np.where(cost < 0, np.nan, cost)
    typical[blind] = 0
    gain = np.nanmean(typical, axis=-1) - lowest
    sure = np.where(blind | ~shown, 0, np.clip(gain / (10 * _PULL) - lowest, 0, 1))
    first = depths[np.argmin(best, axis=-1)]
    certain = sure > 0.5
    fallback = float(np.median(first[certain])) if certain.sum() > 50 else float(np.sqrt(near * far))
    prior = _prior(photographs, points, fallback)
    pull = _PULL * np.abs(np.log(depths / prior[..., None]))
    total = np.where(cost < 0, np.where(np.asarray(blind)[..., None], 0, _CAP), cost) + pull
    depth = depths[np.argmin(total, axis=-1)]
    return np.where(shown, depth, np.nan), sure


def knee_of(photographs: Photographs) -> float:
    """The 1 of log(1 + m) in Eq. (5), in this session's radiance: half the median background luminance."""
    values = photographs.radiance.mean(-1)[photographs.weight > 0]
    return max(0.5 * float(np.median(values)), 1e-3 * float(values.mean()), 1e-12)


def _prior(
    photographs: Photographs, points: Float[np.ndarray, "m 3"], fallback: float
) -> Float[np.ndarray, "n h w"]:
    """Depth expected before looking: that of the nearest SfM points in the picture, or the fallback."""
    n, height, width = photographs.weight.shape
    prior = np.full((n, height, width), fallback)
    if len(points) < FEW_POINTS:
        return prior
    for i in range(n):
        cam = points @ photographs.cam_from_world[i, :, :3].T + photographs.cam_from_world[i, :, 3]
        cam = cam[cam[:, 2] > 0]
        u = (photographs.lens[0] * cam[:, 0] / cam[:, 2] + photographs.lens[2]).astype(int)
        v = (photographs.lens[1] * cam[:, 1] / cam[:, 2] + photographs.lens[3]).astype(int)
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        total, weight = np.zeros((height, width)), np.zeros((height, width))
        np.add.at(total, (v[inside], u[inside]), np.log(cam[inside, 2]))
        np.add.at(weight, (v[inside], u[inside]), 1.0)
        spread = 0.08 * width
        total, weight = cv2.GaussianBlur(total, (0, 0), spread), cv2.GaussianBlur(weight, (0, 0), spread)
        faint = 1e-4 * weight.max() + 1e-12
        prior[i] = np.exp((total + faint * np.log(fallback)) / (weight + faint))
    return prior
