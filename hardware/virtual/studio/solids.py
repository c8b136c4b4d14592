"""Shape triangle meshes by formula: spheres, heightfields, tubes, hulls, and normals that respect edges.

Any frame; metres. Triangles wind counter-clockwise seen from outside.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.spatial import ConvexHull


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A closed surface of triangles with a shading normal at every vertex."""

    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


def join(parts: list[Solid]) -> Solid:
    """One mesh of several; they may run through each other."""
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Solid(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.faces + o for p, o in zip(parts, offsets, strict=True)]),
    )


def moved(solid: Solid, rotation: Float[np.ndarray, "3 3"], shift: Float[np.ndarray, "3"]) -> Solid:
    """Turned, then shifted."""
    return Solid(solid.vertices @ rotation.T + shift, solid.normals @ rotation.T, solid.faces)


def ball(cells: int, radius: Callable[[Float[np.ndarray, "v 3"]], Float[np.ndarray, " v"]]) -> Solid:
    """A star-shaped body: unit directions from a cube of `cells`^2 per side, pushed out by `radius`."""
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, cells + 1))
    a, b = np.meshgrid(t, t, indexing="ij")
    one = np.ones_like(a)
    # Each side's first edge crossed with its second points outwards.
    sides = [(one, a, b), (-one, b, a), (b, one, a), (a, -one, b), (a, b, one), (b, a, -one)]
    points = np.concatenate([np.stack(s, -1).reshape(-1, 3) for s in sides])
    faces = np.concatenate([_grid_faces(cells, cells) + k * (cells + 1) ** 2 for k in range(6)])
    points, faces = weld(points, faces)
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    return with_normals(directions * radius(directions)[:, None], faces, crease_deg=None)


def lathe(
    profile: Float[np.ndarray, "k 2"], around: int, radius: Callable[[np.ndarray, np.ndarray], np.ndarray],
    crease_deg: float | None,
) -> Solid:  # fmt: skip
    """A profile (radius, height), top to bottom, swept about z; `radius(r, angle)` may flute it.

    Its ends must reach radius 0.
    """
    angle = np.linspace(0, 2 * np.pi, around + 1)[:-1]
    r = radius(profile[:, :1], angle[None])
    points = np.stack(
        [r * np.cos(angle), r * np.sin(angle), np.broadcast_to(profile[:, 1:], r.shape)], -1
    ).reshape(-1, 3)
    k = len(profile)
    index = np.arange(k * around).reshape(k, around)
    index = np.concatenate([index, index[:, :1]], 1)
    points, faces = weld(points, _faces_of(index))
    return with_normals(points, faces, crease_deg)


def tube(path: Float[np.ndarray, "k 3"], radius: float, around: int) -> Solid:
    """A closed round wire along a closed path (first point not repeated)."""
    tangent = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.zeros_like(path)
    side[0] = np.cross(tangent[0], [0.3, 0.5, 0.8])
    for i in range(1, len(path)):  # the frame that turns least
        side[i] = side[i - 1] - tangent[i] * (side[i - 1] @ tangent[i])
        side[i] /= np.linalg.norm(side[i])
    side[0] /= np.linalg.norm(side[0])
    # What the frame has turned by after one round is spread along it, so that the seam closes.
    last = side[-1] - tangent[0] * (side[-1] @ tangent[0])
    twist = np.arctan2(np.cross(last, side[0]) @ tangent[0], last @ side[0])
    turn = twist * np.arange(len(path)) / len(path)
    other = np.cross(tangent, side)
    angle = turn[:, None] + np.linspace(0, 2 * np.pi, around + 1)[:-1]
    normals = np.cos(angle)[..., None] * side[:, None] + np.sin(angle)[..., None] * other[:, None]
    points = path[:, None] + radius * normals
    index = np.arange(len(path) * around).reshape(len(path), around)
    index = np.concatenate([index, index[:1]], 0)
    index = np.concatenate([index, index[:, :1]], 1)
    return Solid(points.reshape(-1, 3), normals.reshape(-1, 3), _faces_of(index)[:, ::-1])


def terrain(
    heights: Float[np.ndarray, "r c"], width: float, height: float, base: float, crease_deg: float
) -> Solid:
    """A block whose top (z = heights over x, y) is carved and whose bottom lies at z = base."""
    r, c = heights.shape
    y, x = np.meshgrid(
        np.linspace(-height / 2, height / 2, r), np.linspace(-width / 2, width / 2, c), indexing="ij"
    )
    top = np.stack([x, y, heights], -1).reshape(-1, 3)
    low = np.stack([x, y, np.full_like(x, base)], -1).reshape(-1, 3)
    index = np.arange(r * c).reshape(r, c)
    ring = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    skirt = np.stack([np.append(ring, ring[0]) + r * c, np.append(ring, ring[0])])
    faces = np.concatenate([_faces_of(index)[:, ::-1], _faces_of(index + r * c), _faces_of(skirt)[:, ::-1]])
    return with_normals(np.concatenate([top, low]), faces, crease_deg)


def hull(corners: Float[np.ndarray, "k 3"], grain: float) -> Solid:
    """The convex body of some corners: flat faces, sharp edges, triangles no longer than `grain`."""
    solid, parts = ConvexHull(corners), []
    for simplex, plane in zip(solid.simplices, solid.equations, strict=True):
        a, b, c = corners[simplex]
        outwards = np.cross(b - a, c - a) @ plane[:3] > 0
        parts.append(_split(np.stack([a, b, c] if outwards else [a, c, b]), grain))
    corner = np.concatenate(parts)
    points, faces = weld(corner.reshape(-1, 3), np.arange(3 * len(corner)).reshape(-1, 3))
    return with_normals(points, faces, crease_deg=1.0)


def _split(triangle: Float[np.ndarray, "3 3"], grain: float) -> Float[np.ndarray, "f 3 3"]:
    """A triangle cut into like ones whose edges are no longer than `grain`."""
    a, b, c = triangle
    k = int(np.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - b), np.linalg.norm(a - c)) / grain))
    i, j = (x.ravel() for x in np.meshgrid(np.arange(k), np.arange(k), indexing="ij"))

    def at(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return a + i[:, None] / k * (b - a) + j[:, None] / k * (c - a)

    up, down = i + j < k, i + j < k - 1
    upright = np.stack([at(i, j), at(i + 1, j), at(i, j + 1)], 1)[up]
    turned = np.stack([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], 1)[down]
    return np.concatenate([upright, turned])


def slab(outline: Float[np.ndarray, "k 2"], thickness: float, rings: int) -> Solid:
    """A thin plate over a star-shaped outline in x, y; sharp rim."""
    t = np.linspace(0, 1, rings + 1)[1:]
    k = len(outline)
    flat = np.concatenate([[[0.0, 0.0]], (t[:, None, None] * outline).reshape(-1, 2)])
    index = 1 + np.arange(rings * k).reshape(rings, k)
    index = np.concatenate([index, index[:, :1]], 1)
    fan = np.stack([np.zeros(k, int), index[0, :-1], index[0, 1:]], 1)
    sheet = np.concatenate([fan, _faces_of(index)])
    up = np.concatenate([flat, np.full((len(flat), 1), thickness / 2)], 1)
    n = len(flat)
    rim = np.stack([index[-1], index[-1] + n])
    faces = np.concatenate([sheet, sheet[:, ::-1] + n, _faces_of(rim)])
    return with_normals(np.concatenate([up, up * [1, 1, -1]]), faces, crease_deg=40.0)


def _grid_faces(rows: int, columns: int) -> Int[np.ndarray, "f 3"]:
    return _faces_of(np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1))


def _faces_of(index: Int[np.ndarray, "r c"]) -> Int[np.ndarray, "f 3"]:
    """Two triangles per cell of a grid of vertex numbers; (row edge) x (column edge) points outwards."""
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def weld(
    points: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    """Merge vertices that coincide (to 1e-7 of the size) and drop triangles that vanish."""
    grain = 1e-7 * np.ptp(points, axis=0).max()
    _, first, same = np.unique(
        np.round(points / grain).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    faces = same.reshape(-1)[faces]
    degenerate = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    return points[first], faces[~degenerate]


def with_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], crease_deg: float | None
) -> Solid:
    """Average the normals of the faces round each vertex; across creases they stay apart, at split vertices."""
    corners = vertices[faces]
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if crease_deg is None:
        total = np.zeros_like(vertices)
        for k in range(3):
            np.add.at(total, faces[:, k], weighted)
        return Solid(vertices, _unit(total), faces)
    unit = _unit(weighted)
    count = len(faces)
    # Face-to-face incidence by shared vertex, one block of rows per corner.
    at = sparse.csr_matrix((np.ones(3 * count), (np.repeat(np.arange(count), 3), faces.reshape(-1))))
    touching = at.T.tocsr()
    normals = np.empty((count, 3, 3))
    for k in range(3):
        rows = touching[faces[:, k]]
        row = np.repeat(np.arange(count), np.diff(rows.indptr))
        near = (unit[row] * unit[rows.indices]).sum(1) > np.cos(np.radians(crease_deg))
        for axis in range(3):
            normals[:, k, axis] = np.bincount(row[near], weighted[rows.indices[near], axis], minlength=count)
    # Corners of one vertex that agree on the normal share one vertex again.
    flat = _unit(normals.reshape(-1, 3))
    code = (np.round(flat * 2000).astype(np.int64) + 2001) @ np.array([1, 4003, 4003**2])
    _, first, same = np.unique(
        faces.reshape(-1) * np.int64(4003**3) + code, return_index=True, return_inverse=True
    )
    return Solid(corners.reshape(-1, 3)[first], flat[first], same.reshape(-1, 3))


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
