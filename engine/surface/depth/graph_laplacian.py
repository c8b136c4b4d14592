"""Systems whose matrix is the Laplacian of a graph between pixels: made, and solved exactly or by multigrid."""

from collections.abc import Callable

import numpy as np
import pyamg
import scipy.sparse as sparse
from jaxtyping import Float, Int
from scipy.sparse.linalg import LinearOperator, cg, splu

from engine.errors import SurfaceError

DIRECT = 150_000
"""Unknowns up to which a factorisation is faster than multigrid: 0.05 s a system of 16 000, 0.2 s of 48 000, where multigrid
takes 0.08 and 0.9 s on a relief whose walls are torn; 1.6 s of 260 000."""
RESIDUAL, TURNS = 1e-5, 200
"""Of multigrid: the part of the right-hand side that may be left, and after how many turns it has failed."""


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


def solver_of(
    system: sparse.csc_matrix, count: int
) -> tuple[bool, Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, " p"]]]:
    """Whether it is exact, and what solves such a system of `count` unknowns: a factorisation, or of a large one a cycle of
    multigrid."""
    if count <= DIRECT:
        options = {"SymmetricMode": True}
        return True, splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve
    cycles = pyamg.smoothed_aggregation_solver(
        system.tocsr(), max_coarse=500, smooth=("jacobi", {"weighting": "local"}), coarse_solver="splu"
    ).aspreconditioner()
    return False, cycles.matvec


def solve_system(
    system: sparse.csc_matrix, right: Float[np.ndarray, " p"], start: Float[np.ndarray, " p"] | None = None
) -> Float[np.ndarray, " p"]:
    """The system's solution; multigrid begins at `start`.

    Raises:
        SurfaceError: multigrid does not converge.
    """
    exact, solver = solver_of(system, len(right))
    if exact:
        return solver(right)
    cycle = LinearOperator(system.shape, solver)
    found, short = cg(system, right, x0=start, rtol=RESIDUAL, maxiter=TURNS, M=cycle)
    if short:
        left = np.linalg.norm(right - system @ found) / max(np.linalg.norm(right), 1e-30)
        raise SurfaceError(
            f"the depth of {len(right)} pixels is not settled after {TURNS} turns: a residual of {left:.1g} is left,"
            f" {RESIDUAL:g} is asked; average the photographs down (hdr.long_edge_px) or mend the mask"
        )
    return found
