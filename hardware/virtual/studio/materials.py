"""Dress a mesh: seeded paint, clay, glaze, metal, a fine pattern, or what its file says.

After a colon a number may be asked of any of them: "paint:roughness=0.1", "clay:specular=0" (the level; paint's is .5).
Patterns lie in space, at the scale of a built-in object whatever the size. Linear Rec.709; Disney's roughness.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from hardware.errors import StudioError
from hardware.virtual.studio import meshes, order, paint
from hardware.virtual.studio.meshes import Mesh
from hardware.virtual.studio.objects import Body, Points, clouds, dappled, step, two_finishes
from hardware.virtual.studio.solids import Solid

Made = tuple[Points, Float[np.ndarray, " v"], Float[np.ndarray, " v"] | None]
FROM_FILE = "from-file"
NUMBERS = ("roughness", "specular")


def _paint(p: Points, seed: int) -> Made:
    """Patches of three colours; glossy and matte."""
    hues = _hues(seed, 3, 0.42, 0.55)
    return dappled(p, seed + 10, hues, 0.08), two_finishes(p, seed + 60, 0.3, 0.65, 0.14), None


def _clay(p: Points, seed: int) -> Made:
    """One earthen colour, matte, faintly uneven."""
    tone = np.array([0.5, 0.36, 0.27]) * np.exp(0.08 * clouds(seed, 0.1, 3)(p))[:, None]
    return np.clip(tone, 0.03, 0.9), np.clip(0.75 + 0.04 * clouds(seed + 1, 0.1)(p), 0.6, 0.9), None


def _glaze(p: Points, seed: int) -> Made:
    """A glossy coat that runs from one colour into another."""
    first, second = (np.array(hue) for hue in _hues(seed, 2, 0.3, 0.5))
    share = step(clouds(seed + 2, 0.2, 2)(p), 0.9)[:, None]
    tone = first + (second - first) * share
    return (
        np.clip(tone * np.exp(0.1 * clouds(seed + 3, 0.03)(p))[:, None], 0.03, 0.9),
        np.full(len(p), 0.22),
        None,
    )


def _metal(p: Points, seed: int) -> Made:
    """Satin bronze, a little uneven."""
    tone = np.array([0.82, 0.6, 0.4]) * np.exp(0.06 * clouds(seed, 0.05, 2)(p))[:, None]
    return (
        np.clip(tone, 0.03, 0.95),
        np.clip(0.42 + 0.06 * clouds(seed + 1, 0.1)(p), 0.3, 0.55),
        np.ones(len(p)),
    )


def _textured(p: Points, seed: int) -> Made:
    """Many colours in patches of every size down to a few millimetres."""
    albedo = dappled(p, seed, _hues(seed, 6, 0.4, 0.7), 0.05)
    fine = dappled(p, seed + 100, _hues(seed + 1, 6, 0.4, 0.8), 0.016)
    share = step(clouds(seed + 200, 0.03, 2)(p), 0.1)[:, None]
    return albedo + (fine - albedo) * share, two_finishes(p, seed + 60, 0.4, 0.6, 0.1), None


def _hues(seed: int, count: int, value: float, saturation: float) -> list[tuple[float, float, float]]:
    hues = paint.palette(np.random.default_rng(seed), count, value, 0.35, saturation)
    return [tuple(float(c) for c in hue) for hue in hues]  # type: ignore[misc]


MATERIALS: dict[str, Callable[[Points, int], Made]] = {
    "paint": _paint, "clay": _clay, "glaze": _glaze, "metal": _metal, "textured": _textured,
}  # fmt: skip


def check(material: str) -> None:
    """
    Raises:
        StudioError: no such material.
    """
    if order.changed(material, *NUMBERS)[0] not in order.MATERIALS:
        raise StudioError(
            f"there is no material called {material!r}; choose one of {', '.join(order.MATERIALS)}"
        )


def dress(mesh: Mesh, material: str, seed: int, scale: float) -> Body:
    """The body of a mesh that stands before the camera, `scale` times as large as a built-in object.

    Raises:
        StudioError: no such material.
    """
    check(material)
    name, solid = f"{mesh.name}-{material.replace(':', '-')}-{meshes.digest(mesh)}", meshes.solid(mesh)
    if material == FROM_FILE:
        albedo, roughness, metalness = mesh.looks()
        return Body(f"{name}-0", solid, albedo, roughness, metalness if metalness.max() > 0 else None)
    used = mesh.vertices - mesh.vertices.mean(0)
    return painted(f"{name}-{seed}", solid, material, used / scale, seed)


def painted(name: str, solid: Solid, material: str, points: Points, seed: int) -> Body:
    """A body of a material other than its file's.

    Raises:
        StudioError: a number that no material takes.
    """
    kind, numbers = order.changed(material, *NUMBERS)
    body = Body(name, solid, *MATERIALS[kind](points, seed))
    if "roughness" in numbers:
        body = replace(body, roughness=np.full(len(points), numbers["roughness"]))
    return replace(body, specular=numbers.get("specular", body.specular))
