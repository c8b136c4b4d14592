"""Sort the pixels of a cube map into direction cells, conserving energy.

Frames: cube faces and directions share one frame (the camera's, for probes). Face f looks along its own z;
`FACES[f]` is face_from_frame. A pixel's energy goes to the nearest direction, or is shared among the three
directions around it so that its own direction is their weighted mean: the share that a cosine-like
function of direction (diffuse shading) cannot tell from the pixel itself, where nearest is off by up to
half a cell.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix, diags
from scipy.spatial import ConvexHull, KDTree

FACES = np.array(
    [
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    ],
    dtype=np.float64,
)

SHARPEN = 0.75
"""Spreading a second time has twice the variance of the tent, so half of what it takes away undoes the tent; a quarter
more undoes the cell by which `brdf.lobe_floor` widens lobes."""
AGAIN_PX = 96
PIXELS_PER_CELL = 1.6
"""At least: with fewer some cells get no pixel, and no light."""


@dataclass(frozen=True, slots=True, eq=False)
class CellMap:
    """Where the energy of every pixel of a cube map of `side` pixels goes."""

    index: Int[np.ndarray, "6 side side s"]  # into the directions; s = 1 nearest, 3 shared
    share: Float[np.ndarray, "6 side side s"]  # float32, sums to 1 over s


def face_directions(side: int) -> Float[np.ndarray, "6 side side 3"]:
    """Unit directions of the pixel centres of all six faces."""
    at = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(at, at)
    local = np.stack([x, y, np.ones_like(x)], axis=-1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    return np.einsum("hwi,fij->fhwj", local, FACES)


def pixel_solid_angles(side: int) -> Float[np.ndarray, "side side"]:
    """Exact solid angle of every pixel of a cube face (they sum to 4 pi / 6)."""
    edge = np.arange(side + 1) / side * 2 - 1
    x, y = np.meshgrid(edge, edge)
    corner = np.arctan2(x * y, np.sqrt(x * x + y * y + 1))
    return corner[1:, 1:] - corner[:-1, 1:] - corner[1:, :-1] + corner[:-1, :-1]


def nearest_cells(directions: Float[np.ndarray, "d 3"], side: int) -> CellMap:
    """Every pixel wholly into its nearest direction."""
    index = KDTree(directions).query(face_directions(side))[1]
    index = np.ascontiguousarray(index[..., None], dtype=np.int32)
    return CellMap(index, np.ones(index.shape, np.float32))


def own_cells(side: int, fine: int) -> CellMap:
    """Every pixel of a cube map `fine` times finer into the one of `side` that holds it, as if these were directions."""
    face, v, u = np.indices((6, side * fine, side * fine))
    index = ((face * side + v // fine) * side + u // fine)[..., None].astype(np.int32)
    return CellMap(index, np.ones(index.shape, np.float32))


def interpolated_cells(directions: Float[np.ndarray, "d 3"], side: int) -> CellMap:
    """Every pixel among the three directions of the spherical triangle that holds it."""
    triangles = ConvexHull(directions).simplices
    matrices = np.linalg.inv(np.swapaxes(directions[triangles], 1, 2))  # direction -> corner weights
    order = np.argsort(triangles.ravel(), kind="stable")
    start = np.searchsorted(triangles.ravel()[order], np.arange(len(directions) + 1))
    rays = face_directions(side).reshape(-1, 3)
    best = np.full(len(rays), -np.inf)
    index = np.zeros((len(rays), 3), np.int32)
    share = np.zeros((len(rays), 3))
    # The triangle around a ray nearly always touches its nearest direction; obtuse ones need the next ones.
    for close in KDTree(directions).query(rays, k=4)[1].T:
        todo = best < -1e-9
        if not todo.any():
            break
        for nth in range(int((start[1:] - start[:-1]).max())):
            at = start[close] + nth
            rows = np.nonzero(todo & (at < start[close + 1]))[0]
            triangle = order[at[rows]] // 3
            weights = np.einsum("rij,rj->ri", matrices[triangle], rays[rows])
            weights /= weights.sum(1, keepdims=True)
            better = weights.min(1) > best[rows]
            rows, triangle, weights = rows[better], triangle[better], weights[better]
            best[rows] = weights.min(1)
            index[rows], share[rows] = triangles[triangle], weights
    share = np.maximum(share, 0)
    share /= share.sum(1, keepdims=True)
    shape = (6, side, side, 3)
    return CellMap(index.reshape(shape), share.astype(np.float32).reshape(shape))


def deconvolve(
    energy: Float[np.ndarray, "m d v"], directions: Float[np.ndarray, "d 3"]
) -> Float[np.ndarray, "m d v"]:
    """Energy that was shared among cells, so that a smooth function summed over it is what the light itself gives.

    Sharing spreads light over a tent, which flattens shading: what faces a window is up to half a per cent too
    dark and what turns from it two too bright at 512 cells. The first term of the inverse takes that back (Van Cittert
    1931): some of what a second spreading would take away is given on top. Beside bright light a little goes below zero.
    """
    again, sharp = _spread_again(directions.tobytes(), len(directions)), np.empty_like(energy)
    for probe, flat in enumerate(energy):  # one at a time: the product is in double precision
        sharp[probe] = flat + SHARPEN * (flat - again @ flat)
    return sharp


@functools.lru_cache(4)
def _spread_again(directions: bytes, count: int) -> csr_matrix:
    """What sharing makes of light that already sits in the cells: a square matrix whose columns sum to one."""
    side = max(AGAIN_PX, math.ceil(math.sqrt(PIXELS_PER_CELL * count / 6)))
    cells = interpolated_cells(np.frombuffer(directions).reshape(count, 3), side)
    index, share = cells.index.reshape(-1, 3), cells.share.reshape(-1, 3).astype(np.float64)
    omega = np.broadcast_to(pixel_solid_angles(side), (6, side, side)).ravel()
    pixel = np.repeat(np.arange(len(index)), 3)
    shares = csr_matrix((share.ravel(), (index.ravel(), pixel)), (count, len(index)))
    mass = shares @ diags(omega) @ shares.T
    return csr_matrix(mass @ diags(1 / np.asarray(mass.sum(0)).ravel()))
