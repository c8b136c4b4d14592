"""Solve the colours with the geometry fixed: stage 2, as the linear problem that it is.

Source: the paper, Sec. 3.2, Eq. (6): with means, shapes and densities fixed, a rendering is linear in the
colours, m = A c, so stage 2 is a non-negative reweighted least-squares problem. Two objectives:

- "relative": Eq. (6) itself, |m^ - m| / (sg(m) + eps), by iteratively reweighted least squares; for the
  bright Gaussians that Otsu's threshold on log luminance picks.
- "energy": sum of (m^ - m)^2 / (sg(m) + eps), the variance a photon count has. Its optimum renders the
  photographed energy, where an L1 fit takes medians and dims what is small and bright.

The solver is projected gradient with a separable majoriser and Nesterov's momentum: A's rows are compositing
weights, non-negative with sums of at most one, so diag(A^T w A 1) bounds the curvature. Clipped pixels count as
they were recorded: how much brighter they are is for the object's shading to say.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from engine.color import luminance
from engine.light.fitting.training_views import Photographs
from engine.light.gaussians import rasterize_kernels
from engine.light.gaussians.rasterize import Shapes, ThreadPool, project

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
_FAINT = np.float32(2e-4)
_STEPS = 15  # of the gradient, within each reweighting
_BATCH = 16  # views whose rows are made before they are put to the others
_CHUNKS = 8  # of the transposed product; fixed, so that its sums do not depend on the machine


@dataclass(frozen=True, slots=True, eq=False)
class LinearRenders:
    """The image as a linear function of the colours: sparse rows A, photographed b, and their bounds."""

    begins: Int[np.ndarray, " p"]
    counts: Int[np.ndarray, " p"]
    columns: Int[np.ndarray, " e"]
    values: Float[np.ndarray, " e"]
    photographed: Float[np.ndarray, "p 3"]
    trust: Float[np.ndarray, " p"]


def otsu_threshold(values: Float[np.ndarray, " k"]) -> float:
    """Otsu's (1979) threshold: the split with the greatest variance between its two classes."""
    v = np.sort(values)
    sums, below = np.cumsum(v), np.arange(1.0, len(v))
    above = len(v) - below
    between = below * above * (sums[:-1] / below - (sums[-1] - sums[:-1]) / above) ** 2
    at = int(np.argmax(between))
    return float(0.5 * (v[at] + v[at + 1]))


def is_bright(colours: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
    """The paper's high-luminance Gaussians; on the logarithm, as radiance spans orders of magnitude."""
    y = np.log(np.maximum(luminance(colours), 1e-12 * float(colours.max()) + 1e-30))
    return y > otsu_threshold(y)


def linear_renders(geometry: Shapes, photographs: Photographs, run: ThreadPool) -> LinearRenders:
    """Compositing weights of every trusted pixel of all views."""
    views = len(photographs.weight)
    blank = np.zeros_like(geometry.means)
    begins, counts = np.empty(0, np.int64), np.empty(0, np.int64)
    columns, values = np.empty(0, np.int32), np.empty(0, np.float32)
    for first in range(0, views, _BATCH):
        batch = range(first, min(first + _BATCH, views))
        found: dict[int, tuple] = {}

        def some(part: int, parts: int, batch: range = batch, found: dict[int, tuple] = found) -> None:
            for view in batch[part::parts]:
                index, packed, (tile_start, members, _, _) = project(
                    geometry, blank, photographs.pinhole(view)
                )
                wanted = photographs.weight[view] > 0
                begin, count, column, value = rasterize_kernels.compositing_weights(
                    packed, index, tile_start, members, photographs.lens, np.float32(0), wanted, _FAINT
                )
                keep = wanted.ravel()
                found[view] = (begin[keep], count[keep], column, value)

        run(some, ())
        done = [found[view] for view in batch]
        offsets = len(columns) + np.cumsum([0, *(len(f[2]) for f in done)])
        _append(begins, [f[0] + offset for f, offset in zip(done, offsets[:-1], strict=True)])
        for whole, parts in zip((counts, columns, values), list(zip(*done, strict=True))[1:], strict=True):
            _append(whole, parts)
    wanted = photographs.weight > 0
    return LinearRenders(
        begins, counts, columns, values, photographs.radiance[wanted], photographs.weight[wanted]
    )  # fmt: skip


def _append(whole: np.ndarray, parts: Sequence[np.ndarray]) -> None:
    """Lengthen an array in place: all views' rows are gigabytes, of which there is no room for a second copy."""
    at = len(whole)
    whole.resize(at + sum(map(len, parts)), refcheck=False)
    for part in parts:
        whole[at : at + len(part)] = part
        at += len(part)


@njit(**_FLAGS)
@no_type_check
def _render_rows(begins, counts, columns, values, colours, out, part, parts):
    """out = A colours."""
    for p in range(part, begins.shape[0], parts):
        r, g, b = 0.0, 0.0, 0.0
        for e in range(begins[p], begins[p] + counts[p]):
            k, w = columns[e], values[e]
            r += w * colours[k, 0]
            g += w * colours[k, 1]
            b += w * colours[k, 2]
        out[p, 0], out[p, 1], out[p, 2] = r, g, b


@njit(**_FLAGS)
@no_type_check
def _pull_rows(begins, counts, columns, values, residual, chunks, chunk_sums, part, parts):
    """chunk_sums[c] = A^T residual over the c-th slice of the rows."""
    total = begins.shape[0]
    for c in range(part, chunks, parts):
        for p in range(total * c // chunks, total * (c + 1) // chunks):
            r, g, b = residual[p, 0], residual[p, 1], residual[p, 2]
            for e in range(begins[p], begins[p] + counts[p]):
                k, w = columns[e], values[e]
                chunk_sums[c, k, 0] += w * r
                chunk_sums[c, k, 1] += w * g
                chunk_sums[c, k, 2] += w * b


@njit(**_FLAGS)
@no_type_check
def _count_free(begins, counts, columns, free, found, part, parts):
    """How many of a row's columns are free."""
    for p in range(part, begins.shape[0], parts):
        for e in range(begins[p], begins[p] + counts[p]):
            found[p] += free[columns[e]]


@njit(**_FLAGS)
@no_type_check
def _take_free(begins, counts, columns, values, free, to, out_columns, out_values, part, parts):
    """The free columns of every row, from `to` on."""
    for p in range(part, begins.shape[0], parts):
        at = to[p]
        for e in range(begins[p], begins[p] + counts[p]):
            if free[columns[e]]:
                out_columns[at], out_values[at] = columns[e], values[e]
                at += 1


def rows_of_free(
    rows: LinearRenders, free: Bool[np.ndarray, " k"], run: ThreadPool
) -> tuple[LinearRenders, Bool[np.ndarray, " p"]]:
    """What the free colours decide: their columns of the rows that have any, and which rows these are."""
    found = np.zeros(len(rows.begins), np.int64)
    run(_count_free, (rows.begins, rows.counts, rows.columns, free, found))
    touched = found > 0
    counts = found[touched]
    begins = np.cumsum(counts) - counts
    columns, values = np.empty(counts.sum(), rows.columns.dtype), np.empty(counts.sum(), rows.values.dtype)
    args = (
        rows.begins[touched],
        rows.counts[touched],
        rows.columns,
        rows.values,
        free,
        begins,
        columns,
        values,
    )
    run(_take_free, args)
    return LinearRenders(
        begins, counts, columns, values, rows.photographed[touched], rows.trust[touched]
    ), touched  # fmt: skip


def epsilon_of(rows: LinearRenders) -> float:
    """The epsilon of Eq. (6), which the paper only calls small: a hundredth of the mean radiance."""
    return 1e-2 * float(rows.photographed.mean())


def render_rows(
    rows: LinearRenders, colours: Float[np.ndarray, "k 3"], out: Float[np.ndarray, "p 3"], run: ThreadPool
) -> None:
    """A colours, into `out` (float64)."""
    run(_render_rows, (rows.begins, rows.counts, rows.columns, rows.values, colours, out))


def backproject_rows(
    rows: LinearRenders, field: Float[np.ndarray, "p 3"], count: int, run: ThreadPool
) -> Float[np.ndarray, "k 3"]:
    """A^T field, for `count` Gaussians."""
    sums = np.zeros((_CHUNKS, count, 3))
    run(_pull_rows, (rows.begins, rows.counts, rows.columns, rows.values, field, _CHUNKS, sums))
    return sums.sum(0)


def solve_colours(
    rows: LinearRenders,
    start: Float[np.ndarray, "k 3"],
    free: Bool[np.ndarray, " k"],
    objective: Literal["energy", "relative"],
    run: ThreadPool,
    step: Callable[[float], None] = lambda fraction: None,
    reweightings: int = 3,
    hold: float = 0.02,
) -> Float[np.ndarray, "k 3"]:
    """Non-negative colours of the `free` Gaussians that best render the photographs, the others fixed.

    `hold` > 0 ties a colour to its start as so large a share of the pixels it covers would: decides where they do
    not. The very minimum of Eq. (6) takes some 30 reweightings, as absolute values do, and next to no hold.
    """
    count, epsilon = len(start), epsilon_of(rows)
    colours = start.astype(np.float64)
    rendered = np.empty((len(rows.begins), 3))
    render_rows(rows, np.ones((count, 3)), rendered, run)
    whole = rendered[:, :1].copy()
    render_rows(rows, np.where(free[:, None], 0, colours), rendered, run)
    # The others' light stays as it is, and most pixels show no free Gaussian: half of the stage's core-seconds went into those.
    rows, touched = rows_of_free(rows, free, run)
    whole, fixed = whole[touched], rendered[touched]
    rendered = np.empty_like(fixed)
    # Arrays of every pixel are large: each is computed in place.
    weights, field = np.empty_like(rendered), np.empty_like(rendered)
    for turn in range(reweightings):
        render_rows(rows, colours, rendered, run)
        rendered += fixed
        np.add(rendered, epsilon, out=field)
        np.divide(rows.trust[:, None], field, out=weights)
        if objective == "relative":
            np.subtract(rows.photographed, rendered, out=rendered)
            np.abs(rendered, out=rendered)
            field *= 1e-2
            weights /= np.maximum(rendered, field, out=field)
        curvature = backproject_rows(rows, np.multiply(weights, whole, out=field), count, run)
        tie = hold * np.maximum(curvature, 1e-12 * curvature.max())
        majoriser = np.where(free[:, None], curvature + tie, np.inf)
        ahead, momentum = colours.copy(), 1.0
        for i in range(_STEPS):
            step((turn + i / _STEPS) / reweightings)
            render_rows(rows, ahead, rendered, run)
            rendered += fixed
            gap = np.subtract(rows.photographed, rendered, out=field)
            pull = backproject_rows(rows, np.multiply(weights, gap, out=field), count, run)
            fresh = ahead + (pull - tie * (ahead - start)) / majoriser
            fresh = np.maximum(fresh, 0)
            following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
            ahead = np.maximum(fresh + (momentum - 1) / following * (fresh - colours), 0)
            colours, momentum = fresh, following
    return colours
