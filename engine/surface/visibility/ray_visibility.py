"""Which directions each surface point sees, and which part of the object hides the others.

The depth map is a mesh; rays from every pixel's point towards every direction cell above its horizon are cast
once per depth update (Embree, through Open3D) and serve all views. What is kept is the list of hidden
(pixel, direction) pairs with the pixel that hides it, whose photographed radiance is the light that
comes from there instead; or with the patch of a wall that no pixel shows, whose radiance `interreflection` works out. Camera
frame.
"""

from dataclasses import dataclass, replace
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.progress import Progress
from engine.surface.data.observations import shifted_neighbours
from engine.surface.visibility.depth_mesh import DepthMesh, depth_mesh, pitch_of
from engine.surface.visibility.hidden_surfaces import behind, faces_of, none_of, patches

BACKFACE = -2
"""Source, less its number, of a triangle that was struck from behind."""


@dataclass(frozen=True, slots=True)
class RayConfig:
    """Rays are cast to below the horizon too: the solver is about to turn the normal, and a direction that then rises above the
    horizon must not come in as if nothing stood there."""

    below_sine: float = 0.5  # of how far below
    nearly_convex: float = 0.01  # mean share of the hemisphere up to which an object hides as good as nothing
    lift_px: tuple[float, float] = (0.05, 0.5)  # above the surface that rays begin: at least and at most


CONFIG = RayConfig()


@dataclass(frozen=True, slots=True, eq=False)
class HiddenSurfaces:
    """Patches of walls that no pixel shows, and what they see of the object."""

    points: Float[np.ndarray, "w 3"]
    normals: Float[np.ndarray, "w 3"]
    albedo: Float[np.ndarray, "w 3"]
    parts: list[Int[np.ndarray, " _"]]  # patches that share their light
    hidden: "SparseVisibility"  # from the patches; its sources are numbered as those of the pixels are

    def at(self, scale: float) -> "HiddenSurfaces":
        """The same with the object so many times as far away."""
        return replace(self, points=self.points * scale)


@dataclass(frozen=True, slots=True, eq=False)
class SparseVisibility:
    """Hidden directions of each pixel, as rows of a sparse matrix (pixels in mask order)."""

    start: Int[np.ndarray, " s"]  # pixel p owns entries start[p]:start[p + 1]
    direction: Int[np.ndarray, " e"]  # direction cell
    # The pixel that hides it, or after all pixels the wall's patch; -1: unknown.
    occluder: Int[np.ndarray, " e"]
    hidden_share: Float[np.ndarray, " p"]  # hidden part of the cosine-weighted hemisphere
    hidden_surfaces: HiddenSurfaces | None = None

    def part(self, pixels: Int[np.ndarray, " p"]) -> "SparseVisibility":
        """The same of a few pixels, in their order; their sources keep their numbers."""
        lengths = self.start[pixels + 1] - self.start[pixels]
        begins = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
        take = np.repeat(self.start[pixels] - begins[:-1], lengths) + np.arange(begins[-1])
        rows = begins, self.direction[take], self.occluder[take]
        return SparseVisibility(*rows, self.hidden_share[pixels], self.hidden_surfaces)

    @property
    def is_nearly_convex(self) -> bool:
        """Whether the object hides next to nothing of the room from itself."""
        return float(self.hidden_share.mean()) <= CONFIG.nearly_convex

    def at(self, scale: float) -> "SparseVisibility":
        """The same with the object so many times as far away."""
        walls = self.hidden_surfaces
        return self if walls is None else replace(self, hidden_surfaces=walls.at(scale))

    def through(self, backs: Int[np.ndarray, " t"]) -> "SparseVisibility":
        """The same when what a ray meets that strikes a triangle from behind is known."""
        struck = self.occluder <= BACKFACE
        number = np.where(struck, BACKFACE - self.occluder, 0)
        return replace(self, occluder=np.where(struck, backs[number], self.occluder))

    def upsampled(self, parent: Int[np.ndarray, " p"]) -> "SparseVisibility":
        """The same of pixels of twice the size, each seeing what its `parent` does."""
        behind = np.full(len(self.hidden_share), -1, np.int32)
        behind[parent] = np.arange(len(parent))
        return self.part(parent).told(len(behind), behind, len(parent))

    def told(self, count: int, by: Int[np.ndarray, " p"], new: int) -> "SparseVisibility":
        """The same when pixel `q` of the `count` that hide is number `by[q]` of `new`."""
        behind = np.append(by, -1)  # last comes who stands for a source that the camera does not see
        pixel = np.where(self.occluder < count, self.occluder, -1)
        source = np.where(self.occluder < count, behind[pixel], self.occluder - count + new).astype(np.int32)
        walls = self.hidden_surfaces
        if walls is not None:
            walls = replace(walls, hidden=walls.hidden.told(count, by, new))
        return replace(self, occluder=source, hidden_surfaces=walls)


def trace_occlusion(
    points: Float[np.ndarray, "h w 3"],
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    directions: Float[np.ndarray, "d 3"],
    progress: Progress,
    albedo: Float[np.ndarray, "p 3"] | None = None,
    some: Int[np.ndarray, " q"] | slice = slice(None),
) -> SparseVisibility:
    """Cast every pixel's rays at the depth mesh.

    With the pixels' `albedo` given, the walls that no pixel shows are sources of their own, and pixels are where they look;
    without, the nearest pixel stands for all that hides, whichever way it looks, and `some` pixels may be asked alone.
    """
    mesh = depth_mesh(points, mask)
    vertices = points[mask]
    flat_normals = normals[mask].astype(float)
    footprint = footprint_of(points, mask)
    cut = none_of(len(mesh.triangles)) if albedo is None else patches(mesh, flat_normals, albedo, mask)
    cast = _Mesh(mesh, None if albedo is None else flat_normals, cut.of, len(vertices))
    origins = vertices + clearance(vertices, flat_normals, footprint, mask)
    found = cast.hidden(origins[some], flat_normals[some], directions, -CONFIG.below_sine, progress)
    if albedo is None:
        return found
    struck = BACKFACE - np.unique(found.occluder[found.occluder <= BACKFACE])
    back = behind(mesh, struck, flat_normals, albedo, mask)
    backs = np.where(back.of[:, 0] >= 0, len(vertices) + len(cut.points) + back.of[:, 0], -1).astype(np.int32)
    found = found.through(backs)
    unseen = cut.beside(back)
    if not len(unseen.points):
        return found
    # A wall askew has teeth as high as half a pixel, which its smooth normals do not know.
    clear = unseen.points + unseen.normals * (footprint.mean() * unseen.points[:, 2:] / vertices[:, 2].mean())
    hidden = cast.hidden(clear, unseen.normals, directions, 0.0, progress).through(backs)
    walls = HiddenSurfaces(unseen.points, unseen.normals, unseen.albedo, unseen.parts, hidden)
    return replace(found, hidden_surfaces=walls)


def clearance(
    points: Float[np.ndarray, "p 3"],
    normals: Float[np.ndarray, "p 3"],
    footprint: Float[np.ndarray, " p"],
    mask: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "p 3"]:
    """From every pixel's point to where its rays begin: as far up as its neighbours' points rise above its own plane, for so
    far do facets and normals disagree.

    Where they agree, hardly at all: half a footprint everywhere, as once, let a twentieth of what is hidden in a flute's
    bottom shine in, and cost half a degree. Where they do not, at rims and tears, less lets facets shade their
    own corners. Towards the camera as well as along the normal: that keeps origins off back-tilted facets.
    """
    beside = shifted_neighbours(mask, np.array([(v, u) for v in (-1, 0, 1) for u in (-1, 0, 1) if v or u]))
    rise = np.zeros(len(points))
    for other in beside.T:
        above = ((points[other] - points) * normals).sum(1)
        rise = np.maximum(rise, np.where(other >= 0, above, 0))
    far = np.clip(rise, *(share * footprint for share in CONFIG.lift_px))
    towards = -points / np.linalg.norm(points, axis=1, keepdims=True)
    return (normals + towards) * far[:, None]


class _Mesh:
    """A depth map's triangles, ready to be hit."""

    def __init__(
        self,
        mesh: DepthMesh,
        normals: Float[np.ndarray, "p 3"] | None,
        walls: Int[np.ndarray, "t b"],
        pixels: int,
    ):
        import open3d as o3d

        self.scene = o3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(
            o3d.core.Tensor.from_numpy(mesh.vertices.astype(np.float32)),
            o3d.core.Tensor.from_numpy(mesh.triangles.astype(np.uint32)),
        )
        self.corners, self.depths, self.walls = mesh.pixels, mesh.vertices[mesh.triangles][..., 2], walls
        self.pixels = pixels
        self.normals = np.zeros((0, 3), np.float32) if normals is None else normals.astype(np.float32)
        self.faces = faces_of(mesh.vertices, mesh.triangles)[0].astype(np.float32)

    def hidden(
        self,
        origins: Float[np.ndarray, "q 3"],
        normals: Float[np.ndarray, "q 3"],
        directions: Float[np.ndarray, "d 3"],
        least: float,
        progress: Progress,
    ) -> SparseVisibility:
        """What stands in the way of rays from the origins whose cosine to the normal is above `least`."""
        import open3d as o3d

        chunk = max(1, 2_000_000 // len(directions))
        starts, hidden_directions, sources = [np.zeros(1, np.int64)], [], []
        share = np.zeros(len(origins), np.float32)
        directions32, origins32 = directions.astype(np.float32), origins.astype(np.float32)
        size = min(chunk, len(origins)) * len(directions)
        rays, pairs = np.empty((size, 6), np.float32), np.empty((size, 2), np.int32)
        for begin in range(0, len(origins), chunk):
            progress.step(begin / len(origins), "casting visibility rays")
            part = slice(begin, min(begin + chunk, len(origins)))
            cosine = normals[part].astype(np.float32) @ directions32.T
            count = _aim(cosine, origins32[part], directions32, np.float32(least), rays, pairs)
            answer = self.scene.cast_rays(o3d.core.Tensor.from_numpy(rays[:count]))
            lengths, cells, hiders = _struck(
                answer["t_hit"].numpy(), answer["primitive_ids"].numpy(), answer["primitive_uvs"].numpy(),
                pairs[:count], self.corners, cosine, directions32, self.depths, self.normals, self.faces, self.walls,
                self.pixels, share[part],
            )  # fmt: skip
            starts.append(starts[-1][-1:] + np.cumsum(lengths))
            hidden_directions.append(cells)
            sources.append(hiders)
        return SparseVisibility(
            np.concatenate(starts), np.concatenate(hidden_directions), np.concatenate(sources), share
        )


def footprint_of(
    points: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, " p"]:
    """Width of a pixel at the surface, scene units: z times the ideal plane's pixel pitch."""
    return points[mask][:, 2] * pitch_of(points, mask)


@numba.njit(cache=True)
@no_type_check
def _aim(cosine, origins, directions, least, rays, pairs):
    """Fill in the rays whose cosine is above `least`, and the (pixel, direction) of each; how many they are."""
    count = 0
    for p in range(cosine.shape[0]):
        for d in range(cosine.shape[1]):
            if cosine[p, d] > least:
                for k in range(3):
                    rays[count, k] = origins[p, k]
                    rays[count, 3 + k] = directions[d, k]
                pairs[count, 0], pairs[count, 1] = p, d
                count += 1
    return count


@numba.njit(cache=True)
@no_type_check
def _struck(
    far, triangle, uv, pairs, corners, cosine, directions, depths, normals, faces, walls, pixels, share
):
    """Of the rays that hit: how many each point has, their directions, the nearest corner of what they hit or the patch
    of a wall; and the share of each point's cosines that they are. A corner that looks away is not what is seen there, where `normals` tell:
    of a flank that leans out of sight the pixel at its rim or at its foot still shows some.
    """
    lengths = np.zeros(len(share), np.int64)
    cells, hiders = np.empty(len(far), np.int32), np.empty(len(far), np.int32)
    count, bands = 0, walls.shape[1]
    for i in range(len(far)):
        if not np.isfinite(far[i]):
            continue
        p, d, t = pairs[i, 0], pairs[i, 1], triangle[i]
        u, v = uv[i, 0], uv[i, 1]
        rest = 1 - (u + v)
        cells[count], hiders[count], nearest = d, -1, np.float32(-1)
        for corner in range(3):
            weight = rest if corner == 0 else (u if corner == 1 else v)
            q, facing = corners[t, corner], np.float32(1)
            if len(normals):
                facing = np.float32(0)
                for k in range(3):
                    facing -= directions[d, k] * normals[q, k]
            if facing > 0 and weight > nearest:
                hiders[count], nearest = q, weight
        ahead = np.float32(0)
        for k in range(3):
            ahead += directions[d, k] * faces[t, k]
        # From behind, from within the solid, a wall is not seen.
        if walls[t, 0] >= 0 and ahead < 0:
            low, high = min(depths[t]), max(depths[t])
            deep = (rest * depths[t, 0] + u * depths[t, 1] + v * depths[t, 2] - low) / max(high - low, 1e-30)
            band = min(max(int(deep * bands), 0), bands - 1)
            hiders[count] = pixels + walls[t, band]
        if walls[t, 0] < 0 and ahead > 0 and hiders[count] < 0:
            hiders[count] = BACKFACE - t
        lengths[p] += 1
        share[p] += max(cosine[p, d], np.float32(0))
        count += 1
    for p in range(len(share)):
        total = np.float32(0)
        for d in range(cosine.shape[1]):
            total += max(cosine[p, d], np.float32(0))
        share[p] /= total
    return lengths, cells[:count].copy(), hiders[:count].copy()
