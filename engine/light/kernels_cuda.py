"""Composite Gaussians over pinhole tiles, forward and backward: the CUDA kernels (reference: trace.py).

Source: the paper, Eq. (2)-(4); the arithmetic is that of `kernels_cpu.py`, one thread where that has one ray.

A block is a tile, a thread a ray: it walks the tile's list, sorts what answers by its own tau and composites.
Going back, a second pass of the same block takes one thread per entry of the list and sums over the rays in
their order. Nothing is added atomically, so a device repeats its answers bit for bit.

What a ray remembers lies in `scratch` arrays [rows 64], a row per entry of the tiles of one launch; `tiles`
has the layout of the lists and `on_cuda.py` the launches. Importing needs neither a device nor a driver.
"""

import math
from collections.abc import Callable
from typing import Any, no_type_check

import numpy as np

from engine.light import kernels_cpu
from engine.light.tiles import FAINT, TILE

try:
    from numba import cuda
except ImportError:  # a numba whose CUDA target is a package of its own, which is not installed
    cuda = None

AREA = TILE * TILE

_ONE, _TWO, _ZERO = np.float32(1), np.float32(2), np.float32(0)
_EIGHTH, _FAINT, _OPAQUE = np.float32(1 / 8), np.float32(FAINT), np.float32(kernels_cpu.OPAQUE)
_DARKEST = np.float32(kernels_cpu.DARKEST)
_DEEP, _THROUGH = kernels_cpu.DEEP, kernels_cpu.THROUGH


def _compiled(**options: bool) -> Callable[[Callable], Any]:
    """`cuda.jit`, which compiles on the first launch; without numba.cuda the function as it is."""
    return (lambda function: function) if cuda is None else cuda.jit(**options)


_polynomial = _compiled(device=True)(kernels_cpu.decay.py_func)


@_compiled(device=True)
@no_type_check
def _decay(x):
    """exp(-x) as the CPU has it. No `min` here: numba 0.68's own CUDA target cannot compile it."""
    return _polynomial(x if x < _DEEP else _DEEP)


@_compiled(device=True)
@no_type_check
def _respond(packed, k, x, y):
    """Where on the ray z * (x, y, 1) a Gaussian answers: z, r = m - z e, and 1 - q / 8, at least 0."""
    e0 = packed[k, 0] * x + packed[k, 1] * y + packed[k, 2]
    e1 = packed[k, 3] * x + packed[k, 4] * y + packed[k, 5]
    e2 = packed[k, 6] * x + packed[k, 7] * y + packed[k, 8]
    m0, m1, m2 = packed[k, 9], packed[k, 10], packed[k, 11]
    z = (m0 * e0 + m1 * e1 + m2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
    r0, r1, r2 = m0 - z * e0, m1 - z * e1, m2 - z * e2
    b = _ONE - (r0 * r0 + r1 * r1 + r2 * r2) * _EIGHTH
    return z, r0, r1, r2, b if b > _ZERO else _ZERO


@_compiled(device=True)
@no_type_check
def _line_up(packed, members, begin, end, top, lane, x, y, near, alpha, depth, order):
    """Contributors of one ray, nearest first, into column `lane` of `order` from row `top`; their count.

    `order` holds rows of `alpha` and `depth`. Each is inserted where it belongs: lists are nearly sorted.
    """
    count = 0
    for at in range(begin, end):
        k = members[at]
        z, r0, r1, r2, b = _respond(packed, k, x, y)
        b = b * b
        b = b * b
        t = packed[k, 12] * b * b
        if t > _FAINT and z > near:
            row = top + at - begin
            alpha[row, lane] = _ONE - _decay(t)
            depth[row, lane] = z
            place = top + count
            while place > top and depth[order[place - 1, lane], lane] > z:
                order[place, lane] = order[place - 1, lane]
                place -= 1
            order[place, lane] = row
            count += 1
    return count


@_compiled(device=True)
@no_type_check
def _ray(tile, lane, across, lens):
    """Pixel (v, u) of a tile's ray and its direction (x, y, 1)."""
    v, u = tile // across * TILE + lane // TILE, tile % across * TILE + lane % TILE
    return v, u, np.float32((u + 0.5 - lens[2]) / lens[0]), np.float32((v + 0.5 - lens[3]) / lens[1])


@_compiled()
@no_type_check
def forward(packed, tile_start, members, lens, near, first, alpha, depth, order, image):
    """Eq. (3): block b renders tile `first` + b into `image` [h w 5]."""
    tile, lane = first + cuda.blockIdx.x, cuda.threadIdx.x
    height, width = image.shape[0], image.shape[1]
    v, u, x, y = _ray(tile, lane, (width + TILE - 1) // TILE, lens)
    if v >= height or u >= width:
        return
    begin, end = tile_start[tile], tile_start[tile + 1]
    top = begin - tile_start[first]
    count = _line_up(packed, members, begin, end, top, lane, x, y, near, alpha, depth, order)
    through = _ONE
    r = g = b = far = _ZERO
    for c in range(top, top + count):
        row = order[c, lane]
        k = members[begin + row - top]
        weight = through * alpha[row, lane]
        r += weight * packed[k, 13]
        g += weight * packed[k, 14]
        b += weight * packed[k, 15]
        far += weight * depth[row, lane]
        through *= _ONE - alpha[row, lane]
        if through < _OPAQUE:
            break
    image[v, u, 0], image[v, u, 1], image[v, u, 2], image[v, u, 3], image[v, u, 4] = r, g, b, through, far


@_compiled(device=True)
@no_type_check
def _misfit(m, want, lower_bound, share, knee):
    """One channel of Eq. (5): its slope by the rendered `m`, and its value."""
    told = knee + want
    if told < _DARKEST * knee:  # noise may put a pixel below black by more than the knee
        told = _DARKEST * knee
    if m > want and not lower_bound:
        return share / (knee + m), share * np.float32(math.log((knee + m) / told))
    if m < want:
        return -share / (knee + m), share * np.float32(math.log(told / (knee + m)))
    return _ZERO, _ZERO


@_compiled(device=True)
@no_type_check
def _entry_gradient(packed, k, row, xs, ys, slope, weight, colour_slope, misfit, out):
    """Sum one entry's gradients over the 64 rays from d loss / d alpha (`slope`) and compositing weights."""
    g00 = g01 = g02 = g10 = g11 = g12 = g20 = g21 = g22 = _ZERO
    h0 = h1 = h2 = s = c0 = c1 = c2 = total = blame = _ZERO
    sigma = packed[k, 12]
    for i in range(AREA):
        w = weight[row, i]
        if w > _ZERO:
            x, y = xs[i], ys[i]
            z, r0, r1, r2, b = _respond(packed, k, x, y)
            b2 = b * b
            b4 = b2 * b2
            profile = b4 * b4
            t = slope[row, i] * _decay(sigma * profile)  # d loss / d (density G)
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
            c0 += w * colour_slope[0, i]
            c1 += w * colour_slope[1, i]
            c2 += w * colour_slope[2, i]
            total += w
            blame += w * misfit[i]
    out[0], out[1], out[2], out[3], out[4], out[5] = g00, g01, g02, g10, g11, g12
    out[6], out[7], out[8], out[9], out[10], out[11] = g20, g21, g22, h0, h1, h2
    out[12], out[13], out[14], out[15], out[16], out[17] = s, c0, c1, c2, total, blame


@_compiled()
@no_type_check
def backward(
    packed, tile_start, members, lens, near, first, alpha, depth, order,
    image, target, weights, floor_only, knee, hollow, surface, slope, weight, grads,
):  # fmt: skip
    """Block b renders tile `first` + b and pushes the loss of `kernels_cpu.backward` onto its entries."""
    tile, lane = first + cuda.blockIdx.x, cuda.threadIdx.x
    height, width = image.shape[0], image.shape[1]
    xs = cuda.shared.array(AREA, np.float32)  # a line each: the simulator tells them apart by it
    ys = cuda.shared.array(AREA, np.float32)
    misfit = cuda.shared.array(AREA, np.float32)
    colour_slope = cuda.shared.array((3, AREA), np.float32)
    v, u, x, y = _ray(tile, lane, (width + TILE - 1) // TILE, lens)
    xs[lane], ys[lane], misfit[lane] = x, y, _ZERO
    colour_slope[0, lane] = colour_slope[1, lane] = colour_slope[2, lane] = _ZERO
    begin, end = tile_start[tile], tile_start[tile + 1]
    top = begin - tile_start[first]
    for row in range(top, top + end - begin):
        weight[row, lane] = _ZERO
    if v < height and u < width:  # no early return: all 64 threads meet again below
        count = _line_up(packed, members, begin, end, top, lane, x, y, near, alpha, depth, order)
        through = _ONE
        r = g = b = far = _ZERO
        used = top
        for c in range(top, top + count):
            row = order[c, lane]
            k = members[begin + row - top]
            slope[row, lane] = through  # what reaches this one, until its slope is known
            w = through * alpha[row, lane]
            weight[row, lane] = w
            r += w * packed[k, 13]
            g += w * packed[k, 14]
            b += w * packed[k, 15]
            far += w * depth[row, lane]
            through *= _ONE - alpha[row, lane]
            used = c + 1
            if through < _OPAQUE:
                break
        image[v, u, 0], image[v, u, 1], image[v, u, 2] = r, g, b
        image[v, u, 3], image[v, u, 4] = through, far
        share = weights[v, u]
        wall = _THROUGH * surface[v, u]
        behind = share * through
        s0, s1, s2 = target[v, u, 0], target[v, u, 1], target[v, u, 2]
        if knee > _ZERO:
            behind *= hollow
            lower_bound = floor_only[v, u]
            s0, l0 = _misfit(r, s0, lower_bound, share, knee)
            s1, l1 = _misfit(g, s1, lower_bound, share, knee)
            s2, l2 = _misfit(b, s2, lower_bound, share, knee)
            misfit[lane] = l0 + l1 + l2
        colour_slope[0, lane], colour_slope[1, lane], colour_slope[2, lane] = s0, s1, s2
        # `behind` = what all the farther ones add to the loss through this one's transparency.
        for back in range(used - top):
            row = order[used - 1 - back, lane]
            k = members[begin + row - top]
            own = s0 * packed[k, 13] + s1 * packed[k, 14] + s2 * packed[k, 15]
            if depth[row, lane] < wall:
                own += share
            slope[row, lane] = slope[row, lane] * own - behind / (_ONE - alpha[row, lane])
            behind += own * weight[row, lane]
    cuda.syncthreads()
    for at in range(begin + lane, end, AREA):
        row = top + at - begin
        _entry_gradient(packed, members[at], row, xs, ys, slope, weight, colour_slope, misfit, grads[at])


@_compiled()
@no_type_check
def collect(grads, own_start, slots, totals):
    """Sum every Gaussian's entries in a fixed order: `totals` [visible 18], a thread for each number."""
    at = cuda.grid(1)
    if at < totals.shape[0] * totals.shape[1]:
        v, c = at // totals.shape[1], at % totals.shape[1]
        total = _ZERO
        for slot in range(own_start[v], own_start[v + 1]):
            total += grads[slots[slot], c]
        totals[v, c] = total
