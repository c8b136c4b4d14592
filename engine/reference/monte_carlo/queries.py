"""The light along any ray: the Gaussians of Eq. (3), found through a tree of boxes. CPU; nothing is kept between calls.

Source: the paper, Eq. (2)-(4), evaluated as `engine/light/gaussians/raytrace_reference.py` does ("compact" profile; exact order along each
ray; colours as seen from the ray's origin); the tree is split by a full sweep of the surface-area heuristic (MacDonald and Booth 1990).
World frame, scene units, the session's radiance.

A ray's hits stay sorted while the tree is walked, nearer child first. Where they have become opaque is a wall: boxes
that begin behind it are not opened.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from engine.light.gaussians.gaussians import sh_degree
from engine.light.gaussians.rasterize import ThreadPool, shapes
from engine.light.gaussians.rasterize_kernels import DEEP, OPAQUE
from engine.light.gaussians.tiles import FAINT
from engine.types import Gaussians

LEAF = 4
"""Gaussians in a box that is not split any more, at most."""
DEEPEST = 48
"""From this depth on boxes are halved by count, so that the walk's stack is bounded."""
MOST = 2048
"""Hits kept of a ray; the nearest, and opaque long before."""
_STACK = DEEPEST + 32
_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """Nested boxes; a box's first child follows it. Gaussians in the order of the leaves."""

    boxes: Float[np.ndarray, "n 6"]  # low, high
    links: Int[np.ndarray, "n 2"]  # inner: second child, 0; leaf: first Gaussian, how many
    packed: Float[np.ndarray, "k 13"]  # whitening (9, row major), mean, density; float32
    radiance: Float[np.ndarray, "k b 3"]


def plant(gaussians: Gaussians) -> Tree:
    """The tree over the boxes in which the Gaussians' density exceeds what the kernels call faint."""
    geometry = shapes(gaussians)
    kept = np.nonzero(geometry.density > FAINT)[0]
    reach = np.sqrt(8 * (1 - (FAINT / geometry.density[kept]) ** 0.125))  # where (1 - q/8)^8 density is faint
    half = reach[:, None] * np.sqrt((geometry.spread[kept] ** 2).sum(1))
    means = geometry.means[kept]
    order, boxes, links = _grown(means - half, means + half)
    rows = kept[order]
    packed = np.concatenate(
        [geometry.white[rows].reshape(-1, 9), geometry.means[rows], geometry.density[rows, None]], 1
    )
    sh_degree(gaussians.radiance.shape[1])
    return Tree(
        boxes, links, packed.astype(np.float32),
        np.ascontiguousarray(gaussians.radiance[rows], dtype=np.float64),
    )  # fmt: skip


def _grown(
    low: Float[np.ndarray, "k 3"], high: Float[np.ndarray, "k 3"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "n 6"], Int[np.ndarray, "n 2"]]:
    """Order of the leaves' members, boxes and links, depth first."""
    order, boxes, links = [], [], []
    waiting = [(np.arange(len(low)), 0, -1)]  # members, depth, the box whose second child this is
    while waiting:
        members, depth, parent = waiting.pop()
        if parent >= 0:
            links[parent][0] = len(boxes)
        here = len(boxes)
        boxes.append(
            np.concatenate([low[members].min(0), high[members].max(0)]) if len(members) else np.zeros(6)
        )
        if len(members) <= LEAF:
            links.append([len(order), len(members)])
            order.extend(members.tolist())
            continue
        links.append([0, 0])
        first, second = _split(low[members], high[members], depth >= DEEPEST)
        waiting += [(members[second], depth + 1, here), (members[first], depth + 1, -1)]
    return np.array(order, int), np.array(boxes, np.float32), np.array(links, np.int32)


def _split(
    low: Float[np.ndarray, "m 3"], high: Float[np.ndarray, "m 3"], halve: bool
) -> tuple[Int[np.ndarray, " a"], Int[np.ndarray, " b"]]:
    """The cut at which area times count of both sides is least, over all three axes."""
    count = len(low)
    best = (np.inf, np.arange(count), count // 2)
    for axis in range(3):
        along = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        if halve:
            return along[: count // 2], along[count // 2 :]
        before = _areas(low[along], high[along])[:-1]
        after = _areas(low[along[::-1]], high[along[::-1]])[::-1][1:]
        cost = before * np.arange(1, count) + after * np.arange(count - 1, 0, -1)
        cut = int(cost.argmin())
        if cost[cut] < best[0]:
            best = (cost[cut], along, cut + 1)
    _, along, cut = best
    return along[:cut], along[cut:]


def _areas(low: Float[np.ndarray, "m 3"], high: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """Half the surface of the box around the first 1, 2, ... members."""
    x, y, z = (np.maximum.accumulate(high) - np.minimum.accumulate(low)).T
    return x * y + y * z + z * x


def radiance(
    tree: Tree,
    origins: Float[np.ndarray, "p 3"],
    directions: Float[np.ndarray, "p s 3"],
    wanted: Bool[np.ndarray, "p s"],
    run: ThreadPool,
) -> Float[np.ndarray, "p s 3"]:
    """L_i of Eq. (8), float32, where it is wanted; zero elsewhere and where no Gaussian stands."""
    out = np.zeros(directions.shape, np.float32)
    run(
        _radiance,
        (
            tree.boxes, tree.links, tree.packed, tree.radiance, np.ascontiguousarray(origins, np.float64),
            np.ascontiguousarray(directions, np.float64), wanted, out,
        ),
    )  # fmt: skip
    return out


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _entry(box, ox, oy, oz, ix, iy, iz, wall):
    """Where a ray enters a box; infinite where it misses it or enters behind the wall."""
    a, b = (box[0] - ox) * ix, (box[3] - ox) * ix
    near, far = min(a, b), max(a, b)
    a, b = (box[1] - oy) * iy, (box[4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (box[2] - oz) * iz, (box[5] - oz) * iz
    near, far = max(near, min(a, b), 0.0), min(far, max(a, b))
    # Boxes are float32: a hair of slack, else a Gaussian that fills its box could be missed at its rim.
    return near if near <= far * 1.00001 and near <= wall else np.inf


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _inverse(x):
    return 1 / x if abs(x) > 1e-12 else 1e12


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _walk(boxes, links, packed, ox, oy, oz, dx, dy, dz, stack, enters, taus, alphas, members):
    """Hits of one ray, nearest first, up to where it is opaque; returns how many."""
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    count, wall, through = 0, np.inf, 1.0
    top = 0
    stack[0], enters[0] = 0, 0.0
    while top >= 0:
        node, enter = stack[top], enters[top]
        top -= 1
        if enter > wall:
            continue
        begin, size = links[node, 0], links[node, 1]
        if size == 0 and begin > 0:
            a, b = node + 1, begin
            ta = _entry(boxes[a], ox, oy, oz, ix, iy, iz, wall)
            tb = _entry(boxes[b], ox, oy, oz, ix, iy, iz, wall)
            if ta > tb:
                a, b, ta, tb = b, a, tb, ta
            if tb < np.inf:
                top += 1
                stack[top], enters[top] = b, tb
            if ta < np.inf:
                top += 1
                stack[top], enters[top] = a, ta
            continue
        for k in range(begin, begin + size):
            row = packed[k]
            x, y, z = row[9] - ox, row[10] - oy, row[11] - oz
            m0 = row[0] * x + row[1] * y + row[2] * z
            m1 = row[3] * x + row[4] * y + row[5] * z
            m2 = row[6] * x + row[7] * y + row[8] * z
            e0 = row[0] * dx + row[1] * dy + row[2] * dz
            e1 = row[3] * dx + row[4] * dy + row[5] * dz
            e2 = row[6] * dx + row[7] * dy + row[8] * dz
            tau = (m0 * e0 + m1 * e1 + m2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
            if tau <= 0 or tau > wall:
                continue
            r0, r1, r2 = m0 - tau * e0, m1 - tau * e1, m2 - tau * e2
            g = max(1 - (r0 * r0 + r1 * r1 + r2 * r2) / 8, 0.0)
            g = g * g
            g = g * g
            t = row[12] * g * g
            if t <= FAINT:
                continue
            alpha = 1 - np.exp(-min(t, DEEP))
            if count == len(taus):
                if tau >= taus[count - 1]:
                    continue
                count -= 1
            at = count
            count += 1
            while at > 0 and taus[at - 1] > tau:
                taus[at], alphas[at], members[at] = taus[at - 1], alphas[at - 1], members[at - 1]
                at -= 1
            taus[at], alphas[at], members[at] = tau, alpha, k
            through *= 1 - alpha
        if through < OPAQUE:
            through = 1.0
            for c in range(count):
                through *= 1 - alphas[c]
                if through < OPAQUE:
                    wall, count = taus[c], c + 1
                    break
    return count


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _harmonics(x, y, z, basis):
    """Real spherical harmonics of a unit direction as `gaussians.sh_basis` has them, as many as fit."""
    basis[0] = 0.28209479177387814
    if len(basis) > 1:
        basis[1] = -0.4886025119029199 * y
        basis[2] = 0.4886025119029199 * z
        basis[3] = -0.4886025119029199 * x
    if len(basis) > 4:
        basis[4] = 1.0925484305920792 * x * y
        basis[5] = -1.0925484305920792 * y * z
        basis[6] = 0.31539156525252005 * (3 * z * z - 1)
        basis[7] = -1.0925484305920792 * x * z
        basis[8] = 0.5462742152960396 * (x * x - y * y)
    if len(basis) > 9:
        basis[9] = -0.5900435899266435 * y * (3 * x * x - y * y)
        basis[10] = 2.890611442640554 * x * y * z
        basis[11] = -0.4570457994644658 * y * (5 * z * z - 1)
        basis[12] = 0.3731763325901154 * z * (5 * z * z - 3)
        basis[13] = -0.4570457994644658 * x * (5 * z * z - 1)
        basis[14] = 1.445305721320277 * z * (x * x - y * y)
        basis[15] = -0.5900435899266435 * x * (x * x - 3 * y * y)


@njit(**_FLAGS)
@no_type_check
def _radiance(boxes, links, packed, colours, origins, directions, wanted, out, part, parts):
    """Eq. (3) for one part of the points and all their directions."""
    points, samples = directions.shape[:2]
    stack, enters = np.empty(_STACK, np.int64), np.empty(_STACK)
    taus, alphas, members = np.empty(MOST), np.empty(MOST), np.empty(MOST, np.int64)
    bands = colours.shape[1]
    basis = np.empty(bands)
    for p in range(points * part // parts, points * (part + 1) // parts):
        ox, oy, oz = origins[p]
        for s in range(samples):
            if not wanted[p, s]:
                continue
            dx, dy, dz = directions[p, s]
            count = _walk(boxes, links, packed, ox, oy, oz, dx, dy, dz, stack, enters, taus, alphas, members)
            through = 1.0
            r = g = b = 0.0
            for c in range(count):
                k = members[c]
                x, y, z = packed[k, 9] - ox, packed[k, 10] - oy, packed[k, 11] - oz
                over = 1 / max(np.sqrt(x * x + y * y + z * z), 1e-12)
                _harmonics(x * over, y * over, z * over, basis)
                red = green = blue = 0.0
                for i in range(bands):
                    red += basis[i] * colours[k, i, 0]
                    green += basis[i] * colours[k, i, 1]
                    blue += basis[i] * colours[k, i, 2]
                weight = through * alphas[c]
                r += weight * max(red, 0.0)
                g += weight * max(green, 0.0)
                b += weight * max(blue, 0.0)
                through *= 1 - alphas[c]
            out[p, s, 0], out[p, s, 1], out[p, s, 2] = r, g, b
