"""Choose what is photographed: a built-in object or a mesh file, at a size, turned, of a material."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hardware.errors import StudioError
from hardware.virtual.studio import materials, meshes, objects, solids
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.order import MESH_SIZE_M


@dataclass(frozen=True, slots=True)
class Thing:
    """What to photograph; None: as a built-in object has it, else `MESH_SIZE_M` and paint."""

    name: str  # of a built-in object, or a mesh file
    size_m: float | None = None
    material: str | None = None
    turn_deg: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Stood:
    """A body before the camera, how many times as large as built-in ones the rig for it is, and what was done to it."""

    body: Body
    scale: float
    notes: tuple[str, ...] = ()


def stand(thing: Thing, seed: int) -> Stood:
    """
    Raises:
        StudioError: no such object, file or material, damage, or a size or turn that no rig carries.
    """
    if not np.isfinite(thing.turn_deg):
        raise StudioError(f"--turn {thing.turn_deg}: give degrees, as in 90")
    if thing.material is not None:
        materials.check(thing.material)
    if is_file(thing.name):
        material = thing.material or "paint"
        mesh = meshes.read(Path(thing.name), material == materials.FROM_FILE)
        size = MESH_SIZE_M if thing.size_m is None else thing.size_m
        mesh, scale = meshes.stand(mesh, size, thing.turn_deg)
        notes = tuple(f"{thing.name}: {note}" for note in mesh.notes)
        return Stood(materials.dress(mesh, material, seed, scale), scale, notes)
    body = objects.model(thing.name)
    if thing.material is None and thing.size_m is None and thing.turn_deg == 0:
        return Stood(body, 1.0)
    if thing.material == materials.FROM_FILE:
        raise StudioError(
            f"--material from-file: {thing.name} is built in; choose another material, or give a mesh file"
        )
    return _changed(body, thing, seed)


def is_file(name: str) -> bool:
    """Whether a mesh file is meant rather than a built-in object."""
    return not objects.is_built_in(name) and ("/" in name or Path(name).suffix != "")


def _changed(body: Body, thing: Thing, seed: int) -> Stood:
    """A built-in object at another size, turned about the vertical, or of another material."""
    solid = body.solid
    c, s = np.cos(np.radians(thing.turn_deg)), np.sin(np.radians(thing.turn_deg))
    turn, middle = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]), np.array([0.0, 0.0, objects.DISTANCE_M])
    solid = solids.moved(solid, turn, middle - turn @ middle)
    points = solid.vertices - middle
    extent = float(np.ptp(points, axis=0).max())
    scale = 1.0 if thing.size_m is None else meshes.checked(thing.size_m) / extent
    solid = replace(solid, vertices=solid.vertices * scale)
    material = (thing.material or "own").replace(":", "-")
    name = f"{body.name}-{material}-{scale:.4f}-{thing.turn_deg:g}"
    if thing.material is None:
        return Stood(replace(body, name=name, solid=solid), scale)
    return Stood(materials.painted(f"{name}-{seed}", solid, thing.material, points, seed), scale)
