"""Which Gaussians can touch which 8x8 tile of a pinhole view: projection, bounds, depth-sorted lists.

Bounds are exact tangent planes of the ellipsoid |W (x - mu)|^2 <= q_cut, so they are conservative for any
Gaussian, however near, wide or oblique; q_cut is where density * G falls below `FAINT`, and the kernels
apply the same cut on every ray, so a ray's value never depends on the tile it was traced in.

Per view, camera frame, float32: `packed[v]` = M (9, row major), m (3), density, radiance (3), least and greatest x, then y,
of rays that touch it, with M = W R_wc and m = W (mu - origin): the exponent on the ray z * (x, y, 1) is |m - z M (x, y, 1)|^2.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

TILE = 8
WIDTH = 20  # columns of `packed`
FAINT = 2e-5  # density * G below which a Gaussian does not exist
ROUNDING = 1e-4  # by which outlines on z = 1 are taken wider than they are

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
# With `forceinline`, here and elsewhere: what other kernels call. Left to the compiler, a caller is linked with the copy that a
# process loads first, its own or the callee's as compiled by itself, which rounds differently; it hangs on what the cache holds.


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _outline(x, z, sxx, sxz, szz):
    """Where an ellipsoid's outline begins and ends along one axis of the plane z = 1; endless unless all of it is in front.

    `sxx`, `sxz`, `szz` are q_cut times the covariance.
    """
    if z * z <= szz * 1.001:
        return -math.inf, math.inf
    lower = szz - z * z
    middle = (sxz - x * z) / lower
    inner = sxz * sxz - szz * sxx - 2.0 * sxz * x * z + szz * x * x + sxx * z * z
    half = math.sqrt(max(inner, 0.0)) / -lower
    return middle - half, middle + half


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _tile_span(x, z, sxx, sxz, szz, begin, end, focal, centre, tiles):
    """First and last tile (inclusive) along one axis whose edge planes, which hold the origin, do not exclude the ellipsoid of
    this `_outline`.
    """
    if end < math.inf:
        lo = (focal * begin + centre) / TILE
        hi = (focal * end + centre) / TILE
        return int(min(max(math.floor(lo), 0.0), float(tiles))), int(
            min(max(math.floor(hi), -1.0), tiles - 1.0)
        )
    first, last = 0, tiles - 1
    while first <= last:  # right edge of `first`: is all of it to the right?
        edge = ((first + 1) * TILE - centre) / focal
        gap = x - edge * z
        if gap > 0 and gap * gap > sxx - 2 * edge * sxz + edge * edge * szz:
            first += 1
        else:
            break
    while last >= first:
        edge = (last * TILE - centre) / focal
        gap = x - edge * z
        if gap < 0 and gap * gap > sxx - 2 * edge * sxz + edge * edge * szz:
            last -= 1
        else:
            break
    return first, last


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _cut(sigma):
    """q beyond which a Gaussian of this density does not exist."""
    return 8.0 * (1.0 - math.sqrt(math.sqrt(math.sqrt(FAINT / sigma))))


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _sides(lens, width, height):
    """The frustum's four sides: their slopes, and what makes normals of unit length of them."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    slopes = (-cx / fx, (width - cx) / fx, -cy / fy, (height - cy) / fy)
    lx, hx, ly, hy = slopes
    units = (
        1 / math.sqrt(1 + lx * lx),
        1 / math.sqrt(1 + hx * hx),
        1 / math.sqrt(1 + ly * ly),
        1 / math.sqrt(1 + hy * hy),
    )
    return slopes, units


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _beyond(x, y, z, radius, sides):
    """Whether a sphere is wholly behind the origin or outside one side."""
    (lx, hx, ly, hy), (nlx, nhx, nly, nhy) = sides
    return (
        z < -radius
        or (lx * z - x) * nlx > radius
        or (x - hx * z) * nhx > radius
        or (ly * z - y) * nly > radius
        or (y - hy * z) * nhy > radius
    )


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _radius(spread, sigma):
    """Of the sphere that holds a Gaussian of this `spread` [3 3]."""
    largest = 0.0
    for i in range(3):
        largest = max(largest, spread[i, 0] ** 2 + spread[i, 1] ** 2 + spread[i, 2] ** 2)
    return math.sqrt(_cut(sigma) * largest)


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _placed(mean, rotation, origin):
    """Where a mean is, seen from the origin: in the world's axes, then in the camera's."""
    wx, wy, wz = mean[0] - origin[0], mean[1] - origin[1], mean[2] - origin[2]
    x = rotation[0, 0] * wx + rotation[0, 1] * wy + rotation[0, 2] * wz
    y = rotation[1, 0] * wx + rotation[1, 1] * wy + rotation[1, 2] * wz
    z = rotation[2, 0] * wx + rotation[2, 1] * wy + rotation[2, 2] * wz
    return wx, wy, wz, x, y, z


@njit(forceinline=True, **_FLAGS)
@no_type_check
def around(spread, means, density, rotation, origin, reach, lens, width, height, order):
    """Those of the Gaussians in `order`, in that order, that may touch the view from any place within `reach` of
    `origin`; arguments as of `project`.
    """
    sides = _sides(lens, width, height)
    found = np.empty(len(order), np.int64)
    n = 0
    for k in order:
        sigma = float(density[k])
        if sigma <= FAINT:
            continue
        _, _, _, x, y, z = _placed(means[k], rotation, origin)
        if not _beyond(x, y, z, _radius(spread[k], sigma) + reach, sides):
            found[n] = k
            n += 1
    return found[:n].copy()


@njit(forceinline=True, **_FLAGS)
@no_type_check
def turned(white, spread, density, rotation, among):
    """What a view's axes make of the Gaussians `among`, wherever it stands: M (9, row major), and q_cut, the radius of the
    sphere that holds one, and q_cut times the covariance's xx, xz, yy, yz, zz.
    """
    maps, spans = np.empty((len(among), 9), np.float32), np.empty((len(among), 7))
    camera_spread = np.empty((3, 3))
    for at, k in enumerate(among):
        sigma = float(density[k])
        q_cut = _cut(sigma)
        sxx = sxz = syy = syz = szz = 0.0
        for i in range(3):
            for j in range(3):
                camera_spread[i, j] = (
                    spread[k, i, 0] * rotation[j, 0]
                    + spread[k, i, 1] * rotation[j, 1]
                    + spread[k, i, 2] * rotation[j, 2]
                )
                maps[at, 3 * i + j] = (
                    white[k, i, 0] * rotation[j, 0]
                    + white[k, i, 1] * rotation[j, 1]
                    + white[k, i, 2] * rotation[j, 2]
                )
            a, b, c = camera_spread[i, 0], camera_spread[i, 1], camera_spread[i, 2]
            sxx += q_cut * a * a
            sxz += q_cut * a * c
            syy += q_cut * b * b
            syz += q_cut * b * c
            szz += q_cut * c * c
        spans[at, 0], spans[at, 1] = q_cut, _radius(spread[k], sigma)
        spans[at, 2], spans[at, 3], spans[at, 4], spans[at, 5], spans[at, 6] = sxx, sxz, syy, syz, szz
    return maps, spans


@njit(forceinline=True, **_FLAGS)
@no_type_check
def touching(white, means, density, colours, maps, spans, rotation, origin, lens, width, height, among):
    """Those of the Gaussians `among` that may touch the view, in that order: what `project` gives, and distances; `maps` and
    `spans` from `turned`.
    """
    count = len(among)
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    across, down = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    sides = _sides(lens, width, height)  # a bounding sphere test rejects most at once
    index = np.empty(count, np.int32)
    boxes = np.empty((count, 4), np.int32)
    depths = np.empty(count, np.float32)
    packed = np.empty((count, WIDTH), np.float32)
    n = 0
    for at, k in enumerate(among):
        wx, wy, wz, x, y, z = _placed(means[k], rotation, origin)
        if _beyond(x, y, z, spans[at, 1], sides):
            continue
        sxx, sxz, syy, syz, szz = spans[at, 2], spans[at, 3], spans[at, 4], spans[at, 5], spans[at, 6]
        if z < 0 and z * z > szz:
            continue
        left, right = _outline(x, z, sxx, sxz, szz)
        first, last = _tile_span(x, z, sxx, sxz, szz, left, right, fx, cx, across)
        if first > last:
            continue
        above, below = _outline(y, z, syy, syz, szz)
        top, bottom = _tile_span(y, z, syy, syz, szz, above, below, fy, cy, down)
        if top > bottom:
            continue
        for i in range(9):
            packed[n, i] = maps[at, i]
        for i in range(3):
            packed[n, 9 + i] = white[k, i, 0] * wx + white[k, i, 1] * wy + white[k, i, 2] * wz
            packed[n, 13 + i] = colours[k, i]
        packed[n, 12] = float(density[k])
        packed[n, 16], packed[n, 17] = left - ROUNDING, right + ROUNDING
        packed[n, 18], packed[n, 19] = above - ROUNDING, below + ROUNDING
        index[n] = k
        boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3] = first, last, top, bottom
        depths[n] = math.sqrt(wx * wx + wy * wy + wz * wz)
        n += 1
    return index[:n], packed[:n], boxes[:n], depths[:n]


@njit(**_FLAGS)
@no_type_check
def project(white, spread, means, density, colours, rotation, origin, lens, width, height):
    """Gaussians that may touch the view, nearest mean first: indices, `packed` rows, tile boxes.

    `white` = W and `spread` = S R^T per Gaussian; `rotation` is camera_from_world; `lens` = fx fy cx cy.
    """
    among = around(spread, means, density, rotation, origin, 0.0, lens, width, height, np.arange(len(means)))
    maps, spans = turned(white, spread, density, rotation, among)
    index, packed, boxes, depths = touching(
        white, means, density, colours, maps, spans, rotation, origin, lens, width, height, among
    )
    order = np.argsort(depths, kind="mergesort")
    return index[order], packed[order], boxes[order]


@njit(forceinline=True, **_FLAGS)
@no_type_check
def lists(boxes, across, down):
    """Per-tile lists in the order of `boxes`: (tile_start, members, own_start, slots).

    Tile t holds members[tile_start[t]:tile_start[t+1]]; entry v sits at slots[own_start[v]:own_start[v+1]].
    """
    tile_start = np.zeros(across * down + 1, np.int64)
    own_start = np.zeros(boxes.shape[0] + 1, np.int64)
    for v in range(boxes.shape[0]):
        for row in range(boxes[v, 2], boxes[v, 3] + 1):
            for column in range(boxes[v, 0], boxes[v, 1] + 1):
                tile_start[row * across + column + 1] += 1
        own_start[v + 1] = own_start[v] + (boxes[v, 1] - boxes[v, 0] + 1) * (boxes[v, 3] - boxes[v, 2] + 1)
    for t in range(across * down):
        tile_start[t + 1] += tile_start[t]
    members = np.empty(own_start[-1], np.int32)
    slots = np.empty(own_start[-1], np.int64)
    fill = tile_start[:-1].copy()
    at = 0
    for v in range(boxes.shape[0]):
        for row in range(boxes[v, 2], boxes[v, 3] + 1):
            for column in range(boxes[v, 0], boxes[v, 1] + 1):
                t = row * across + column
                members[fill[t]] = v
                slots[at] = fill[t]
                fill[t] += 1
                at += 1
    return tile_start, members, own_start, slots
