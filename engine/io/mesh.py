"""A triangle mesh from a depth map, cut where the surface is not one piece.

One vertex a pixel, at the pixel's centre but for borders, which run through the stairs that the pixels make of them;
camera frame, the depth's unit; triangles run counter-clockwise as the camera sees them. Two neighbours are joined when
at least one of their normals explains the step in depth between them; a step that neither explains is an edge in front
of something further away.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.errors import ExportError
from engine.geometry import project, unproject
from engine.types import Camera, Surface

PASS_DOWN, PASS_UP = 0.5, -0.513
"""Steps of the smoothing of borders: what is shorter than some 20 pixels along a border goes, what is longer stays."""
SMOOTHINGS = 50
MOST_ASIDE_PX = 0.7
LEAST_LEFT = 0.2
"""Share of a triangle's area in the picture that smoothing leaves."""


@dataclass(frozen=True, slots=True)
class CutParams:
    """When neighbouring pixels are left unjoined: both limits must be passed."""

    step_footprints: float = 3.0  # unexplained step in depth, in widths of a pixel on the surface
    step_share: float = 1.0  # unexplained step, as a share of the step that the normal predicts


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Vertices that some triangle uses, with the pixel (row, column) each came from and where in the picture it is."""

    points: Float[np.ndarray, "v 3"]  # camera frame
    triangles: Int[np.ndarray, "t 3"]
    pixels: Int[np.ndarray, "v 2"]
    image: Float[np.ndarray, "v 2"]  # x, y; the centre of the first pixel is (0.5, 0.5)


def from_depth(surface: Surface, camera: Camera, params: CutParams) -> Mesh:
    """The mesh of a surface's depth map.

    Raises:
        ExportError: the camera has another size, or no three neighbouring pixels are joined.
    """
    height, width = surface.mask.shape
    if (camera.width, camera.height) != (width, height):
        raise ExportError(
            f"the surface is {width} x {height} pixels but the camera {camera.width} x {camera.height};"
            " run the poses and the surface on the same photographs"
        )
    depth = surface.depth.astype(np.float64)
    valid = surface.mask & np.isfinite(depth) & (depth > 0)
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    plane = unproject(camera, np.stack([u, v], axis=-1))
    rays = np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)
    footprint = depth / ((camera.fx + camera.fy) / 2)
    normal = surface.normal.astype(np.float64)

    def joined(a: tuple[slice, slice], b: tuple[slice, slice]) -> Bool[np.ndarray, "r c"]:
        return valid[a] & valid[b] & _explained(
            depth[a], depth[b], rays[a], rays[b], normal[a], normal[b], footprint[a], params
        )  # fmt: skip

    top, low, left, right, every = (
        slice(None, -1),
        slice(1, None),
        slice(None, -1),
        slice(1, None),
        slice(None),
    )
    across, down = joined((every, left), (every, right)), joined((top, every), (low, every))
    falling, rising = joined((top, left), (low, right)), joined((top, right), (low, left))
    # Each quad's corners: a b above d e. It is split along a-e or b-d: what joins more, then what is flatter.
    ab, de, ad, be = across[:-1], across[1:], down[:, :-1], down[:, 1:]
    by_falling = [falling & ad & de, falling & ab & be]  # a d e, a e b
    by_rising = [rising & ab & ad, rising & de & be]  # a d b, b d e
    more = np.sum(by_falling, axis=0) - np.sum(by_rising, axis=0)
    flatter = np.abs(depth[:-1, :-1] - depth[1:, 1:]) < np.abs(depth[:-1, 1:] - depth[1:, :-1])
    use_falling = (more > 0) | ((more == 0) & flatter)

    index = np.arange(height * width).reshape(height, width)
    a, b, d, e = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    parts = [
        (use_falling & by_falling[0], (a, d, e)),
        (use_falling & by_falling[1], (a, e, b)),
        (~use_falling & by_rising[0], (a, d, b)),
        (~use_falling & by_rising[1], (b, d, e)),
    ]
    triangles = np.concatenate([np.stack([c[chosen] for c in corners], -1) for chosen, corners in parts])
    if len(triangles) == 0:
        raise ExportError("the depth map joins no three neighbouring pixels; there is no surface to write")
    used, renumbered = np.unique(triangles, return_inverse=True)
    row, column = np.divmod(used, width)
    points, joins = (rays * depth[..., None])[row, column], renumbered.reshape(-1, 3)
    inside = (row > 0) & (row < height - 1) & (column > 0) & (column < width - 1)
    points = _smooth_borders(points, joins, inside, camera)
    return Mesh(points, joins, np.stack([row, column], axis=-1), project(camera, points))


def _smooth_borders(
    points: Float[np.ndarray, "v 3"],
    triangles: Int[np.ndarray, "t 3"],
    inside: Bool[np.ndarray, " v"],
    camera: Camera,
) -> Float[np.ndarray, "v 3"]:
    """The points with those on a border moved along smooth curves, each by less than a pixel, so that no triangle turns over.

    Taubin, "Curve and surface smoothing without shrinkage" (1995). What is not `inside` lies on the photograph's own edge, and
    stays, as vertices do where two borders meet.
    """
    begin, end = (triangles[:, k].ravel() for k in ([0, 1, 2], [1, 2, 0]))
    count = len(points)
    border = ~np.isin(begin * count + end, end * count + begin)  # no triangle runs along it the other way
    begin, end = begin[border], end[border]
    free = inside & (np.bincount(begin, minlength=count) == 1) & (np.bincount(end, minlength=count) == 1)
    last, following = np.arange(count), np.arange(count)
    last[end], following[begin] = begin, end
    last, following = last[free], following[free]
    moved = points.copy()
    for step in (PASS_DOWN, PASS_UP) * SMOOTHINGS:
        moved[free] += step * ((moved[last] + moved[following]) / 2 - moved[free])
    image = project(camera, points)
    aside = np.linalg.norm(project(camera, moved) - image, axis=-1)
    by = (moved - points) * np.minimum(1, MOST_ASIDE_PX / np.maximum(aside, 1e-9))[:, None]
    area = _areas(image, triangles)
    while (crushed := _areas(project(camera, points + by), triangles) / area < LEAST_LEFT).any():
        by[triangles[crushed]] /= 2
    return points + by


def _areas(image: Float[np.ndarray, "v 2"], triangles: Int[np.ndarray, "t 3"]) -> Float[np.ndarray, " t"]:
    """Twice the area of triangles in the picture, with its sign."""
    a, b, c = (image[triangles[:, k]] for k in range(3))
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    return x1 * y2 - x2 * y1


def vertex_normals(mesh: Mesh) -> Float[np.ndarray, "v 3"]:
    """Unit normals of the mesh itself, the mean of the triangles around a vertex by area."""
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    return _unit(_gather(mesh, np.cross(b - a, c - a)))


def along_columns(mesh: Mesh) -> Float[np.ndarray, "v 3"]:
    """How a vertex moves as its image column grows: the mesh's derivative by x, by area, not normalised."""
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    pa, pb, pc = (mesh.image[mesh.triangles[:, k]] for k in range(3))
    (c1, r1), (c2, r2) = (pb - pa).T, (pc - pa).T
    slope = ((b - a) * r2[:, None] - (c - a) * r1[:, None]) / (c1 * r2 - c2 * r1)[:, None]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=-1, keepdims=True)
    return _gather(mesh, slope * area)


def _explained(
    z_a: np.ndarray, z_b: np.ndarray, ray_a: np.ndarray, ray_b: np.ndarray,
    normal_a: np.ndarray, normal_b: np.ndarray, footprint: np.ndarray, params: CutParams,
) -> np.ndarray:  # fmt: skip
    """Whether the tangent plane at one of two pixels meets the other's ray near its depth."""
    found = np.zeros(z_a.shape, bool)
    for z, other, ray, other_ray, normal in (
        (z_a, z_b, ray_a, ray_b, normal_a),
        (z_b, z_a, ray_b, ray_a, normal_b),
    ):
        there = (normal * other_ray).sum(-1)
        here = (normal * ray).sum(-1)
        facing = there < -1e-6  # a plane seen from behind or edge-on predicts nothing
        predicted = z * here / np.where(facing, there, 1.0) - z
        rest = np.abs(other - z - predicted)
        near = rest <= np.maximum(params.step_footprints * footprint, params.step_share * np.abs(predicted))
        found |= np.where(facing, near, np.abs(other - z) <= params.step_footprints * footprint)
    return found


def _gather(mesh: Mesh, per_triangle: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "v 3"]:
    total = np.zeros_like(mesh.points)
    for corner in range(3):
        np.add.at(total, mesh.triangles[:, corner], per_triangle)
    return total


def _unit(vectors: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
