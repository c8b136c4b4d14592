"""Composite Gaussians over pinhole tiles, forward and backward: the CPU kernel (reference: raytrace_reference.py).

Source: the paper, Eq. (2)-(4). Every ray's contributors are sorted by their own tau (exact order; the tile
lists are only nearly sorted). The exponent is evaluated as |m - tau e|^2 with e = M (x, y, 1), which has
the envelope gradient d q / d m = 2 r, d q / d e = -2 tau r, r = m - tau e.

No parfors: kernels release the GIL and take a range of tiles, each tile writes rows of its own, and
gradients are gathered per Gaussian in a fixed order, so results are bit-identical for any thread count.
Reassociation is allowed inside loops of fixed length only; it is settled when the kernel is compiled.
"""

from typing import no_type_check

import numpy as np
from numba import njit

from engine.light.gaussians.tiles import FAINT, TILE

CHANNELS = 5  # radiance, transmittance left, sum of weight * z
GRADIENTS = 18  # per tile entry: M (9), m (3), density, radiance (3), weight, weight * pixel loss
OPAQUE = 1e-5  # transmittance below which a ray ends
DARKEST = 1e-3  # least of knee + photographed, in knees, whose logarithm is taken
AREA = TILE * TILE

_FLAGS = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "reassoc"},
}
_ONE, _TWO, _ZERO = np.float32(1), np.float32(2), np.float32(0)
_EIGHTH, _FAINT = np.float32(1 / 8), np.float32(FAINT)
_OPAQUE, _DARKEST = np.float32(OPAQUE), np.float32(DARKEST)
DEEP = np.float32(12)  # exp(-12) is 6e-6: opaque
_S1, _S2, _S3, _S4, _S5 = (np.float32(c) for c in (1 / 16, 1 / 2, 1 / 3, 1 / 4, 1 / 5))


@njit(inline="always", **_FLAGS)
@no_type_check
def decay(x):
    """exp(-x) for 0 <= x <= 12 to 2e-7 absolute, without a call, so that loops over it vectorise."""
    t = x * _S1
    p = _ONE - t * (_ONE - t * _S2 * (_ONE - t * _S3 * (_ONE - t * _S4 * (_ONE - t * _S5))))
    p = p * p
    p = p * p
    p = p * p
    return p * p


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _alphas(row, xs, ys, near, alpha, depth):
    """Eq. (2), (4) for one Gaussian on 64 rays: alpha and, where its outline reaches, the z where it answers; returns sum of alpha."""
    first, last = 0, AREA
    while first < last and ys[first] < row[18]:
        alpha[first : first + TILE] = _ZERO
        first += TILE
    while first < last and ys[last - 1] > row[19]:
        last -= TILE
        alpha[last : last + TILE] = _ZERO
    m00, m01, m02 = row[0], row[1], row[2]
    m10, m11, m12 = row[3], row[4], row[5]
    m20, m21, m22 = row[6], row[7], row[8]
    m0, m1, m2, sigma = row[9], row[10], row[11], row[12]
    total = _ZERO
    for i in range(first, last):
        x, y = xs[i], ys[i]
        e0 = m00 * x + m01 * y + m02
        e1 = m10 * x + m11 * y + m12
        e2 = m20 * x + m21 * y + m22
        z = (m0 * e0 + m1 * e1 + m2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
        r0, r1, r2 = m0 - z * e0, m1 - z * e1, m2 - z * e2
        b = max(_ONE - (r0 * r0 + r1 * r1 + r2 * r2) * _EIGHTH, _ZERO)
        b = b * b
        b = b * b
        t = sigma * b * b
        t = t if t > _FAINT else _ZERO
        t = t if z > near else _ZERO
        a = _ONE - decay(min(t, DEEP))
        alpha[i] = a
        depth[i] = z
        total += a  # a sum vectorises where a running maximum does not
    return total


@njit(forceinline=True, **_FLAGS)
@no_type_check
def gather(packed, members, begin, end, xs, ys, near, alpha, depth, live):
    """Evaluate a tile's list; rows of `alpha`, `depth` and `live` for those that touch any ray."""
    n = 0
    for slot in range(begin, end):
        row = packed[members[slot]]
        if (
            row[16] <= xs[TILE - 1]
            and xs[0] <= row[17]
            and _alphas(row, xs, ys, near, alpha[n], depth[n]) > _ZERO
        ):
            live[n] = slot
            n += 1
    return n


@njit(forceinline=True, **_FLAGS)
@no_type_check
def ray_order(alpha, depth, n, i, order):
    """Contributors of ray `i`, nearest first, into `order`; insertion sort, as lists are nearly sorted."""
    count = 0
    for l in range(n):  # without a branch: most entries of a list miss most rays, unpredictably
        order[count] = l
        count += 1 if alpha[l, i] > _ZERO else 0
    for c in range(1, count):
        l = order[c]
        z = depth[l, i]
        at = c
        while at > 0 and depth[order[at - 1], i] > z:
            order[at] = order[at - 1]
            at -= 1
        order[at] = l
    return count


@njit(forceinline=True, **_FLAGS)
@no_type_check
def composite(packed, members, live, alpha, depth, n, order, out):
    """Eq. (3) on the 64 rays of a tile: `out[i]` = radiance, transmittance left, sum of weight * z; and, where `out` is
    wider than CHANNELS, sum of weight * luminance * z.
    """
    lit = out.shape[1] > CHANNELS
    for i in range(AREA):
        count = ray_order(alpha, depth, n, i, order)
        through = _ONE
        r = g = b = far = shining = _ZERO
        for c in range(count):
            l = order[c]
            row = packed[members[live[l]]]
            weight = through * alpha[l, i]
            r += weight * row[13]
            g += weight * row[14]
            b += weight * row[15]
            far += weight * depth[l, i]
            if lit:
                level = (
                    np.float32(0.2126) * row[13] + np.float32(0.7152) * row[14] + np.float32(0.0722) * row[15]
                )
                shining += weight * level * depth[l, i]
            through *= _ONE - alpha[l, i]
            if through < _OPAQUE:
                break
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = r, g, b, through, far
        if lit:
            out[i, CHANNELS] = shining


@njit(forceinline=True, **_FLAGS)
@no_type_check
def tile_rays(column, row, fx, fy, cx, cy, xs, ys):
    """Image-plane coordinates (z = 1) of a tile's pixel centres."""
    for j in range(TILE):
        for i in range(TILE):
            xs[j * TILE + i] = (column * TILE + i + 0.5 - cx) / fx
            ys[j * TILE + i] = (row * TILE + j + 0.5 - cy) / fy


@njit(forceinline=True, **_FLAGS)
@no_type_check
def longest(tile_start):
    """Length of the longest tile list, at least one."""
    most = 1
    for t in range(tile_start.shape[0] - 1):
        most = max(most, tile_start[t + 1] - tile_start[t])
    return most


@njit(**_FLAGS)
@no_type_check
def forward(packed, tile_start, members, lens, near, image, part, parts):
    """Render tiles part, part + parts, ... into `image` [h w 5]."""
    height, width = image.shape[0], image.shape[1]
    across = (width + TILE - 1) // TILE
    size = longest(tile_start)
    alpha, depth = np.empty((size, AREA), np.float32), np.empty((size, AREA), np.float32)
    live, order = np.empty(size, np.int64), np.empty(size + 1, np.int64)
    xs, ys, out = np.empty(AREA, np.float32), np.empty(AREA, np.float32), np.empty((AREA, 5), np.float32)
    for tile in range(part, tile_start.shape[0] - 1, parts):
        row, column = tile // across, tile % across
        tile_rays(column, row, lens[0], lens[1], lens[2], lens[3], xs, ys)
        n = gather(packed, members, tile_start[tile], tile_start[tile + 1], xs, ys, near, alpha, depth, live)
        composite(packed, members, live, alpha, depth, n, order, out)
        for i in range(AREA):
            v, u = row * TILE + i // TILE, column * TILE + i % TILE
            if v < height and u < width:
                for c in range(5):
                    image[v, u, c] = out[i, c]


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _entry_gradient(row, xs, ys, slope, weight, colour_slope, misfit, out):
    """Sum one Gaussian's gradients over 64 rays from d loss / d alpha (`slope`) and compositing weights."""
    m00, m01, m02 = row[0], row[1], row[2]
    m10, m11, m12 = row[3], row[4], row[5]
    m20, m21, m22 = row[6], row[7], row[8]
    m0, m1, m2, sigma = row[9], row[10], row[11], row[12]
    g00 = g01 = g02 = g10 = g11 = g12 = g20 = g21 = g22 = _ZERO
    h0 = h1 = h2 = s = c0 = c1 = c2 = total = blame = _ZERO
    for i in range(AREA):
        x, y = xs[i], ys[i]
        e0 = m00 * x + m01 * y + m02
        e1 = m10 * x + m11 * y + m12
        e2 = m20 * x + m21 * y + m22
        z = (m0 * e0 + m1 * e1 + m2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
        r0, r1, r2 = m0 - z * e0, m1 - z * e1, m2 - z * e2
        b = max(_ONE - (r0 * r0 + r1 * r1 + r2 * r2) * _EIGHTH, _ZERO)
        b2 = b * b
        b4 = b2 * b2
        profile = b4 * b4
        t = slope[i] * decay(min(sigma * profile, DEEP))  # d loss / d (density G)
        s += t * profile
        q = -_TWO * t * sigma * b4 * b2 * b  # 2 d loss / d q
        q0, q1, q2 = q * r0, q * r1, q * r2
        h0 += q0
        h1 += q1
        h2 += q2
        q0, q1, q2 = -z * q0, -z * q1, -z * q2
        g00 += q0 * x
        g01 += q0 * y
        g02 += q0
        g10 += q1 * x
        g11 += q1 * y
        g12 += q1
        g20 += q2 * x
        g21 += q2 * y
        g22 += q2
        w = weight[i]
        c0 += w * colour_slope[0, i]
        c1 += w * colour_slope[1, i]
        c2 += w * colour_slope[2, i]
        total += w
        blame += w * misfit[i]
    out[0], out[1], out[2], out[3], out[4], out[5] = g00, g01, g02, g10, g11, g12
    out[6], out[7], out[8], out[9], out[10], out[11] = g20, g21, g22, h0, h1, h2
    out[12], out[13], out[14], out[15], out[16], out[17] = s, c0, c1, c2, total, blame


THROUGH = np.float32(0.97)


@njit(**_FLAGS)
@no_type_check
def backward(
    packed,
    tile_start,
    members,
    lens,
    near,
    image,
    target,
    weights,
    knee,
    hollow,
    surface,
    grads,
    part,
    parts,
):
    """Render tiles and push a loss back onto their entries: `grads` [entries 18], `image` [h w 5].

    With knee > 0 the loss is Eq. (5), sum of weights * |log(1 + target/knee) - log(1 + m/knee)|,
    plus `hollow` * weights * transmittance left.
    With knee == 0 it is linear: sum of target * m + weights * transmittance, for checking gradients.
    To both comes weights * compositing weight of all that answers before THROUGH of the z in `surface`
    (0: unknown), where the view is sure to see through; that z is not differentiated.
    """
    height, width = image.shape[0], image.shape[1]
    across = (width + TILE - 1) // TILE
    size = longest(tile_start)
    alpha, depth = np.empty((size, AREA), np.float32), np.empty((size, AREA), np.float32)
    slope, weight = np.empty((size, AREA), np.float32), np.empty((size, AREA), np.float32)
    live, order = np.empty(size, np.int64), np.empty(size + 1, np.int64)
    before = np.empty(size, np.float32)
    xs, ys = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    colour_slope, misfit = np.empty((3, AREA), np.float32), np.empty(AREA, np.float32)
    knee32, hollow32 = np.float32(knee), np.float32(hollow)
    for tile in range(part, tile_start.shape[0] - 1, parts):
        row, column = tile // across, tile % across
        begin, end = tile_start[tile], tile_start[tile + 1]
        tile_rays(column, row, lens[0], lens[1], lens[2], lens[3], xs, ys)
        n = gather(packed, members, begin, end, xs, ys, near, alpha, depth, live)
        grads[begin:end] = _ZERO
        slope[:n] = _ZERO
        weight[:n] = _ZERO
        for i in range(AREA):
            v, u = row * TILE + i // TILE, column * TILE + i % TILE
            colour_slope[0, i] = colour_slope[1, i] = colour_slope[2, i] = misfit[i] = _ZERO
            if v >= height or u >= width:
                continue
            count = ray_order(alpha, depth, n, i, order)
            through = _ONE
            r = g = b = far = _ZERO
            used = 0
            for c in range(count):
                l = order[c]
                entry = packed[members[live[l]]]
                before[c] = through
                w = through * alpha[l, i]
                weight[l, i] = w
                r += w * entry[13]
                g += w * entry[14]
                b += w * entry[15]
                far += w * depth[l, i]
                through *= _ONE - alpha[l, i]
                used = c + 1
                if through < _OPAQUE:
                    break
            image[v, u, 0], image[v, u, 1], image[v, u, 2] = r, g, b
            image[v, u, 3], image[v, u, 4] = through, far
            share = weights[v, u]
            wall = THROUGH * surface[v, u]
            if knee32 > _ZERO:
                behind = share * hollow32 * through
                for c in range(3):
                    m = image[v, u, c]
                    want = target[v, u, c]
                    # Noise may put a pixel below black by more than the knee.
                    told = max(knee32 + want, _DARKEST * knee32)
                    if m > want:
                        colour_slope[c, i] = share / (knee32 + m)
                        misfit[i] += share * np.log((knee32 + m) / told)
                    elif m < want:
                        colour_slope[c, i] = -share / (knee32 + m)
                        misfit[i] += share * np.log(told / (knee32 + m))
            else:
                behind = share * through
                for c in range(3):
                    colour_slope[c, i] = target[v, u, c]
            s0, s1, s2 = colour_slope[0, i], colour_slope[1, i], colour_slope[2, i]
            # `behind` = what all the farther ones add to the loss through this one's transparency.
            for back in range(used):
                c = used - 1 - back
                l = order[c]
                entry = packed[members[live[l]]]
                own = s0 * entry[13] + s1 * entry[14] + s2 * entry[15]
                if depth[l, i] < wall:
                    own += share
                slope[l, i] = before[c] * own - behind / (_ONE - alpha[l, i])
                behind += own * weight[l, i]
        for l in range(n):
            entry = packed[members[live[l]]]
            _entry_gradient(entry, xs, ys, slope[l], weight[l], colour_slope, misfit, grads[live[l]])


@njit(**_FLAGS)
@no_type_check
def collect(grads, own_start, slots, totals, part, parts):
    """Sum every Gaussian's entries in a fixed order: `totals` [visible 18]."""
    for v in range(part, own_start.shape[0] - 1, parts):
        for c in range(GRADIENTS):
            totals[v, c] = _ZERO
        for at in range(own_start[v], own_start[v + 1]):
            for c in range(GRADIENTS):
                totals[v, c] += grads[slots[at], c]


@njit(**_FLAGS)
@no_type_check
def compositing_weights(packed, index, tile_start, members, lens, near, wanted, faint):
    """Weights of Eq. (3) of every wanted pixel as sparse rows: begin and length of each, Gaussian, weight.

    Weights up to `faint` are left out.
    """
    height, width = wanted.shape
    across = (width + TILE - 1) // TILE
    size = longest(tile_start)
    alpha, depth = np.empty((size, AREA), np.float32), np.empty((size, AREA), np.float32)
    live, order = np.empty(size, np.int64), np.empty(size + 1, np.int64)
    xs, ys = np.empty(AREA, np.float32), np.empty(AREA, np.float32)
    begins, counts = np.zeros(height * width, np.int64), np.zeros(height * width, np.int64)
    room = 1024
    columns, values = np.empty(room, np.int32), np.empty(room, np.float32)
    at = 0
    for tile in range(tile_start.shape[0] - 1):
        row, column = tile // across, tile % across
        tile_rays(column, row, lens[0], lens[1], lens[2], lens[3], xs, ys)
        n = gather(packed, members, tile_start[tile], tile_start[tile + 1], xs, ys, near, alpha, depth, live)
        for i in range(AREA):
            v, u = row * TILE + i // TILE, column * TILE + i % TILE
            if v >= height or u >= width or not wanted[v, u]:
                continue
            count = ray_order(alpha, depth, n, i, order)
            while at + count > room:
                room *= 2
                more_columns, more_values = np.empty(room, np.int32), np.empty(room, np.float32)
                more_columns[:at], more_values[:at] = columns[:at], values[:at]
                columns, values = more_columns, more_values
            begins[v * width + u] = at
            through = _ONE
            for c in range(count):
                weight = through * alpha[order[c], i]
                if weight > faint:
                    columns[at], values[at] = index[members[live[order[c]]]], weight
                    at += 1
                through *= _ONE - alpha[order[c], i]
                if through < _OPAQUE:
                    break
            counts[v * width + u] = at - begins[v * width + u]
    return begins, counts, columns[:at].copy(), values[:at].copy()
