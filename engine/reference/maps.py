"""Maps that were computed elsewhere (by a network, say) as a `Surface`: one more row beside ours.

Files: OpenEXR (channels R, G, B or X, Y, Z, or a single one), PNG of 8 or 16 bits, .npy, or .npz with the key
normal, albedo or roughness. PNG normals are coded as (n + 1) / 2, and black ones were not answered; a PNG's albedo
is sRGB-coded unless said otherwise; its roughness is linear. All maps are on the photographs' pixel grid.

Frames: "opencv" is ours (x right, y down, z ahead: normals that face the camera have z < 0); "opengl" has y up
and z towards the camera (z > 0), which most networks write, SDM-UniPS and LINO-UniPS among them. The wrong one is
found out by the sign of z.
"""

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from jaxtyping import Bool, Float

from engine.errors import ImportFault
from engine.geometry import opencv_from_opengl
from engine.images import srgb_decode
from engine.progress import Progress
from engine.surface.integrate import integrate
from engine.types import Camera, Surface

UNIT_TOLERANCE = 0.05
"""How far from 1 a normal's length may be: eight bits leave 0.01."""
ANSWERED = 0.5
"""A shorter normal is a pixel that was left out."""


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
    if files.frame not in ("opencv", "opengl") or files.coding not in ("srgb", "linear"):
        raise ImportFault(
            f'frame "{files.frame}", coding "{files.coding}": a frame is "opencv" or "opengl", a coding'
            ' "srgb" or "linear"'
        )
    normal = _normals(files, mask)
    mask = mask & (np.linalg.norm(normal, axis=2) > ANSWERED)
    if not mask.any():
        raise ImportFault(
            f"{files.normal}: no normal inside the object mask; give the map of this object, uncropped"
        )
    size = (*mask.shape, 3)
    albedo, roughness = np.full(size, np.nan), np.full(mask.shape, np.nan)
    if files.albedo is not None:
        albedo, coded = _read(files.albedo, "albedo", size)
        if coded and files.coding == "srgb":
            albedo = srgb_decode(albedo)
        _in_range(files.albedo, "albedo", albedo[mask])
    if files.roughness is not None:
        roughness, _ = _read(files.roughness, "roughness", mask.shape)
        _in_range(files.roughness, "roughness", roughness[mask])
    normal = np.where(mask[..., None], normal, 0.0)
    depth = integrate(camera, normal, mask, distance, progress)
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


def _normals(files: MapFiles, mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
    """Unit normals in our frame; zero where the file has none."""
    normal, coded = _read(files.normal, "normal", (*mask.shape, 3))
    if coded:
        normal = np.where(normal.any(2, keepdims=True), 2 * normal - 1, 0)
    if not np.isfinite(normal[mask]).all():
        raise ImportFault(
            f"{files.normal}: NaN or Inf inside the object mask; write zeros where nothing is known"
        )
    normal = np.nan_to_num(normal)
    length = np.linalg.norm(normal, axis=2)
    answered = mask & (length > ANSWERED)
    off = answered & (np.abs(length - 1) > UNIT_TOLERANCE)
    # Anti-aliasing shortens a few along the outline.
    if off.sum() > 0.01 * answered.sum():
        raise ImportFault(
            f"{files.normal}: {off.sum()} of {answered.sum()} normals are not of unit length (median"
            f" {np.median(length[answered]):.2f}); write them as unit vectors, in a PNG as (n + 1) / 2"
        )
    if files.frame == "opengl":
        normal = normal @ opencv_from_opengl
    if answered.any() and np.median(normal[answered][:, 2]) > 0:
        other = {"opengl": "opencv", "opencv": "opengl"}[files.frame]
        raise ImportFault(
            f'{files.normal}: read as "{files.frame}", most normals look away from the camera; if y is'
            f' {"down" if other == "opencv" else "up"}, give the frame "{other}"'
        )
    return normal / np.maximum(length, 1e-12)[..., None] * (length > ANSWERED)[..., None]


def _read(path: Path, kind: str, shape: tuple[int, ...]) -> tuple[np.ndarray, bool]:
    """The map as floats, and whether it is coded in whole numbers of [0, 1]."""
    if not path.is_file():
        raise ImportFault(f"{path}: no such file; give the {kind} map's path")
    reader = {".exr": _exr, ".png": _png, ".npy": _numpy, ".npz": _numpy}.get(path.suffix.lower())
    if reader is None:
        raise ImportFault(f"{path}: maps are read from .exr, .png, .npy and .npz; convert the file")
    values = reader(path, kind)
    coded = values.dtype in (np.uint8, np.uint16)
    if not coded and values.dtype.kind != "f":
        raise ImportFault(f"{path}: {kind} holds {values.dtype}; write floats")
    if coded:
        values = values / np.iinfo(values.dtype).max
    if values.ndim == 3 and len(shape) == 2:
        values = values[..., 0]
    if values.shape != shape:
        raise ImportFault(
            f"{path}: {kind} is of shape {_by(values.shape)}, the photographs ask for {_by(shape)} (rows x"
            " columns); compute or resize it on their pixel grid, uncropped"
        )
    return values.astype(np.float64), coded


def _png(path: Path, kind: str) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ImportFault(f"{path}: cannot be read as PNG, it may be cut off; write it again")
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])


def _exr(path: Path, kind: str) -> np.ndarray:
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as fault:
        reason = " ".join(str(fault).split())
        raise ImportFault(
            f"{path}: cannot be read as OpenEXR, it may be cut off ({reason}); write it again"
        ) from fault
    for names in ("RGB", "XYZ"):
        if set(names) <= set(channels):
            return np.stack([channels[name] for name in names], axis=-1)
    if len(channels) == 1:
        return next(iter(channels.values()))
    raise ImportFault(
        f"{path}: channels {', '.join(sorted(channels))}; {kind} is read from R, G, B or X, Y, Z or a single one"
    )


def _numpy(path: Path, kind: str) -> np.ndarray:
    try:
        held = np.load(path, allow_pickle=False)
        if isinstance(held, np.ndarray):
            return held
        with held:
            if kind in held.files:
                return held[kind]
            found = ", ".join(held.files)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as fault:
        raise ImportFault(
            f"{path}: cannot be read as NumPy's ({fault}); write it again with numpy.save"
        ) from fault
    raise ImportFault(f"{path}: lacks the key {kind}, it holds {found}; write it again with numpy.savez")


def _in_range(path: Path, kind: str, values: np.ndarray) -> None:
    if not (np.isfinite(values).all() and values.min() >= 0 and values.max() <= 1 + 1e-6):
        raise ImportFault(
            f"{path}: {kind} inside the object mask reaches from {values.min():.3g} to {values.max():.3g};"
            " it must lie in [0, 1]"
        )


def _by(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))
