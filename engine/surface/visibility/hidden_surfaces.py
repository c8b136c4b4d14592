"""What no pixel shows: walls between the two sides of a jump of the depth, and backs of what ends there.

The mesh of a depth map closes a jump with triangles that are seen edge-on and whose corners, which lie on the surfaces
above and below, look elsewhere. What is there hides the room and throws light, but no photograph shows how much. So it is
cut into patches, a few pixels long and some bands high, which are then lit like everything else. The object is solid
behind what the camera sees, so that a wall belongs to the nearer of the two surfaces and looks away from it. Where that
one ends before it reaches the other (`depth_mesh`), rays come in behind it and strike it from within: what they meet is its
back, cut up and lit likewise. Camera frame.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from engine.surface.visibility.depth_mesh import DepthMesh


@dataclass(frozen=True, slots=True)
class HiddenSurfacesConfig:
    """What is a wall, and how walls are cut."""

    ray_cosine: float = 0.35  # of a wall and the ray that meets it, at most: pixels would show a flatter one
    corner_deg: float = 20.0  # between a wall and its corners' normals, at least: none of them is its own
    cell_px: int = 3  # along the rim, that share a patch
    bands: int = 3  # patches from the rim to the foot, which sees less of the room
    sectors: int = 8  # around the viewing ray, by which way they look: walls back to back share no patch
    smooth_px: float = 2.5  # over which the teeth are smoothed that a wall askew has on the grid of pixels
    split: int = 4  # parts of a triangle's edge whose little triangles stand for its area
    tile_px: int = 16  # along a side of the squares whose patches are lit together


CONFIG = HiddenSurfacesConfig()


@dataclass(frozen=True, slots=True, eq=False)
class HiddenPatches:
    """The walls of a mesh, or its back, cut up."""

    of: Int[np.ndarray, "t b"]  # each triangle's patches, of a wall from rim to foot; -1: it has none
    points: Float[np.ndarray, "w 3"]  # of a wall's on the mesh
    normals: Float[np.ndarray, "w 3"]  # a wall's across the viewing ray: leaning to it, it would be seen
    albedo: Float[np.ndarray, "w 3"]  # of a wall's rim, of a back's front: geometric mean
    parts: list[Int[np.ndarray, " _"]]  # patches of one place

    def beside(self, other: "HiddenPatches") -> "HiddenPatches":
        """Its patches, and another's after them; of which triangles is not told any more."""
        parts = [*self.parts, *(part + len(self.points) for part in other.parts)]
        points, normals, albedo = (
            np.concatenate([getattr(x, name) for x in (self, other)])
            for name in ("points", "normals", "albedo")
        )
        return HiddenPatches(np.zeros((0, 1), np.int32), points, normals, albedo, parts)


def faces_of(
    vertices: Float[np.ndarray, "p 3"], triangles: Int[np.ndarray, "t 3"]
) -> tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, " t"]]:
    """Unit normals of the triangles, on the side from which their corners go round as the grid's do seen from the camera,
    and areas."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    length = np.linalg.norm(across, axis=1)
    return across / np.maximum(length, 1e-30)[:, None], length / 2


def standing(
    mesh: DepthMesh,
    faces: Float[np.ndarray, "t 3"],
    normals: Float[np.ndarray, "p 3"],
) -> Bool[np.ndarray, " t"]:
    """Which triangles are walls that no pixel shows; `normals` are those of the pixels."""
    middle = mesh.vertices[mesh.triangles].mean(1)
    ahead = -(faces * middle).sum(1) / np.linalg.norm(middle, axis=1)
    alike = np.einsum("ti,tki->tk", faces, normals[mesh.pixels]).max(1)
    return (ahead < CONFIG.ray_cosine) & (alike < np.cos(np.radians(CONFIG.corner_deg)))


def patches(
    mesh: DepthMesh,
    normals: Float[np.ndarray, "p 3"],
    albedo: Float[np.ndarray, "p 3"],
    mask: Bool[np.ndarray, "h w"],
) -> HiddenPatches:
    """The walls of a depth map's mesh; normals and albedo are those of the mask's pixels."""
    faces, areas = faces_of(mesh.vertices, mesh.triangles)
    bands = CONFIG.bands
    walls = np.nonzero(standing(mesh, faces, normals))[0]
    of = np.full((len(mesh.triangles), bands), -1, np.int32)
    if not len(walls):
        return none_of(len(of))
    corners, whose = mesh.vertices[mesh.triangles[walls]], mesh.pixels[walls]
    pixel = _places(mask)[whose].mean(1)
    away = _smoothed(pixel, faces[walls], areas[walls])
    ray = corners.mean(1)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    away -= ray * (away * ray).sum(1, keepdims=True)
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-30)
    sector = (np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) + 0.5) * CONFIG.sectors
    sector = sector.astype(int) % CONFIG.sectors
    tile, cell = ((pixel // side) @ [mask.shape[1] + 1, 1] for side in (CONFIG.tile_px, CONFIG.cell_px))
    band = np.arange(bands)
    key = np.stack(
        np.broadcast_arrays(tile[:, None], cell[:, None], sector[:, None], band[None]), -1
    ).reshape(-1, 4)
    found, member = np.unique(key, axis=0, return_inverse=True)
    of[walls] = member.reshape(-1, bands)
    count = len(found)
    # Every patch stands where one of its triangles has a point: a mean of points may lie within the solid.
    at = _shares(CONFIG.split)
    points = np.einsum("sk,tki->tsi", at, corners)
    within = _band(points[..., 2], corners[..., 2], bands)
    owner = np.take_along_axis(of[walls], within, 1).ravel()
    weight, flat = np.repeat(areas[walls], len(at)), points.reshape(-1, 3)
    middle = _means(owner, flat, weight, count)
    off = np.linalg.norm(flat - middle[owner], axis=1)
    # Of two that are as near it is the first, however they are rounded.
    order = np.lexsort(((off / off.max()).round(6), owner))
    first = order[np.searchsorted(owner[order], np.arange(count))]
    rim = whose[np.arange(len(walls)), corners[..., 2].argmin(1)]
    every, size = of[walls].ravel(), np.repeat(areas[walls], bands)
    look = _means(every, np.repeat(away, bands, 0), size, count)
    look /= np.maximum(np.linalg.norm(look, axis=1, keepdims=True), 1e-30)
    paint = np.exp(_means(every, np.repeat(np.log(albedo[rim]), bands, 0), size, count))
    parts = np.split(np.arange(count), np.nonzero(np.diff(found[:, 0]))[0] + 1)
    return HiddenPatches(of, flat[first], look, paint, parts)


def behind(
    mesh: DepthMesh,
    struck: Int[np.ndarray, " k"],
    normals: Float[np.ndarray, "p 3"],
    albedo: Float[np.ndarray, "p 3"],
    mask: Bool[np.ndarray, "h w"],
) -> HiddenPatches:
    """What lies behind the triangles that rays have `struck` from behind, where the front is known to end: its mirror image, as
    deep as it is wide, of the same paint."""
    unseen = none_of(len(mesh.triangles))
    if not len(struck) or not mesh.deep.any():
        return unseen
    of, whose = unseen.of, mesh.pixels[struck]
    cell = _places(mask)[whose[:, 0]] // CONFIG.cell_px
    found, first, member = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    of[struck, 0], count, alike = member, len(found), np.ones(len(struck))
    front = _means(member, mesh.vertices[mesh.triangles[struck]].mean(1), alike, count)
    facing = _means(member, normals[whose].mean(1), alike, count)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-30)
    paint = np.exp(_means(member, np.log(albedo[whose]).mean(1), alike, count))
    ray = front / np.linalg.norm(front, axis=1, keepdims=True)
    ahead = (facing * ray).sum(1, keepdims=True)
    deep = 2 * mesh.deep[whose[first]].mean(1, keepdims=True)
    _, tile = np.unique(found * CONFIG.cell_px // CONFIG.tile_px, axis=0, return_inverse=True)
    order = np.argsort(tile, kind="stable")
    parts = np.split(order, np.nonzero(np.diff(tile[order]))[0] + 1)
    return HiddenPatches(of, front - ray * ahead * deep, facing - 2 * ahead * ray, paint, parts)


def _places(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "p 2"]:
    """Row and column of the mask's pixels from its own corner, so that more picture around it cuts nothing elsewhere."""
    at = np.stack(np.nonzero(mask), 1)
    return at - at.min(0)


def none_of(triangles: int) -> HiddenPatches:
    """No patches of so many triangles."""
    nowhere = np.zeros((0, 3))
    return HiddenPatches(np.full((triangles, 1), -1, np.int32), nowhere, nowhere, nowhere, [])


def _smoothed(
    pixel: Float[np.ndarray, "k 2"], faces: Float[np.ndarray, "k 3"], areas: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "k 3"]:
    """Mean normal of the walls around each that look about the same way, not of unit length."""
    pairs = KDTree(pixel).query_pairs(CONFIG.smooth_px, output_type="ndarray")
    one, other = pairs[(faces[pairs[:, 0]] * faces[pairs[:, 1]]).sum(1) > 0].T
    whole = faces * areas[:, None]
    total = whole.copy()
    np.add.at(total, one, whole[other])
    np.add.at(total, other, whole[one])
    return total


def _shares(split: int) -> Float[np.ndarray, "s 3"]:
    """What the corners of a triangle contribute to the middles of `split`^2 equal parts of it."""
    up = [(i + 1 / 3, j + 1 / 3) for i in range(split) for j in range(split - i)]
    down = [(i + 2 / 3, j + 2 / 3) for i in range(split - 1) for j in range(split - 1 - i)]
    two = np.array(up + down) / split
    return np.column_stack([1 - two.sum(1), two])


def _band(
    z: Float[np.ndarray, "t s"], corners: Float[np.ndarray, "t 3"], bands: int
) -> Int[np.ndarray, "t s"]:
    """Which band of its triangle a point belongs to; the nearest is 0. Many lie between two, however they are rounded."""
    low, high = corners.min(1)[:, None], corners.max(1)[:, None]
    deep = np.round((z - low) / np.maximum(high - low, 1e-30) * bands, 5)
    return np.clip(deep, 0, bands - 1).astype(int)


def _means(
    of: Int[np.ndarray, " k"], values: Float[np.ndarray, "k 3"], weight: Float[np.ndarray, " k"], count: int
) -> Float[np.ndarray, "w 3"]:
    """Weighted means of what belongs to each of `count`."""
    total = np.bincount(of, weight, count)
    sums = np.stack([np.bincount(of, weight * x, count) for x in values.T], 1)
    return sums / np.maximum(total, 1e-30)[:, None]
