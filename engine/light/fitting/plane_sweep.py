"""How far is the room behind each patch of background? Depths by agreement between views.

A plane sweep on small pictures: a patch of view i at depth z is seen by other views too, and at the right z
they agree better than at the others. What a view says of a depth is how much better it agrees there than on
average over the depths at which it sees the patch; views that do not see it there say nothing. (A mean over whoever
looks would favour near depths: there the fewest look, and from the closest by.) Neighbouring pixels then settle on
depths together, by semi-global matching (Hirschmueller 2008), and where nothing has texture a prior decides: the
depth of the SfM points near that direction if there are any, else the depth at which all pixels together agree best. Depths
are z of the view; world frame elsewhere; the misfit is in log radiance.
"""

from dataclasses import dataclass
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float, Int
from numba import njit

from engine.light.fitting.training_views import Photographs, camera_centres, project_point, world_point
from engine.light.gaussians.rasterize import ThreadPool

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
FEW_POINTS = 30  # from so many SfM points on, a sweep has something to lean on
_OTHERS = 24  # views that are asked
_CAP = 0.2  # misfit in log radiance beyond which two views simply do not show the same thing
_PULL = 0.01  # misfit that outweighs the prior by one e-fold of depth
_BEND = 0.5  # misfit that lets neighbours differ by one e-fold of depth
_BREAK = 0.3  # misfit that lets them differ by any depth, less across an edge
_EDGE = 0.1  # step in log radiance that halves _BREAK
_STRAY = 0.5  # log depth by which a point may differ from those around it
_TELLING = 0.01  # by how much views must agree better than on average for their agreement to count in full
_ALIKE = 0.1  # log depth within which views agree on a place


@njit(**_FLAGS)
@no_type_check
def _photo_consistency(poses, lens, pictures, weight, depths, view, others, out):
    """How much worse other views agree at each depth than they do on average, mean over the views that look."""
    _, height, width, _ = pictures.shape
    pose, count = poses[view], depths.shape[0]
    gaps, places = np.empty(count), np.empty((count, 3))
    for v in range(height):
        for u in range(width):
            if weight[view, v, u] <= 0:
                continue
            for d in range(count):
                places[d, 0], places[d, 1], places[d, 2] = world_point(pose, lens, u, v, depths[d])
            asked = 0
            for o in others:
                total, looks = 0.0, 0
                for d in range(count):
                    gaps[d] = -1.0
                    s, t, _ = project_point(poses[o], lens, places[d, 0], places[d, 1], places[d, 2])
                    s, t = s - 0.5, t - 0.5
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
                    gaps[d] = min(gap / 3, _CAP)
                    total += gaps[d]
                    looks += 1
                if looks < 2:
                    continue
                asked += 1
                for d in range(count):
                    if gaps[d] >= 0:
                        out[v, u, d] += gaps[d] - total / looks
            for d in range(count):
                out[v, u, d] /= max(asked, 1)


@njit(**_FLAGS)
@no_type_check
def _semi_global_matching(cost, brightness, bend):
    """Costs with those of eight paths to each pixel added; `bend` is the price of a step to the next depth."""
    height, width, count = cost.shape
    total = np.zeros_like(cost)
    along = np.empty_like(cost)
    for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
        for row in range(height):
            v = row if dv >= 0 else height - 1 - row
            for column in range(width):
                u = column if du >= 0 else width - 1 - column
                b, a = v - dv, u - du
                here = along[v, u]
                if a < 0 or b < 0 or a >= width or b >= height:
                    here[:] = 0
                else:
                    least = along[b, a].min()
                    edge = abs(brightness[v, u] - brightness[b, a]) / _EDGE
                    dearest = least + _BREAK / (1 + edge)
                    for d in range(count):
                        here[d] = min(along[b, a, d], dearest)
                    for d in range(1, count):
                        here[d] = min(here[d], here[d - 1] + bend)
                    for d in range(count - 2, -1, -1):
                        here[d] = min(here[d], here[d + 1] + bend)
                    here -= least
                here += cost[v, u]
                total[v, u] += here
    return total


@njit(**_FLAGS)
@no_type_check
def _agreement(poses, lens, depth, view, others, out):
    """Share of the views looking at or through a pixel's place that see a surface there; 0 if fewer than two do."""
    _, height, width = depth.shape
    pose = poses[view]
    for v in range(height):
        for u in range(width):
            z = depth[view, v, u]
            if not z > 0:
                continue
            wx, wy, wz = world_point(pose, lens, u, v, z)
            there, looks = 0, 0
            for o in others:
                s, t, far = project_point(poses[o], lens, wx, wy, wz)
                if s < 0 or t < 0 or s >= width or t >= height:
                    continue
                seen = depth[o, int(t), int(s)]
                if not seen > 0 or far > seen * (1 + _ALIKE):  # something nearer hides the place
                    continue
                looks += 1
                there += far > seen / (1 + _ALIKE)
            out[v, u] = there / looks if there >= 2 else 0.0


def depth_range(centres: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "m 3"]) -> tuple[float, float]:
    """Nearest and farthest depth worth asking for, scene units.

    From the SfM points' distances if there are enough of them, else from how far the camera travelled: a room
    is neither much nearer than the path is long nor beyond where its parallax could be seen.
    """
    if len(points) >= FEW_POINTS:
        distance = np.linalg.norm(points[None] - centres[:, None], axis=-1)
        near, far = np.quantile(distance, [0.02, 0.98])
        return float(near) * 0.7, float(far) * 1.5
    travel = float(np.linalg.norm(centres - centres.mean(0), axis=1).max())
    if travel <= 0:
        return 0.5, 50.0  # a pure rotation: depth cannot be seen and does not matter
    return 0.3 * travel, 100 * travel


def sweep(
    photographs: Photographs, points: Float[np.ndarray, "m 3"], count: int, run: ThreadPool
) -> tuple[Float[np.ndarray, "n h w"], Float[np.ndarray, "n h w"]]:
    """Depth of every background pixel (NaN elsewhere), and how sure it is (0 prior only .. 1)."""
    near, far = depth_range(camera_centres(photographs), points)
    depths = np.geomspace(near, far, count)
    matching = _Matching.of(photographs, depths)
    middle = float(np.sqrt(near * far)) if len(points) >= FEW_POINTS else matching.typical_depth(run)
    return matching.regularized_depth(_prior(photographs, points, middle), run)


@dataclass(frozen=True, slots=True, eq=False)
class _Matching:
    """Photographs whose pixels are compared at some depths."""

    photographs: Photographs
    depths: Float[np.ndarray, " d"]
    pictures: Float[np.ndarray, "n h w 3"]  # log radiance
    close: Int[np.ndarray, "n o"]  # the views that each is compared with

    @classmethod
    def of(cls, photographs: Photographs, depths: Float[np.ndarray, " d"]) -> "_Matching":
        axes = photographs.cam_from_world[:, 2, :3]
        # Noise may have taken dark pixels below zero.
        pictures = np.log(knee_of(photographs) + np.maximum(photographs.radiance, 0)).astype(np.float32)
        alike = axes @ axes.T
        np.fill_diagonal(alike, np.inf)  # of several views that look the same way, the first is itself
        # Views that look the same way; among them a spread, so that both short and long baselines occur.
        close = np.argsort(-alike, axis=1, kind="stable")[:, 1 : 1 + _OTHERS]
        return cls(photographs, depths, pictures, close)

    def cost(self, i: int) -> Float[np.ndarray, "h w d"]:
        """Of every pixel of a view at every depth."""
        photographs = self.photographs
        cost = np.zeros((*photographs.weight.shape[1:], len(self.depths)), np.float32)
        _photo_consistency(
            photographs.cam_from_world,
            photographs.lens,
            self.pictures,
            photographs.weight,
            self.depths,
            i,
            self.close[i],
            cost,
        )
        return cost

    def typical_depth(self, run: ThreadPool) -> float:
        """The depth at which all background pixels together agree best."""
        means = np.zeros((len(self.pictures), len(self.depths)))

        def add(part: int, parts: int) -> None:
            for i in range(part, len(means), parts):
                means[i] = self.cost(i).sum((0, 1))

        run(add, ())
        return float(self.depths[means.sum(0).argmin()])

    def regularized_depth(
        self, prior: Float[np.ndarray, "n h w"], run: ThreadPool
    ) -> tuple[Float[np.ndarray, "n h w"], Float[np.ndarray, "n h w"]]:
        """`sweep`, given what is expected of each pixel."""
        photographs, depths = self.photographs, self.depths
        n, height, width = photographs.weight.shape
        bend = np.float32(_BEND * np.log(depths[1] / depths[0]))
        depth, contrast, agreed = (np.zeros((n, height, width)) for _ in range(3))

        def settle(part: int, parts: int) -> None:
            for i in range(part, n, parts):
                cost = cv2.blur(self.cost(i), (3, 3), borderType=cv2.BORDER_REPLICATE)
                pull = _PULL * np.abs(np.log(depths / prior[i][..., None]))
                brightness = self.pictures[i].mean(-1)
                total = _semi_global_matching((cost + pull).astype(np.float32), brightness, bend)
                depth[i], best = _lowest(total, depths)
                contrast[i] = -np.take_along_axis(cost, best, -1)[..., 0]

        def compare(part: int, parts: int) -> None:
            for i in range(part, n, parts):
                _agreement(photographs.cam_from_world, photographs.lens, depth, i, self.close[i], agreed[i])

        run(settle, ())
        depth[photographs.weight <= 0] = np.nan
        run(compare, ())
        return depth, agreed * np.clip(contrast / _TELLING, 0, 1)


def _lowest(
    cost: Float[np.ndarray, "h w d"], depths: Float[np.ndarray, " d"]
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w 1"]]:
    """Depth of the lowest cost, between the depths tried by a parabola in log depth; and which of them it is next to."""
    best = cost.argmin(-1)[..., None]
    inner = np.clip(best, 1, len(depths) - 2)
    before, here, after = (np.take_along_axis(cost, inner + k, -1).astype(float) for k in (-1, 0, 1))
    bent = before - 2 * here + after
    shift = np.where(bent > 0, 0.5 * (before - after) / np.maximum(bent, 1e-12), 0)
    shift = np.where(inner == best, np.clip(shift, -0.5, 0.5), 0)
    return (depths[best] * (depths[1] / depths[0]) ** shift)[..., 0], best


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

    def around(v: np.ndarray, u: np.ndarray, known: np.ndarray) -> Float[np.ndarray, "h w"]:
        """Mean of what is known near each pixel, the fallback's logarithm far from all."""
        total, weight = np.zeros((height, width)), np.zeros((height, width))
        np.add.at(total, (v, u), known)
        np.add.at(weight, (v, u), 1.0)
        total, weight = (cv2.GaussianBlur(x, (0, 0), 0.08 * width) for x in (total, weight))
        faint = 1e-4 * weight.max() + 1e-12
        return (total + faint * np.log(fallback)) / (weight + faint)

    for i in range(n):
        cam = points @ photographs.cam_from_world[i, :, :3].T + photographs.cam_from_world[i, :, 3]
        cam = cam[cam[:, 2] > 0]
        u = (photographs.lens[0] * cam[:, 0] / cam[:, 2] + photographs.lens[2]).astype(int)
        v = (photographs.lens[1] * cam[:, 1] / cam[:, 2] + photographs.lens[3]).astype(int)
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        u, v, known = u[inside], v[inside], np.log(cam[inside, 2])
        # Wrong points are few but far off: those that differ from their surroundings are left out.
        fits = np.abs(known - around(v, u, known)[v, u]) < _STRAY
        prior[i] = np.exp(around(v[fits], u[fits], known[fits]))
    return prior
