"""Normals become depth: bilateral normal integration for a perspective camera.

Source: Cao, Santo, Shi, Okura, Matsushita, "Bilateral Normal Integration", ECCV 2022: each pixel's one-sided
depth differences carry weights that let one side go where the surface is torn; iteratively reweighted
least squares on log depth. Of a tear all around a part normals do not tell the height; where its two sides hang
together elsewhere they do, but these weights do not find it: the sides are drawn together. Camera frame; the answer is
depth along z up to one factor, fixed by the caller.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float

from engine.errors import SurfaceError
from engine.geometry import unproject
from engine.progress import Progress
from engine.surface.data.observations import islands, numbered
from engine.surface.depth.graph_laplacian import laplacian, solve_system
from engine.types import Camera

SETTLED = 1e-4
"""Change of log depth, root mean square, below which the weights are taken to stand."""


def integrate(
    camera: Camera,
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    mean_depth: float,
    progress: Progress,
    sharpness: float = 2.0,
    rounds: int = 20,
    start: Float[np.ndarray, " p"] | None = None,
) -> Float[np.ndarray, "h w"]:
    """Depth z (scene units, zero outside `mask`) whose mean over each connected part is `mean_depth`.

    With n . (d(z q)/du) = 0 for the image-plane ray q = (x, y, 1), log depth obeys
    n.q dlog(z)/dx + n_x = 0, and alike in y, with x, y on the ideal image plane (z = 1).
    `sharpness` is the k of the paper's sigmoid weights: larger tears more readily. `start`: log depth of the mask's pixels
    that multigrid begins at.

    Raises:
        SurfaceError: the mask is empty, or multigrid does not converge.
    """
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    height, width = mask.shape
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    xy = unproject(camera, np.stack([u, v], -1))
    index = numbered(mask)
    nq = np.minimum(normals[..., 0] * xy[..., 0] + normals[..., 1] * xy[..., 1] + normals[..., 2], -1e-2)
    count = int(mask.sum())

    # One-sided equations: weight * (L[neighbour] - L[pixel]) = target, four families.
    families = []
    for axis, component in ((1, 0), (0, 1)):
        for sign in (1, -1):
            neighbour = np.roll(index, -sign, axis)
            valid = mask & (neighbour >= 0)
            np.moveaxis(valid, axis, 0)[-1 if sign > 0 else 0] = False  # np.roll wraps round
            spacing = np.roll(xy[..., component], -sign, axis) - xy[..., component]
            # The neighbour's own n.q belongs in equally; the mean is exact to second order.
            target = -normals[..., component][valid] * spacing[valid]
            families.append((index[valid], neighbour[valid], nq[valid], target))
    pixel, beside, weight, target = (np.concatenate(parts) for parts in zip(*families, strict=True))
    cuts = np.cumsum([len(p) for p, *_ in families])[:-1]

    log_depth = np.zeros(count) if start is None else start
    shares = np.full(len(pixel), 0.5)
    part, part_count = islands(mask)
    # A gauge: one soft equation per connected part pins its mean.
    gauge = sparse.csr_matrix((np.ones(count), (part, np.arange(count))), shape=(part_count, count))
    sizes = np.bincount(part, minlength=part_count)
    for step in range(rounds):
        progress.step(step / rounds, "integrating normals to depth")
        # Every equation is an edge of a graph: the system is its Laplacian.
        pull = shares * weight**2
        push = shares * weight * target
        system = laplacian(pixel, beside, pull, count, 1e-9)
        right = np.bincount(beside, push, count) - np.bincount(pixel, push, count)
        found = solve_system(system, right, log_depth)
        before, log_depth = log_depth, found - ((gauge @ found) / sizes)[part]
        if step and np.sqrt(((log_depth - before) ** 2).mean()) < SETTLED:
            break
        misses = weight * (log_depth[beside] - log_depth[pixel]) - target
        scale = np.median(np.abs(misses)) + 1e-12
        residuals = []
        for (p, *_), miss in zip(families, np.split(misses, cuts), strict=True):
            full = np.zeros(count)
            full[p] = miss
            residuals.append(full)
        told = []
        for pair in (0, 2):
            ahead, behind = ((residuals[pair + i] / scale) ** 2 for i in (0, 1))
            # Dimensionless: the residual is measured in units of its own median, so the weights do not
            # depend on the pixel pitch. A residual below a few medians is noise, not a tear.
            lean = 1 / (1 + np.exp(-np.clip(sharpness * (behind - ahead) / 100, -50, 50)))
            told += [lean[families[pair][0]], 1 - lean[families[pair + 1][0]]]
        shares = np.concatenate(told)
    depth = np.zeros(mask.shape)
    z = np.exp(log_depth)
    z *= (mean_depth * sizes / np.bincount(part, z, minlength=part_count))[part]
    depth[mask] = z
    return depth
