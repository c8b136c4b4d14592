"""Where a room's light is kept: a triangular grid of points on every face, on both of its sides.

A face of `cells` = R has (R + 1)(R + 2) / 2 points, those of row j after those of row j - 1, linear in between; R = 0, of faces
smaller than the pitch, has one. (C. Yuksel, J. Keyser, D. House, "Mesh Colors", 2010.) So no face needs a place in a picture.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from hardware.virtual.studio.interior.read import Interior

MOST_CELLS = 400  # a side of one face
INSET = 0.12  # of a cell: points stay off the edges, where other faces stand


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """How the points of all faces follow one another."""

    first: Int[np.ndarray, " f"]
    cells: Int[np.ndarray, " f"]
    count: int


def layout(room: Interior, budget: int) -> Layout:
    """Grids of one pitch all over with about `budget` points more than faces; faces smaller than the pitch have one each."""
    edges = room.vertices[room.faces]
    sides = np.linalg.norm(edges - np.roll(edges, 1, 1), axis=2)
    longest = sides.max(1)
    area = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) / 2
    # Cells of a sliver are slivers: rows as fine as its height asks for would be too many along its length.
    scale = longest**0.6 * (2 * area / np.maximum(longest, 1e-12)) ** 0.4
    low, high = 1e-4, float(longest.max())
    for _ in range(40):
        pitch = (low * high) ** 0.5
        cells = _cells(scale, longest, pitch)
        low, high = (pitch, high) if _points(cells).sum() > budget + len(cells) else (low, pitch)
    cells = _cells(scale, longest, high)
    points = _points(cells)
    return Layout(np.cumsum(points) - points, cells, int(points.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """The points themselves: on which face, and where on it."""

    face: Int[np.ndarray, " n"]
    weights: Float[np.ndarray, "n 3"]  # of its corners


def points(grid: Layout) -> Points:
    """Every point in order."""
    face = np.repeat(np.arange(len(grid.cells)), _points(grid.cells))
    order = np.arange(grid.count) - grid.first[face]
    size = grid.cells[face]
    # Row j begins at j (2R + 3 - j) / 2: solved for j, then put right where rounding was unlucky.
    row = np.floor((2 * size + 3 - np.sqrt(np.maximum((2 * size + 3.0) ** 2 - 8 * order, 0))) / 2).astype(int)
    row = np.where(row * (2 * size + 3 - row) // 2 > order, row - 1, row)
    row = np.where((row + 1) * (2 * size + 2 - row) // 2 <= order, row + 1, row)
    column = order - row * (2 * size + 3 - row) // 2
    safe = np.maximum(size, 1)
    weights = np.stack([safe - row - column, column, row], 1) / safe[:, None]
    weights[size == 0] = 1 / 3
    inset = (INSET / (size + 1))[:, None]
    return Points(face, weights * (1 - 3 * inset) + inset)


def _cells(scale: np.ndarray, longest: np.ndarray, pitch: float) -> np.ndarray:
    cells = np.clip(np.ceil(scale / pitch), 1, MOST_CELLS).astype(int)
    return np.where(longest < pitch, 0, cells)


def _points(cells: np.ndarray) -> np.ndarray:
    return (cells + 1) * (cells + 2) // 2
