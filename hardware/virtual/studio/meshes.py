"""Read a mesh file as a body: any OBJ, PLY or GLB, brought upright before the camera at the size that was asked for.

Files are taken to be y up with their front along +z, as glTF has it; `turn_deg` turns them about the vertical, to the right.
Normals are the file's where it has them, else means over the faces around a corner that meet at less than `CREASE_DEG`;
they are what reflects, and what the truth's maps hold. Camera frame, metres.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hardware.errors import StudioError
from hardware.virtual.studio import solids
from hardware.virtual.studio.objects import DISTANCE_M
from hardware.virtual.studio.order import MESH_KINDS
from hardware.virtual.studio.solids import Solid

USUAL_M = 0.25  # largest extent of the built-in objects, for which the rig was built
SMALLEST_M, LARGEST_M = 0.01, 10.0
MOST_FACES = 2_000_000  # more are thinned out to about a grid of GRID cells
GRID = 1200
FINEST = 160  # edges are divided until they are this part of the size, so that paint has somewhere to lie
DIVIDED_FACES = 600_000  # but not beyond this many
CREASE_DEG = 45.0
ONE_PLACE = 1e-6  # of the size: corners so close are one where borders are looked for


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """What a file holds, still in its own frame and units; looks are None where it has none."""

    name: str
    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    albedo: Float[np.ndarray, "v 3"] | None
    roughness: Float[np.ndarray, " v"] | None
    metalness: Float[np.ndarray, " v"] | None
    notes: tuple[str, ...]

    def looks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Albedo, roughness and metalness.

        Raises:
            StudioError: it was read without.
        """
        if self.albedo is None or self.roughness is None or self.metalness is None:
            raise StudioError(f"{self.name}: was read without what it is made of; read it with its looks")
        return self.albedo, self.roughness, self.metalness


def read(path: Path, with_looks: bool) -> Mesh:
    """The mesh in a file, whole and turned right side out; with its base colour, roughness and metalness if asked for.

    Raises:
        StudioError: no such file, a kind that is not read, damage, no faces, no numbers, or no looks where asked for.
    """
    if path.suffix.lower() not in MESH_KINDS:
        raise StudioError(f"{path}: meshes are read from {', '.join(MESH_KINDS)}; convert it")
    if not path.is_file():
        raise StudioError(f"{path}: there is no such mesh; give a file or the name of an object")
    parts = _loaded(path)
    if not parts:
        raise StudioError(f"{path}: holds no faces; export it as a mesh of triangles")
    looks: list[Any] = [None] * len(parts)
    if with_looks:
        from hardware.virtual.studio import mesh_looks

        looks = mesh_looks.of(path, parts)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    vertices = np.concatenate([np.asarray(part.vertices, float) for part in parts])
    faces = np.concatenate([np.asarray(p.faces) + s for p, s in zip(parts, starts[:-1], strict=True)])
    bad = int((~np.isfinite(vertices)).any(1).sum())
    if bad:
        raise StudioError(f"{path}: {bad} of {len(vertices)} vertices are not numbers; repair the mesh")
    extent = float(np.ptp(vertices[faces], axis=(0, 1)).max())
    if not extent > 0 or not _has_area(vertices[faces] / extent).any():
        raise StudioError(f"{path}: none of its faces has an area; export it again")
    given = [_normals_of(part) for part in parts]
    known = None if any(n is None for n in given) else np.concatenate(given)  # type: ignore[arg-type]
    values = {
        name: np.concatenate([getattr(look, name) for look in looks]) if with_looks else None
        for name in ("albedo", "roughness", "metalness")
    }
    mesh = Mesh(path.stem, vertices, np.zeros_like(vertices), faces, **values, notes=())
    mesh, known = _thinned(mesh, known, extent)
    if borders := _borders(mesh, extent):
        note = f"is open: {borders} boundary edges; faces seen from behind are black"
        mesh = replace(mesh, notes=(*mesh.notes, note))
    return _finished(_right_side_out(mesh, known, extent), extent)


def stand(mesh: Mesh, size_m: float, turn_deg: float) -> tuple[Mesh, float]:
    """The mesh before the camera, and how many times as large as a built-in object it is.

    Raises:
        StudioError: a size that no rig carries.
    """
    scale = checked(size_m) / USUAL_M
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turn = np.diag([1.0, -1.0, -1.0]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    used = mesh.vertices[np.unique(mesh.faces)]
    extent = float(np.ptp(used, axis=0).max())
    vertices = mesh.vertices @ turn.T * (size_m / extent)
    used = vertices[np.unique(mesh.faces)]
    middle = (used.min(0) + used.max(0)) / 2
    vertices = vertices - middle + [0, 0, DISTANCE_M * scale]
    return replace(mesh, vertices=vertices, normals=mesh.normals @ turn.T), scale


def checked(size_m: float) -> float:
    """
    Raises:
        StudioError: a size that no rig carries.
    """
    if not SMALLEST_M <= size_m <= LARGEST_M:
        raise StudioError(
            f"--object-size {size_m:g}: an object is {SMALLEST_M:g} to {LARGEST_M:g} metres across; give its largest extent"
        )
    return size_m


def digest(mesh: Mesh) -> str:
    """Names the mesh's content."""
    sha = hashlib.sha256(mesh.name.encode())
    for part in (mesh.vertices, mesh.normals, mesh.faces, mesh.albedo, mesh.roughness, mesh.metalness):
        if part is not None:
            sha.update(np.ascontiguousarray(part, np.float32).tobytes())
    return sha.hexdigest()[:12]


def _loaded(path: Path) -> list[Any]:
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        parts = scene.dump(concatenate=False)
    except Exception as fault:  # trimesh raises what its parsers raise
        said = " ".join(str(fault).split())[:200]
        raise StudioError(f"{path}: cannot be read as a mesh ({said}); export it again") from fault
    parts = [part for part in parts if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    for part in parts:
        faces, count = np.asarray(part.faces), len(part.vertices)
        if (
            faces.ndim != 2
            or np.shape(part.vertices) != (count, 3)
            or faces.min() < 0
            or faces.max() >= count
        ):
            raise StudioError(
                f"{path}: damaged, its faces name vertices that it does not hold; export it again"
            )
    return parts


def _normals_of(part: Any) -> Float[np.ndarray, "v 3"] | None:
    """Those that the file gave; trimesh keeps them where it would keep its own."""
    if "vertex_normals" not in part._cache.cache:
        return None
    normals = np.asarray(part.vertex_normals, float)
    good = np.isfinite(normals).all() and (np.linalg.norm(normals, axis=1) > 0.5).all()
    return normals if good else None


def _thinned(mesh: Mesh, known: np.ndarray | None, extent: float) -> tuple[Mesh, np.ndarray | None]:
    """Vertices of one grid cell made one where there are too many faces."""
    if len(mesh.faces) <= MOST_FACES:
        return mesh, known
    cell = np.floor((mesh.vertices - mesh.vertices.min(0)) / (extent / GRID)).astype(np.int64)
    _, first, to = np.unique(cell @ [1, 4096, 4096**2], return_index=True, return_inverse=True)
    faces = to[mesh.faces]
    faces = faces[(faces != np.roll(faces, 1, 1)).all(1)]
    _, once = np.unique(np.sort(faces, 1), axis=0, return_index=True)
    faces = faces[np.sort(once)]
    count = np.bincount(to)[:, None]
    vertices = np.stack([np.bincount(to, mesh.vertices[:, k]) for k in range(3)], 1) / count
    note = f"{len(mesh.faces)} triangles, thinned out to {len(faces)}: what lies closer than 1/{GRID} of the size is one"

    def some(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[first]

    thin = Mesh(
        mesh.name, vertices, mesh.normals[first], faces, some(mesh.albedo), some(mesh.roughness),
        some(mesh.metalness), (*mesh.notes, note),
    )  # fmt: skip
    return thin, None  # the file's normals were those of other corners


def _borders(mesh: Mesh, extent: float) -> int:
    """How many edges have a face on one side alone; corners at one place are one, though a file holds it for each face."""
    place = np.rint(mesh.vertices[mesh.faces] / (extent * ONE_PLACE)).astype(np.int64)
    place -= place.min((0, 1))
    _, corner = np.unique(place @ [1, 1 << 21, 1 << 42], return_inverse=True)
    corner = corner.reshape(-1, 3)
    ends = np.sort(np.stack([corner, np.roll(corner, -1, 1)], -1), -1).reshape(-1, 2)
    ends = ends[ends[:, 0] < ends[:, 1]]
    _, faces = np.unique(ends @ [corner.max() + 1, 1], return_counts=True)
    return int((faces == 1).sum())


def _has_area(corners: Float[np.ndarray, "f 3 3"]) -> Bool[np.ndarray, " f"]:
    """Of faces in units of the mesh's extent."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(np.linalg.norm(across, axis=1) > 1e-14)


def _right_side_out(mesh: Mesh, known: np.ndarray | None, extent: float) -> Mesh:
    """Fronts outside: a mesh whose faces enclose less than nothing is turned over. With normals."""
    corners = (mesh.vertices - mesh.vertices[mesh.faces].mean((0, 1)))[mesh.faces] / extent
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    mesh = replace(mesh, faces=mesh.faces[_has_area(corners)])
    volume = float((corners[:, 0] * across).sum() / 6)
    if volume < -1e-9:
        note = "turned inside out: it is turned back"
        mesh = replace(mesh, faces=mesh.faces[:, ::-1], notes=(*mesh.notes, note))
    if known is None:
        return _with_creases(mesh)
    corners = mesh.vertices[mesh.faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agree = (flat[:, None] * known[mesh.faces]).sum(-1)
    return replace(mesh, normals=-known if (agree < 0).mean() > 0.5 else known)


def _with_creases(mesh: Mesh) -> Mesh:
    """Normals for a mesh without; a vertex for each corner where it has looks, which may differ along a seam."""
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    places = np.zeros((same.max() + 1, 3))
    places[same.reshape(-1)] = mesh.vertices
    creased = solids.with_normals(places, same.reshape(-1)[mesh.faces], CREASE_DEG)
    if mesh.albedo is None or mesh.roughness is None or mesh.metalness is None:
        return replace(mesh, vertices=creased.vertices, normals=creased.normals, faces=creased.faces)
    every, old = creased.faces.reshape(-1), mesh.faces.reshape(-1)
    return replace(
        mesh, vertices=creased.vertices[every], normals=creased.normals[every],
        faces=np.arange(len(every)).reshape(-1, 3), albedo=mesh.albedo[old], roughness=mesh.roughness[old],
        metalness=mesh.metalness[old],
    )  # fmt: skip


def _finished(mesh: Mesh, extent: float) -> Mesh:
    """Edges divided until paint has somewhere to lie."""
    import trimesh

    names = [
        name for name in ("normals", "albedo", "roughness", "metalness") if getattr(mesh, name) is not None
    ]
    subdivide: Any = trimesh.remesh.subdivide
    vertices, faces = mesh.vertices, mesh.faces
    values: dict[str, Any] = {name: getattr(mesh, name) for name in names}
    while len(faces) * 4 <= DIVIDED_FACES:
        edges = vertices[faces]
        longest = np.linalg.norm(edges - np.roll(edges, 1, 1), axis=2).max(1)
        if np.percentile(longest, 80) <= extent / FINEST:
            break
        vertices, faces, values = subdivide(vertices, faces, vertex_attributes=values)
    values["normals"] = values["normals"] / np.linalg.norm(values["normals"], axis=1, keepdims=True)
    return replace(mesh, vertices=vertices, faces=faces, **values)


def solid(mesh: Mesh) -> Solid:
    """Its geometry alone."""
    return solids.Solid(mesh.vertices, mesh.normals, mesh.faces)
