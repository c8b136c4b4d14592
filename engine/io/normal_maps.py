"""Maps of an object that were computed elsewhere, by a network say: normals, albedo, roughness, one file each or together.

Files: OpenEXR (channels R, G, B or X, Y, Z, or a single one), PNG of 8 or 16 bits, .npy, or .npz with the key
normal, albedo or roughness. PNG normals are coded as (n + 1) / 2, and black ones were not answered; a PNG's albedo
is sRGB-coded unless said otherwise; its roughness is linear. All maps are on the photographs' pixel grid.

Frames: "opencv" is ours (x right, y down, z ahead: normals that face the camera have z < 0); "opengl" has y up
and z towards the camera (z > 0), which most networks write, SDM-UniPS and LINO-UniPS among them. The wrong one is
found out by the sign of z.
"""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from jaxtyping import Bool, Float

from engine.conventions import NORMAL_FRAMES
from engine.errors import ImportFault, reason
from engine.geometry import opencv_from_opengl
from engine.io.formats.arrays import UNREADABLE
from engine.io.images import UNREADABLE_PICTURE, opened, srgb_decode

UNIT_TOLERANCE = 0.05
"""How far from 1 a normal's length may be: eight bits leave 0.01."""
ANSWERED = 0.5
"""A shorter normal is a pixel that was left out."""


def read_normals(path: Path, mask: Bool[np.ndarray, "h w"], frame: str) -> Float[np.ndarray, "h w 3"]:
    """Unit normals in our frame; zero where the file has none.

    Raises:
        ImportFault: the file is missing, unreadable, of another size, not of unit vectors or of another frame.
    """
    if frame not in NORMAL_FRAMES:
        raise ImportFault(
            f'frame "{frame}": give "opencv" (y down, z ahead) or "opengl" (y up, z to the camera)'
        )
    normal, coded = _read(path, "normal", (*mask.shape, 3))
    if coded:
        normal = np.where(normal.any(2, keepdims=True), 2 * normal - 1, 0)
    if not np.isfinite(normal[mask]).all():
        raise ImportFault(f"{path}: NaN or Inf inside the object mask; write zeros where nothing is known")
    normal = np.nan_to_num(normal)
    length = np.linalg.norm(normal, axis=2)
    answered = mask & (length > ANSWERED)
    off = answered & (np.abs(length - 1) > UNIT_TOLERANCE)
    # Anti-aliasing shortens a few along the outline.
    if off.sum() > 0.01 * answered.sum():
        raise ImportFault(
            f"{path}: {off.sum()} of {answered.sum()} normals are not of unit length (median"
            f" {np.median(length[answered]):.2f}); write them as unit vectors, in a PNG as (n + 1) / 2"
        )
    if frame == "opengl":
        normal = normal @ opencv_from_opengl
    if answered.any() and np.median(normal[answered][:, 2]) > 0:
        other = {"opengl": "opencv", "opencv": "opengl"}[frame]
        raise ImportFault(
            f'{path}: read as "{frame}", most normals look away from the camera; if y is'
            f' {"down" if other == "opencv" else "up"}, give the frame "{other}"'
        )
    return normal / np.maximum(length, 1e-12)[..., None] * (length > ANSWERED)[..., None]


def read_albedo(path: Path, mask: Bool[np.ndarray, "h w"], coding: str) -> Float[np.ndarray, "h w 3"]:
    """Linear albedo; `coding` is a PNG's, "srgb" or "linear".

    Raises:
        ImportFault: missing, unreadable, of another size, or beyond [0, 1] inside the mask.
    """
    albedo, coded = _read(path, "albedo", (*mask.shape, 3))
    if coded and coding == "srgb":
        albedo = srgb_decode(albedo)
    _in_range(path, "albedo", albedo[mask])
    return albedo


def read_roughness(path: Path, mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Disney's roughness.

    Raises:
        ImportFault: missing, unreadable, of another size, or beyond [0, 1] inside the mask.
    """
    roughness, _ = _read(path, "roughness", mask.shape)
    _in_range(path, "roughness", roughness[mask])
    return roughness


def holds(path: Path, kind: str) -> bool:
    """Whether an .npz file has a map of that kind beside its normals; no other file has."""
    if path.suffix.lower() != ".npz" or not path.is_file():
        return False
    try:
        with np.load(path, allow_pickle=False) as held:
            return kind in held.files
    except UNREADABLE:
        return False  # what is wrong with it is told as its normals are read


def _read(path: Path, kind: str, shape: tuple[int, ...]) -> tuple[np.ndarray, bool]:
    """The map as floats, and whether it is coded in whole numbers of [0, 1]."""
    if not path.is_file():
        raise ImportFault(f"{path}: no such file; give the {kind} map's path")
    reader = {".exr": _exr, ".png": _png, ".npy": _numpy, ".npz": _numpy}.get(path.suffix.lower())
    if reader is None:
        raise ImportFault(f"{path}: maps are read from .exr, .png, .npy and .npz; convert the file")
    # The header tells the size before gigabytes are made of a damaged one; NumPy's files are checked once read.
    if (grid := _grid(path)) is not None and grid != shape[:2]:
        raise _of_other_shape(path, kind, grid, shape[:2])
    values = reader(path, kind)
    coded = values.dtype in (np.uint8, np.uint16)
    if not coded and values.dtype.kind != "f":
        raise ImportFault(f"{path}: {kind} holds {values.dtype}; write floats")
    if coded:
        values = values / np.iinfo(values.dtype).max
    if values.ndim == 3 and len(shape) == 2:
        values = values[..., 0]
    if values.shape != shape:
        raise _of_other_shape(path, kind, values.shape, shape)
    return values.astype(np.float64), coded


def _of_other_shape(path: Path, kind: str, found: Sequence[int], wanted: Sequence[int]) -> ImportFault:
    return ImportFault(
        f"{path}: {kind} is of shape {_by(found)}, the photographs ask for {_by(wanted)} (rows x columns); compute or"
        " resize it on their pixel grid, uncropped"
    )


def _grid(path: Path) -> tuple[int, int] | None:
    """(height, width) as a picture's header says; None where it says nothing, which reading it then explains."""
    try:
        if path.suffix.lower() == ".png":
            with opened(path) as image:
                return image.height, image.width
        if path.suffix.lower() == ".exr":
            with OpenEXR.File(str(path), header_only=True) as file:
                (left, top), (right, bottom) = file.header()["dataWindow"]
                return int(bottom) - int(top) + 1, int(right) - int(left) + 1
    except (RuntimeError, *UNREADABLE_PICTURE):
        pass
    return None


def _png(path: Path, kind: str) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if _grid(path) else None
    if image is None:
        raise ImportFault(f"{path}: cannot be read as PNG, it may be cut off; write it again")
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])


def _exr(path: Path, kind: str) -> np.ndarray:
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as fault:
        raise ImportFault(
            f"{path}: cannot be read as OpenEXR, it may be cut off ({reason(fault)}); write it again"
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
    except UNREADABLE as fault:
        raise ImportFault(
            f"{path}: cannot be read as NumPy's ({reason(fault)}); write it again with numpy.save"
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
