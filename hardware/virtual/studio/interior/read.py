"""Read any Mitsuba 3 scene as a room: one mesh of diffuse surfaces that may glow, and what lies behind its windows.

What a surface sends cannot depend on where it is seen from, or the light could not be baked: every reflectance becomes a
diffuse one of the same mean albedo (what it reflects of evenly arriving light), texture by texture; what mostly lets
light through is left out; cut-out leaves are cut out. `Interior.notes` says what was simplified, with shares of the area.
World frame: z up, the scene's own units (metres); `world_from_scene` is a rotation by quarter turns.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from hardware.errors import StudioError
from hardware.virtual.studio import tracer
from hardware.virtual.studio.interior import looks, outside
from hardware.virtual.studio.interior.looks import Look
from hardware.virtual.studio.order import called

LARGEST, SMALLEST = 1000.0, 0.1  # of a room's extent, scene units: beyond, they are hardly metres


@dataclass(frozen=True, slots=True, eq=False)
class Interior:
    """A room out of a scene file, not baked yet."""

    name: str
    key: str  # of the content: geometry, looks and what lies outside
    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]  # shading; zero where a face has only its own
    uv: Float[np.ndarray, "v 2"]
    faces: Int[np.ndarray, "f 3"]  # anticlockwise seen from the front
    look: Int[np.ndarray, " f"]
    looks: tuple[Look, ...]
    outside: Float[np.ndarray, "h w 3"]  # radiance by direction, as `outside` has it
    eye: Float[np.ndarray, "3"] | None  # where the scene's own camera stands
    world_from_scene: Float[np.ndarray, "3 3"]
    notes: tuple[str, ...]


def read(path: Path) -> Interior:
    """The room in a scene file.

    Raises:
        StudioError: it cannot be loaded, has no surfaces or no light, its size is absurd, or it holds shapes or lamps
            that cannot be baked.
    """
    if not path.is_file():
        raise StudioError(f"{path}: there is no such scene file; give a Mitsuba 3 .xml or the name of a room")
    mi = tracer.load("cpu")
    if not tracer.is_vectorised(mi):
        raise StudioError(f"{path}: rooms from files need libLLVM 16 or newer for Mitsuba; install libllvm19")
    scene = load(mi, path)
    turn, eye = _upright(mi, scene)
    parts = _parts(mi, scene, path)
    found = looks.Found(mi)
    meshes, kept = [], []
    for part in parts:
        faces, index, part = found.look(part)
        if len(faces):
            kept.append(np.full(len(faces), index))
            meshes.append((part, faces))
    if not meshes:
        raise StudioError(f"{path}: holds no surface that can be baked; give a scene with meshes")
    starts = np.cumsum([0] + [len(part.vertices) for part, _ in meshes])
    vertices = np.concatenate([part.vertices for part, _ in meshes]) @ turn.T
    sky, balls = outside.image(mi, scene, turn, path)
    room = Interior(
        called(path), "", vertices,
        np.concatenate([part.normals for part, _ in meshes]) @ turn.T,
        np.concatenate([part.uv for part, _ in meshes]),
        np.concatenate([faces + start for (_, faces), start in zip(meshes, starts[:-1], strict=True)]),
        np.concatenate(kept), tuple(found.looks), sky, eye, turn, found.notes(),
    )  # fmt: skip
    room = outside.with_balls(room, balls)
    _check(room, path)
    return _keyed(room)


def load(mi: Any, path: Path) -> Any:
    """Mitsuba's scene; what it says where it cannot is one line.

    Raises:
        StudioError: saying what Mitsuba said.
    """
    try:
        return mi.load_file(str(path), optimize=False)
    except Exception as fault:  # Mitsuba raises RuntimeError, and what its plug-ins raise
        said = " ".join(str(fault).split())
        said = said[said.rfind("Error while loading") :] if "Error while loading" in said else said
        raise StudioError(
            f"{path}: Mitsuba cannot load this scene ({said[:400]}); put back what is missing, or repair the file"
        ) from fault


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One shape of the scene, in the scene's frame."""

    vertices: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    uv: Float[np.ndarray, "v 2"]
    faces: Int[np.ndarray, "f 3"]
    bsdf: Any
    emitter: Any


def _parts(mi: Any, scene: Any, path: Path) -> list[Part]:
    """Every shape as a mesh; what is none and has no formula here is refused by name."""
    parts = []
    for shape in scene.shapes():
        kind = str(shape).split("[")[0]
        arrays = _arrays(mi, shape, kind)
        if arrays is None:
            raise StudioError(
                f"{path}: shape {shape.id()!r} is of kind {kind}, which cannot be baked; turn it into a mesh"
            )
        vertices, normals, uv, faces = arrays
        faces = faces[_solid(vertices, faces)]
        normals, uv = np.nan_to_num(normals, posinf=0, neginf=0), np.nan_to_num(uv, posinf=0, neginf=0)
        if len(faces):
            if _reversed(mi, shape, vertices, faces):
                faces = faces[:, ::-1]
            parts.append(Part(vertices, normals, uv, faces, shape.bsdf(), shape.emitter()))
    return parts


def _arrays(mi: Any, shape: Any, kind: str) -> tuple[np.ndarray, ...] | None:
    if shape.is_mesh():
        vertices = np.array(shape.vertex_positions_buffer(), float).reshape(-1, 3)
        faces = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
        normals, uv = np.zeros_like(vertices), np.zeros((len(vertices), 2))
        if shape.has_vertex_normals():
            normals = np.array(shape.vertex_normals_buffer(), float).reshape(-1, 3)
        if shape.has_vertex_texcoords():
            uv = np.array(shape.vertex_texcoords_buffer(), float).reshape(-1, 2)
        return vertices, normals, uv, faces
    grids = {"Rectangle": (2, 2), "Disk": (2, 65), "Cylinder": (2, 65), "Sphere": (33, 65)}
    if kind not in grids:
        return None
    # A formula's surface as a grid over its own coordinates.
    rows, columns = grids[kind]
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    inside = np.clip(np.stack([u.ravel(), v.ravel()]), 1e-5, 1 - 1e-5)
    at = shape.eval_parameterization(mi.Point2f(inside.astype(np.float32)))
    vertices, normals = np.array(at.p, float).T, np.array(at.sh_frame.n, float).T
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate([
        np.stack([first, first + 1, first + columns], 1),
        np.stack([first + 1, first + columns + 1, first + columns], 1),
    ])  # fmt: skip
    edges = vertices[faces]
    faces = faces[np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1) > 0]
    flat = kind in ("Rectangle", "Disk")
    return vertices, 0 * normals if flat else normals, np.stack([u.ravel(), v.ravel()], 1), faces


def _solid(vertices: np.ndarray, faces: np.ndarray) -> Bool[np.ndarray, " f"]:
    """Faces that have an area; what is not finite has none."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-14


def _reversed(mi: Any, shape: Any, vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether Mitsuba takes the other side for the front: that decides where lamps glow."""
    edges = vertices[faces]
    across = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    largest = np.argsort(-np.linalg.norm(across, axis=1))[:32]
    normal = across[largest] / np.linalg.norm(across[largest], axis=1, keepdims=True)
    size = np.ptp(vertices, axis=0).max()
    middle = edges[largest].mean(1) + normal * size * 1e-3
    alone = mi.load_dict({"type": "scene", "shape": shape})
    ray = mi.Ray3f(mi.Point3f(middle.T.astype(np.float32)), mi.Vector3f(-normal.T.astype(np.float32)))
    at = alone.ray_intersect(ray)
    facing = (np.array(at.n).T * normal).sum(1)
    return bool((facing < -0.5).sum() > (facing > 0.5).sum())


def _upright(mi: Any, scene: Any) -> tuple[np.ndarray, np.ndarray | None]:
    """Quarter turns that bring the scene's up, as its camera has it, to z (without a camera: y); where the camera stands."""
    up, eye = np.array([0.0, 1.0, 0.0]), None
    if scene.sensors():
        pose = np.array(scene.sensors()[0].world_transform().matrix, float).reshape(-1, 4, 4)[0]
        axis = np.argmax(np.abs(pose[:3, 1]))
        up = np.eye(3)[axis] * np.sign(pose[axis, 1])
        eye = pose[:3, 3]
    across = np.eye(3)[(np.argmax(np.abs(up)) + 2) % 3]
    turn = np.stack([np.cross(across, up) * -1, across, up])
    turn = turn if np.linalg.det(turn) > 0 else np.stack([-turn[0], turn[1], turn[2]])
    return turn, None if eye is None else turn @ eye


def _check(room: Interior, path: Path) -> None:
    extent = float(np.ptp(room.vertices[room.faces], axis=(0, 1)).max())
    if not SMALLEST <= extent <= LARGEST:
        raise StudioError(
            f"{path}: this room is {extent:.3g} metres across; a scene's units are metres: scale it to between"
            f" {SMALLEST:g} and {LARGEST:g}"
        )
    glowing = np.array([look.emission.max() > 0 for look in room.looks])
    if not glowing[room.look].any() and not room.outside.max() > 0:
        raise StudioError(
            f"{path}: the scene has no emitter that gives light; add a lamp, a sky or an envmap"
        )


def _keyed(room: Interior) -> Interior:
    sha = hashlib.sha256()
    arrays: Sequence[np.ndarray] = (room.vertices, room.normals, room.uv, room.outside)
    for array in arrays:
        sha.update(np.ascontiguousarray(array, np.float32).tobytes())
    for array in (room.faces, room.look):
        sha.update(np.ascontiguousarray(array, np.int32).tobytes())
    for look in room.looks:
        sha.update(look.digest())
    return replace(room, key=sha.hexdigest()[:16])
