"""Maps that were computed elsewhere (by a network, say) as a `Surface`: one more row beside ours.

Files, codings and frames: see `engine/io/normal_maps.py`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from engine.conventions import NORMAL_FRAMES
from engine.errors import ImportFault
from engine.io.normal_maps import read_albedo, read_normals, read_roughness
from engine.progress import Progress
from engine.surface.depth.normal_integration import integrate_normals
from engine.types import Camera, Surface


@dataclass(frozen=True, slots=True)
class MapFiles:
    """Where the maps are, and how they are meant."""

    normal: Path
    albedo: Path | None = None
    roughness: Path | None = None
    frame: str = "opengl"  # or "opencv": axes of the normals
    coding: str = "srgb"  # or "linear": of a PNG's albedo


def read_maps(
    files: MapFiles,
    camera: Camera,
    mask: Bool[np.ndarray, "h w"],
    distance: float,
    progress: Progress,
) -> Surface:
    """The maps where `mask` and the normals' file both hold a pixel, the depth integrated to mean `distance`.

    Albedo and roughness hold NaN where there is no file for them: their scores are then no numbers. What these
    methods do not give (standard errors, residual, flags) is zero.

    Raises:
        ImportFault: a file is missing, unreadable, of another size, or holds what cannot be such a map.
    """
    if files.frame not in NORMAL_FRAMES or files.coding not in ("srgb", "linear"):
        raise ImportFault(
            f'frame "{files.frame}", coding "{files.coding}": a frame is "opencv" or "opengl", a coding'
            ' "srgb" or "linear"'
        )
    normal = read_normals(files.normal, mask, files.frame)
    mask = mask & normal.any(2)
    if not mask.any():
        raise ImportFault(
            f"{files.normal}: no normal inside the object mask; give the map of this object, uncropped"
        )
    albedo, roughness = np.full((*mask.shape, 3), np.nan), np.full(mask.shape, np.nan)
    if files.albedo is not None:
        albedo = read_albedo(files.albedo, mask, files.coding)
    if files.roughness is not None:
        roughness = read_roughness(files.roughness, mask)
    normal = np.where(mask[..., None], normal, 0.0)
    depth = integrate_normals(camera, normal, mask, distance, progress)
    nothing = np.zeros(mask.shape, np.float32)
    return Surface(
        mask,
        normal.astype(np.float32),
        np.where(mask[..., None], albedo, 0).astype(np.float32),
        np.where(mask, roughness, 0).astype(np.float32),
        depth.astype(np.float32),
        nothing, nothing, nothing, nothing,
        np.zeros(mask.shape, np.uint8),
    )  # fmt: skip
