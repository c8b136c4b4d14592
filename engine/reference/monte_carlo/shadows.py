"""Which samples the object hides from the room: V of the paper, by rays against the mesh of the depth map.

Source: the paper, Sec. 3.3, "Emitter query and visibility"; rays are Embree's (Open3D). Camera frame. Made anew each
epoch from the depth as it stands.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.surface.visibility.depth_mesh import halves
from engine.surface.visibility.ray_visibility import footprint_of

TEAR = 0.3
"""Relative step in z between neighbours beyond which the surface is taken to be torn."""


@dataclass(frozen=True, slots=True, eq=False)
class Shadows:
    """The mesh ready for rays, and where those of the `p` pixels solved begin."""

    mesh: Any  # open3d RaycastingScene
    origins: Float[np.ndarray, "p 3"]  # float32

    def clear(
        self,
        pixels: slice,
        directions: Float[np.ndarray, "b p s 3"],
        wanted: Bool[np.ndarray, "b p s"],
    ) -> Bool[np.ndarray, "b p s"]:
        """Of the wanted directions those in which nothing of the object stands."""
        import open3d as o3d

        begin = np.broadcast_to(self.origins[pixels][:, None], directions.shape)[wanted]
        cast = np.concatenate([begin, directions[wanted].astype(np.float32)], 1)
        clear = wanted.copy()
        clear[wanted] = ~self.mesh.test_occlusions(o3d.core.Tensor.from_numpy(cast)).numpy()
        return clear


def shadows_of(
    points: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    solved: Bool[np.ndarray, "h w"],
    normals: Float[np.ndarray, "p 3"],
) -> Shadows:
    """The mesh over the mask's points; rays begin at the pixels solved, whose normals are `normals`.

    Origins are lifted by half a pixel's footprint along the normal and towards the camera, as our own solver's once were.
    """
    import open3d as o3d

    vertices, triangles = mesh_of(points, mask)
    mesh = o3d.t.geometry.RaycastingScene()
    mesh.add_triangles(
        o3d.core.Tensor.from_numpy(vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(triangles.astype(np.uint32)),
    )
    here = points[solved]
    lift = 0.5 * footprint_of(points, mask)[solved[mask]][:, None]
    towards_camera = -here / np.linalg.norm(here, axis=1, keepdims=True)
    return Shadows(mesh, (here + lift * (normals + towards_camera)).astype(np.float32))


def mesh_of(
    points: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "p 3"], Int[np.ndarray, "t 3"]]:
    """Vertices (mask order) and triangles of a depth map."""
    triangles = halves(mask)
    corner = points[mask][triangles][..., 2]
    return points[mask], triangles[np.ptp(corner, axis=1) <= TEAR * corner.min(1)]
