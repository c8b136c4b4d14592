"""How deep an answer's depth is off, within and between the parts of the true one, in pixel widths.

The object's true depth falls into parts where it jumps: where two neighbouring pixels' planes, by their true normals, miss each
other between them by more than `JUMP_PX`. Normals tell the shape of each part and not how far it stands behind another, so
that the two are told apart. A depth is known up to one factor. Camera frame, depth along z.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from engine.geometry import rays
from engine.types import Camera

JUMP_PX = 2.0  # pixel widths
LEAST = 40  # pixels of a part that is told


@dataclass(frozen=True, slots=True)
class DepthError:
    """Pixel widths, means over the pixels of all parts that are told; NaN where there is none, or no second part."""

    within: float  # each part under the factor that suits it
    between: float  # how far that factor moves each part, beside one factor for all
    parts: int


def depth_error(
    depth: Float[np.ndarray, "h w"],
    true_depth: Float[np.ndarray, "h w"],
    part: Int[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
) -> DepthError:
    """Over a mask whose pixels' parts are known (`parts_of`)."""
    mask = mask & (depth > 0) & (part >= 0)
    z, true, number = depth[mask].astype(float), true_depth[mask], part[mask]
    told = np.bincount(number, minlength=1) >= LEAST
    kept = told[number]
    z, true, number = z[kept], true[kept], number[kept]
    if not len(z):
        return DepthError(math.nan, math.nan, 0)
    ratio, width = true / z, true / camera.fx
    whole = np.median(ratio)
    own = np.zeros(len(told))
    for k in np.flatnonzero(told):
        own[k] = np.median(ratio[number == k])
    within = float((np.abs(own[number] * z - true) / width).mean())
    between = float((np.abs(own[number] / whole - 1) * whole * z / width).mean())
    count = int(told.sum())
    return DepthError(within, between if count > 1 else math.nan, count)


def parts_of(
    depth: Float[np.ndarray, "h w"],
    normal: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
) -> Int[np.ndarray, "h w"]:
    """The number of the part that each pixel of the mask belongs to; -1 outside.

    Neighbours a and b lie on one surface where their planes agree midway: (n_a . x_a) / (n_a . m) = (n_b . x_b) / (n_b . m) with
    m the ray between them.
    """
    ray = rays(camera)
    ray = ray / ray[..., 2:]
    offset = (normal * ray).sum(-1) * depth
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(int(mask.sum()))
    joined: list[np.ndarray] = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        middle = (ray[a] + ray[b]) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            miss = np.abs(offset[a] / (normal[a] * middle).sum(-1) - offset[b] / (normal[b] * middle).sum(-1))
        close = mask[a] & mask[b] & (miss * camera.fx < JUMP_PX * np.minimum(depth[a], depth[b]))
        joined.append(np.stack([number[a][close], number[b][close]]))
    one, other = np.concatenate(joined, 1)
    size = int(mask.sum())
    _, label = connected_components(
        coo_matrix((np.ones(len(one)), (one, other)), (size, size)), directed=False
    )
    part = np.full(mask.shape, -1)
    part[mask] = label
    return part
