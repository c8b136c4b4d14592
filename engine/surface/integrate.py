"""Normals become depth: bilateral normal integration for a perspective camera.

Source: Cao, Santo, Shi, Okura, Matsushita, "Bilateral Normal Integration", ECCV 2022: each pixel's one-sided
depth differences carry weights that let one side go where the surface is torn; iteratively reweighted
least squares on log depth. Camera frame; the answer is depth along z up to one factor, fixed by the caller.
"""

import numpy as np
import pyamg
import scipy.sparse as sparse
from jaxtyping import Bool, Float
from scipy.sparse.linalg import cg

from engine.errors import SurfaceError
from engine.geometry import unproject
from engine.progress import Progress
from engine.surface.observations import islands, numbered
from engine.types import Camera


def integrate(
    camera: Camera,
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    mean_depth: float,
    progress: Progress,
    sharpness: float = 2.0,
    rounds: int = 20,
) -> Float[np.ndarray, "h w"]:
    """Depth z (scene units, zero outside `mask`) whose mean over each connected part is `mean_depth`.

    With n . (d(z q)/du) = 0 for the image-plane ray q = (x, y, 1), log depth obeys
    n.q dlog(z)/dx + n_x = 0, and alike in y, with x, y on the ideal image plane (z = 1).
    `sharpness` is the k of the paper's sigmoid weights: larger tears more readily.

    Raises:
        SurfaceError: the mask is empty.
    """
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    height, width = mask.shape
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    xy = unproject(camera, np.stack([u, v], -1))
    index = numbered(mask)
    nq = np.minimum(normals[..., 0] * xy[..., 0] + normals[..., 1] * xy[..., 1] + normals[..., 2], -1e-2)
    count = int(mask.sum())

    # One-sided equations: coeff * (L[neighbour] - L[pixel]) = target, four families.
    families = []
    for axis, component in ((1, 0), (0, 1)):
        for sign in (1, -1):
            neighbour = np.roll(index, -sign, axis)
            valid = mask & (neighbour >= 0)
            np.moveaxis(valid, axis, 0)[-1 if sign > 0 else 0] = False  # np.roll wraps round
            spacing = np.roll(xy[..., component], -sign, axis) - xy[..., component]
            p, q = index[valid], neighbour[valid]
            # The neighbour's own n.q belongs in equally; the mean is exact to second order.
            weight, target = nq[valid], -normals[..., component][valid] * spacing[valid]
            rows = np.arange(len(p))
            matrix = sparse.csr_matrix(
                (np.concatenate([weight, -weight]), (np.tile(rows, 2), np.concatenate([q, p]))),
                shape=(len(p), count),
            )
            families.append((p, matrix, target))

    log_depth = np.zeros(count)
    shares = [np.full(len(p), 0.5) for p, _, _ in families]
    part, part_count = islands(mask)
    # A gauge: one soft equation per connected part pins its mean.
    gauge = sparse.csr_matrix((np.ones(count), (part, np.arange(count))), shape=(part_count, count))
    sizes = np.bincount(part, minlength=part_count)
    previous = np.inf
    for step in range(rounds):
        progress.step(step / rounds, "integrating normals to depth")
        system = sparse.identity(count, format="csr") * 1e-9
        right = np.zeros(count)
        energy = 0.0
        for (_, matrix, target), share in zip(families, shares, strict=True):
            weighted = matrix.T.multiply(share).tocsr()
            system = system + weighted @ matrix
            right += weighted @ target
        solver = pyamg.smoothed_aggregation_solver(
            system.tocsr(), max_coarse=500, smooth=("jacobi", {"weighting": "local"}), coarse_solver="splu"
        )
        log_depth, _ = cg(system, right, x0=log_depth, rtol=1e-5, maxiter=200, M=solver.aspreconditioner())
        log_depth -= ((gauge @ log_depth) / sizes)[part]
        residuals = []
        for p, matrix, target in families:
            full = np.full(count, np.nan)
            full[p] = matrix @ log_depth - target
            residuals.append(full)
            energy += float((full[p] ** 2).sum())
        scale = np.median(np.abs(np.concatenate([r[np.isfinite(r)] for r in residuals]))) + 1e-12
        for pair in (0, 2):
            ahead, behind = (np.nan_to_num(residuals[pair + i] / scale) ** 2 for i in (0, 1))
            # Dimensionless: the residual is measured in units of its own median, so the weights do not
            # depend on the pixel pitch. A residual below a few medians is noise, not a tear.
            lean = 1 / (1 + np.exp(-np.clip(sharpness * (behind - ahead) / 100, -50, 50)))
            shares[pair] = lean[families[pair][0]]
            shares[pair + 1] = 1 - lean[families[pair + 1][0]]
        if abs(previous - energy) < 1e-3 * energy:
            break
        previous = energy
    depth = np.zeros(mask.shape)
    z = np.exp(log_depth)
    z *= (mean_depth * sizes / np.bincount(part, z, minlength=part_count))[part]
    depth[mask] = z
    return depth
