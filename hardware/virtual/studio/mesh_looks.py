"""What a mesh file says its surface is made of, at every vertex: glTF's base colour, roughness and metalness, MTL's nearest to it.

Textures and MTL colours are sRGB, glTF's factors and vertex colours linear (glTF 2.0, 3.9); roughness is glTF's, whose square
is the width of GGX. Linear Rec.709.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from hardware.errors import StudioError

PLAIN = (0.5, 0.6, 0.0)  # albedo, roughness, metalness where a file says no more
SMOOTHEST = 0.12  # below, highlights are mirror images, which photographs of this size cannot hold


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Per vertex."""

    albedo: Float[np.ndarray, "v 3"]
    roughness: Float[np.ndarray, " v"]
    metalness: Float[np.ndarray, " v"]


def of(path: Path, parts: list[Any]) -> list[Looks]:
    """The looks of each of a file's parts.

    Raises:
        StudioError: a texture or material file that it names is not there, or it says nothing about its looks.
    """
    if path.suffix.lower() == ".obj":
        _check_files(path)
    looks = [_of(part) for part in parts]
    found = [look for look in looks if look is not None]
    if len(found) < len(looks):
        raise StudioError(
            f"{path}: the file says nothing of its colours, which --material from-file takes; choose --material paint"
        )
    return found


def _of(part: Any) -> Looks | None:
    count = len(part.vertices)
    ones = np.ones(count)
    visual = part.visual
    if visual.kind == "vertex":
        return Looks(_linear(np.asarray(visual.vertex_colors)[:, :3] / 255), ones * PLAIN[1], ones * PLAIN[2])
    if visual.kind != "texture":
        return None
    stated = visual.material
    is_gltf = type(stated).__name__ == "PBRMaterial"
    material = stated if is_gltf else stated.to_pbr()
    factor = material.baseColorFactor
    colour = (
        np.ones(3) if factor is None else np.asarray(factor, float)[:3] / (255 if np.max(factor) > 1 else 1)
    )
    uv = getattr(visual, "uv", None)
    albedo = np.broadcast_to(colour if is_gltf else _linear(colour), (count, 3))
    if uv is not None and material.baseColorTexture is not None:
        albedo = albedo * _linear(_fetched(material.baseColorTexture, uv)[:, :3])
    roughness = ones * (PLAIN[1] if material.roughnessFactor is None else float(material.roughnessFactor))
    default = 1.0 if is_gltf else 0.0
    metalness = ones * (default if material.metallicFactor is None else float(material.metallicFactor))
    if uv is not None and material.metallicRoughnessTexture is not None:
        both = _fetched(material.metallicRoughnessTexture, uv)
        roughness, metalness = roughness * both[:, 1], metalness * both[:, 2]
    return Looks(np.clip(albedo, 0, 1), np.clip(roughness, SMOOTHEST, 1), np.clip(metalness, 0, 1))


def _check_files(path: Path) -> None:
    """Every file that an OBJ's materials name."""
    with path.open(errors="replace") as lines:
        libraries = [line.split(None, 1)[1].strip() for line in lines if line.startswith("mtllib ")]
    for library in libraries:
        place = path.parent / library
        if not place.is_file():
            raise StudioError(f"{path}: its material file {library} is not there; put it beside the mesh")
        for line in place.read_text(errors="replace").splitlines():
            words = line.split()
            if (
                words
                and words[0] in ("map_Kd", "map_Pr", "map_Pm")
                and not (place.parent / words[-1]).is_file()
            ):
                raise StudioError(f"{place}: its texture {words[-1]} is not there; put it beside the mesh")


def _fetched(picture: Any, uv: Float[np.ndarray, "v 2"]) -> Float[np.ndarray, "v 3"]:
    """Bilinear, repeated; v upwards, as trimesh has it of every file. Values 0 to 1."""
    texels = np.asarray(picture.convert("RGB"), float) / 255
    h, w = texels.shape[:2]
    x, y = (uv[:, 0] % 1) * w - 0.5, ((1 - uv[:, 1]) % 1) * h - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    x, y = (x - left)[:, None], (y - top)[:, None]
    a, b = texels[top % h, left % w], texels[top % h, (left + 1) % w]
    c, d = texels[(top + 1) % h, left % w], texels[(top + 1) % h, (left + 1) % w]
    return (a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + d * x) * y


def _linear(srgb: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Linear of sRGB (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
