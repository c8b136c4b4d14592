"""A depth map as the skin of something solid: what stands before a jump of the depth is about as deep as it is wide.

The camera sees fronts only. Behind the edge of a ridge there is more of the ridge, behind that of a wire there is a gap
for light to come through; what tells them apart is how far their front reaches sideways. Camera frame.
"""

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.surface.observations import numbered

JUMP = 8.0
"""Step in depth between neighbours, in widths of a pixel, from which on the front ends there."""
DEEP, LEAST = 1.0, 2.0
"""Depth of what stands before a jump, in widths of its front and in pixels at least. Half as deep and as deep are as good, under
the true depth: within .5 of 9 degrees on wires, the same on flutes."""
AXES = ((0, 1), (1, 1), (1, 0), (1, -1))


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """A depth map's triangles.

    Vertices are the mask's pixels in row order, and after them those where a wall ends in nothing. `pixels` are who the corners
    belong to: such an end to the pixel that the wall hangs from. `deep` is how deep what each pixel shows is taken to be; all
    are 0 where no front ends.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    pixels: Int[np.ndarray, "t 3"]
    deep: Float[np.ndarray, " p"]


def skin(points: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> Skin:
    """The mesh of a depth map. A jump is closed by a wall where the nearer side is as deep as the jump, and left open behind
    that depth where it is not."""
    triangles = halves(mask)
    vertices = points[mask]
    pitch = pitch_of(points, mask)
    z = vertices[triangles][..., 2]
    rise = z.max(1) - z.min(1)
    broken = rise > JUMP * pitch * z.min(1)
    if not broken.any():
        return Skin(vertices, triangles, triangles, np.zeros(len(vertices)))
    near = triangles[np.arange(len(z)), z.argmin(1)]
    across = np.maximum(DEEP * widths(points[..., 2], mask, JUMP * pitch)[mask], LEAST)
    deep = across * pitch * vertices[:, 2]
    ends = (vertices[:, 2] + deep)[near]
    open_ = broken & (z.max(1) > ends)
    hanging = vertices[triangles[open_]]
    hanging *= np.minimum(1, ends[open_, None] / hanging[..., 2])[..., None]
    new = len(vertices) + np.arange(hanging.size // 3).reshape(-1, 3)
    beyond = z[open_] > ends[open_, None]
    whose = np.where(beyond, near[open_, None], triangles[open_])
    return Skin(
        np.concatenate([vertices, hanging.reshape(-1, 3)]),
        np.concatenate([triangles[~open_], new]),
        np.concatenate([triangles[~open_], whose]),
        deep,
    )


def halves(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "t 3"]:
    """Two triangles for every four neighbours, as far as they are of the mask; pixels are numbered in its row order."""
    index = numbered(mask)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = np.concatenate(
        [np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)]
    )
    return triangles[(triangles >= 0).all(1)]


def pitch_of(points: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> float:
    """The ideal plane's pixel pitch."""
    x = np.where(mask, points[..., 0] / np.where(mask, points[..., 2], 1), np.nan)
    return float(np.nanmedian(np.abs(np.diff(x, axis=1))))


def widths(
    z: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], jump: float
) -> Float[np.ndarray, "h w"]:
    """How wide in pixels what each pixel shows is, the narrowest way but one across it: it ends with the mask or where the
    depth jumps back by this share of itself. The narrowest may just cut off a corner."""
    across = np.empty((len(AXES), *z.shape))
    for axis, (v, u) in enumerate(AXES):
        run = _run(z, mask, jump, v, u) + _run(z, mask, jump, -v, -u) - 1
        across[axis] = run * np.hypot(v, u)
    return np.partition(across, 1, axis=0)[1]


@numba.njit(cache=True)
@no_type_check
def _run(z, mask, jump, dv, du):
    """Pixels from each one on, itself counted, until what it shows ends that way."""
    height, width = z.shape
    run = np.zeros((height, width), np.int32)
    for i in range(height):
        v = height - 1 - i if dv > 0 else i
        for j in range(width):
            u = width - 1 - j if du > 0 else j
            if not mask[v, u]:
                continue
            run[v, u] = 1
            a, b = v + dv, u + du
            if 0 <= a < height and 0 <= b < width and mask[a, b] and z[a, b] <= z[v, u] * (1 + jump):
                run[v, u] += run[a, b]
    return run
