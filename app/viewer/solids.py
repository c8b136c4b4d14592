"""Shapes made of triangles and lines: balls, ellipsoids, the ground's grid. World frame, scene units."""

import numpy as np
from jaxtyping import Float, Int, UInt8

from app.viewer.scene import Scene

_GOLDEN = (1 + 5**0.5) / 2
_ICOSAHEDRON = np.array(
    [
        (-1, _GOLDEN, 0), (1, _GOLDEN, 0), (-1, -_GOLDEN, 0), (1, -_GOLDEN, 0),
        (0, -1, _GOLDEN), (0, 1, _GOLDEN), (0, -1, -_GOLDEN), (0, 1, -_GOLDEN),
        (_GOLDEN, 0, -1), (_GOLDEN, 0, 1), (-_GOLDEN, 0, -1), (-_GOLDEN, 0, 1),
    ]
)  # fmt: skip
_FACES = (
    (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
    (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
    (8, 6, 7), (9, 8, 1),
)  # fmt: skip
CELLS = 20  # of the grid, from its middle to its rim
PIECES = 10  # of a grid line, each with its own colour, so that it fades


def ball(splits: int) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """The unit sphere: an icosahedron whose edges are halved `splits` times."""
    points = [tuple(point / np.linalg.norm(point)) for point in _ICOSAHEDRON]
    faces = list(_FACES)
    for _ in range(splits):
        halves: dict[tuple[int, int], int] = {}

        def half(a: int, b: int, halves: dict[tuple[int, int], int] = halves) -> int:
            edge = (min(a, b), max(a, b))
            if edge not in halves:
                middle = np.add(points[a], points[b])
                points.append(tuple(middle / np.linalg.norm(middle)))
                halves[edge] = len(points) - 1
            return halves[edge]

        split = []
        for a, b, c in faces:
            ab, bc, ca = half(a, b), half(b, c), half(c, a)
            split += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = split
    return np.array(points), np.array(faces)


def ellipsoids(
    centres: Float[np.ndarray, "n 3"],
    halves: Float[np.ndarray, "n 3 3"],
    colours: UInt8[np.ndarray, "n 3"],
    up: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"], UInt8[np.ndarray, "v 3"]]:
    """Points, triangles and colours; `halves` has the half axes as columns.

    They shine, so nothing shades them; a little darker below than above tells their shape all the same.
    """
    unit, faces = ball(1)
    points = centres[:, None] + np.einsum("nij,vj->nvi", halves, unit)
    lengths2 = np.maximum((halves**2).sum(1), 1e-30)  # n 3
    normals = np.einsum("nij,nj,vj->nvi", halves, 1 / lengths2, unit)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    shade = 0.78 + 0.22 * (normals @ up)
    triangles = faces + (np.arange(len(centres)) * len(unit))[:, None, None]
    painted = colours[:, None] * shade[..., None]
    return points.reshape(-1, 3), triangles.reshape(-1, 3), painted.reshape(-1, 3).astype(np.uint8)


def grid(
    scene: Scene,
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "l 2"], Float[np.ndarray, " l"]]:
    """Squares of a round size under everything; and how far each piece has faded, 0 to 1."""
    contents = scene.contents
    up, front = np.array(contents.up), np.array(contents.front)
    side = np.cross(front, up)
    middle = np.array(contents.room)
    power = 10.0 ** np.floor(np.log10(contents.room_radius / 4))
    cell = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= contents.room_radius / 4)
    heights = scene.emitters.gaussians.means @ up if scene.emitters is not None else middle[None] @ up
    floor = float(np.percentile(heights, 1.5))
    origin = middle + (floor - middle @ up) * up
    reach = np.linspace(-CELLS, CELLS, 2 * CELLS * PIECES // 5 + 1) * cell / 2
    lines = np.arange(-CELLS // 2, CELLS // 2 + 1) * cell
    rows = []
    for along, across in ((front, side), (side, front)):
        points = origin + reach[None, :, None] * along + lines[:, None, None] * across
        rows.append(np.stack([points[:, :-1], points[:, 1:]], 2).reshape(-1, 2, 3))
    pieces = np.concatenate(rows)
    away = np.linalg.norm(pieces.mean(1) - origin, axis=1) / (CELLS / 2 * cell)
    kept = away < 1
    pairs = np.arange(2 * int(kept.sum())).reshape(-1, 2)
    return pieces[kept].reshape(-1, 3), pairs, np.clip(away[kept], 0, 1) ** 1.2
