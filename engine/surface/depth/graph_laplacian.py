"""Systems whose matrix is the Laplacian of a graph between pixels: made, and solved exactly or by multigrid."""

import numpy as np
import pyamg
import scipy.sparse as sparse
from jaxtyping import Float, Int
from scipy.sparse.linalg import LinearOperator, cg, splu

from engine.errors import SurfaceError

DIRECT_SOLVE_PIXELS = 150_000
"""Unknowns up to which a factorisation is faster than multigrid: 0.05 s a system of 16 000, 0.2 s of 48 000, where multigrid
takes 0.08 and 0.9 s on a relief whose walls are torn; 1.6 s of 260 000."""
ITERATIONS = 200
"""After which multigrid has failed."""


def laplacian(
    one: Int[np.ndarray, " e"],
    other: Int[np.ndarray, " e"],
    weight: Float[np.ndarray, " e"],
    count: int,
    more: float | Float[np.ndarray, " p"],
) -> sparse.csc_matrix:
    """Of the graph of these edges between `count` pixels; with so much `more` on its diagonal that it can be inverted."""
    place = np.arange(count)
    degree = np.bincount(one, weight, count) + np.bincount(other, weight, count) + more
    rows, columns = np.concatenate([one, other, place]), np.concatenate([other, one, place])
    values = np.concatenate([-weight, -weight, degree])
    return sparse.csc_matrix((values, (rows, columns)), shape=(count, count))


def solve_system(system: sparse.csc_matrix, right: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """The system's solution: by a factorisation, or of a large one by multigrid.

    Raises:
        SurfaceError: multigrid does not converge.
    """
    count = len(right)
    if count <= DIRECT_SOLVE_PIXELS:
        options = {"SymmetricMode": True}
        return splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(right)
    cycles = pyamg.smoothed_aggregation_solver(
        system.tocsr(), max_coarse=500, smooth=("jacobi", {"weighting": "local"}), coarse_solver="splu"
    ).aspreconditioner()
    tolerance = 1e-5  # the part of the right-hand side that may be left
    near = LinearOperator(system.shape, cycles.matvec)
    found, short = cg(system, right, rtol=tolerance, maxiter=ITERATIONS, M=near)
    if short:
        left = np.linalg.norm(right - system @ found) / max(np.linalg.norm(right), 1e-30)
        raise SurfaceError(
            f"normal integration did not converge ({count} pixels, residual {left:.1g} after {ITERATIONS} iterations,"
            f" tolerance {tolerance:g}); reduce the image size (hdr.long_edge_px) or fix the mask"
        )
    return found
