"""A triangle mesh from a depth map, cut where the surface is not one piece.

One vertex a pixel, at the pixel's centre; camera frame, the depth's unit; triangles run counter-clockwise
as the camera sees them. Two neighbours are joined when at least one of their normals explains the step in
depth between them; a step that neither explains is an edge in front of something further away.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.errors import ExportError
from engine.geometry import unproject
from engine.types import Camera, Surface


@dataclass(frozen=True, slots=True)
class CutParams:
    """When neighbouring pixels are left unjoined: both limits must be passed."""

    step_footprints: float = 3.0  # unexplained step in depth, in widths of a pixel on the surface
    step_share: float = 1.0  # unexplained step, as a share of the step that the normal predicts


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Vertices that some triangle uses, with the pixel (row, column) each came from."""

    points: Float[np.ndarray, "v 3"]  # camera frame
    triangles: Int[np.ndarray, "t 3"]
    pixels: Int[np.ndarray, "v 2"]


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
    return Mesh(
        points=(rays * depth[..., None])[row, column],
        triangles=renumbered.reshape(-1, 3),
        pixels=np.stack([row, column], axis=-1),
    )


def vertex_normals(mesh: Mesh) -> Float[np.ndarray, "v 3"]:
    """Unit normals of the mesh itself, the mean of the triangles around a vertex by area."""
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    return _unit(_gather(mesh, np.cross(b - a, c - a)))


def along_columns(mesh: Mesh) -> Float[np.ndarray, "v 3"]:
    """How a vertex moves as its image column grows: the mesh's derivative by x, by area, not normalised."""
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    pa, pb, pc = (mesh.pixels[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    (r1, c1), (r2, c2) = (pb - pa).T, (pc - pa).T
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
