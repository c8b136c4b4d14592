"""Solve the colours with the geometry fixed: stage 2, as the linear problem that it is.

Source: the paper, Sec. 3.2, Eq. (6): with means, shapes and densities fixed, a rendering is linear in the
colours, m = A c, so stage 2 is a non-negative reweighted least-squares problem. Two objectives:

- "relative": Eq. (6) itself, |m^ - m| / (sg(m) + eps), by iteratively reweighted least squares; for the
  bright Gaussians that Otsu's threshold on log luminance picks.
- "energy": sum of (m^ - m)^2 / (sg(m) + eps), the variance a photon count has. Its optimum renders the
  photographed energy, where an L1 fit takes medians and dims what is small and bright.

The solver is projected gradient with a separable majoriser and Nesterov's momentum: A's rows are compositing
weights, non-negative with sums of at most one, so diag(A^T w A 1) bounds the curvature. Clipped pixels are
lower bounds: they pull only while the rendering is below them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from engine.light import kernels_cpu
from engine.light.photographs import Photographs
from engine.light.rasterise import Run, Shapes, project
from engine.radiance import luminance

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
_FAINT = np.float32(2e-4)
_STEPS = 15  # of the gradient, within each reweighting
_CHUNKS = 8  # of the transposed product; fixed, so that its sums do not depend on the machine


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The image as a linear function of the colours: sparse rows A, photographed b, and their bounds."""

    begins: Int[np.ndarray, " p"]
    counts: Int[np.ndarray, " p"]
    columns: Int[np.ndarray, " e"]
    values: Float[np.ndarray, " e"]
    photographed: Float[np.ndarray, "p 3"]
    trust: Float[np.ndarray, " p"]
    lower_bound: Bool[np.ndarray, " p"]


def otsu_threshold(values: Float[np.ndarray, " k"]) -> float:
    """Otsu's (1979) threshold: the split with the greatest variance between its two classes."""
    v = np.sort(values)
    sums, below = np.cumsum(v), np.arange(1.0, len(v))
    above = len(v) - below
    between = below * above * (sums[:-1] / below - (sums[-1] - sums[:-1]) / above) ** 2
    at = int(np.argmax(between))
    return float(0.5 * (v[at] + v[at + 1]))


def bright_ones(colours: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
    """The paper's high-luminance Gaussians; on the logarithm, as radiance spans orders of magnitude."""
    y = np.log(np.maximum(luminance(colours), 1e-12 * float(colours.max()) + 1e-30))
    return y > otsu_threshold(y)


def rows_of(geometry: Shapes, photographs: Photographs, run: Run) -> Rows:
    """Compositing weights of every trusted pixel of all views."""
    found: list[tuple | None] = [None] * len(photographs.weight)
    blank = np.zeros_like(geometry.means)

    def some(part: int, parts: int) -> None:
        for view in range(part, len(found), parts):
            index, packed, (tile_start, members, _, _) = project(geometry, blank, photographs.pinhole(view))
            wanted = photographs.weight[view] > 0
            begins, counts, columns, values = kernels_cpu.compositing_weights(
                packed, index, tile_start, members, photographs.lens, np.float32(0), wanted, _FAINT
            )
            keep = wanted.ravel()
            found[view] = (begins[keep], counts[keep], columns, values)

    run(some, ())
    done = [f for f in found if f is not None]
    offsets = np.concatenate([[0], np.cumsum([len(f[2]) for f in done])])
    wanted = photographs.weight > 0
    return Rows(
        np.concatenate([f[0] + offset for f, offset in zip(done, offsets[:-1], strict=True)]),
        np.concatenate([f[1] for f in done]),
        np.concatenate([f[2] for f in done]),
        np.concatenate([f[3] for f in done]),
        photographs.radiance[wanted],
        photographs.weight[wanted],
        photographs.clipped[wanted],
    )


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


def epsilon_of(rows: Rows) -> float:
    """The epsilon of Eq. (6), which the paper only calls small: a hundredth of the mean radiance."""
    return 1e-2 * float(rows.photographed.mean())


def render_rows(
    rows: Rows, colours: Float[np.ndarray, "k 3"], out: Float[np.ndarray, "p 3"], run: Run
) -> None:
    """A colours, into `out` (float64)."""
    run(_render_rows, (rows.begins, rows.counts, rows.columns, rows.values, colours, out))


def pull_rows(rows: Rows, field: Float[np.ndarray, "p 3"], count: int, run: Run) -> Float[np.ndarray, "k 3"]:
    """A^T field, for `count` Gaussians."""
    sums = np.zeros((_CHUNKS, count, 3))
    run(_pull_rows, (rows.begins, rows.counts, rows.columns, rows.values, field, _CHUNKS, sums))
    return sums.sum(0)


def solve_colours(
    rows: Rows,
    start: Float[np.ndarray, "k 3"],
    free: Bool[np.ndarray, " k"],
    objective: Literal["energy", "relative"],
    run: Run,
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
    whole = np.empty_like(rendered)
    render_rows(rows, np.ones((count, 3)), whole, run)
    for turn in range(reweightings):
        render_rows(rows, colours, rendered, run)
        scale = rendered + epsilon
        weights = rows.trust[:, None] / scale
        if objective == "relative":
            gap = np.abs(rows.photographed - rendered)
            weights = weights / np.maximum(gap, 1e-2 * scale)
        curvature = pull_rows(rows, weights * whole, count, run)
        tie = hold * np.maximum(curvature, 1e-12 * curvature.max())
        majoriser = np.where(free[:, None], curvature + tie, np.inf)
        ahead, momentum = colours.copy(), 1.0
        for i in range(_STEPS):
            step((turn + i / _STEPS) / reweightings)
            render_rows(rows, ahead, rendered, run)
            gap = rows.photographed - rendered
            gap[rows.lower_bound] = np.maximum(gap[rows.lower_bound], 0)
            pull = pull_rows(rows, weights * gap, count, run)
            fresh = ahead + (pull - tie * (ahead - start)) / majoriser
            fresh = np.maximum(fresh, 0)
            following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
            ahead = np.maximum(fresh + (momentum - 1) / following * (fresh - colours), 0)
            colours, momentum = fresh, following
    return colours
