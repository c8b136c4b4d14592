"""Reads a ground truth: what a studio wrote, or an .npz in the same layout.

Camera frame (x right, y down, z forward; a normal that faces the camera has z < 0), depth along z in the
unit of the truth's poses, albedo and roughness in [0, 1]. No stage of the pipeline may call this.
"""

import json
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from engine.errors import TruthError, reason
from engine.io.formats.arrays import UNREADABLE
from engine.types import Camera

REQUIRED = ("normal", "albedo", "roughness", "depth", "mask")


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What the surface really is; poses and camera only where the file has them."""

    normal: Float[np.ndarray, "h w 3"]
    albedo: Float[np.ndarray, "h w 3"]
    roughness: Float[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    cam_from_world: Float[np.ndarray, "n 3 4"] | None = None
    camera: Camera | None = None


def read_truth(path: Path) -> Truth:
    """The truth in a studio's `truth/` folder (its truth.npz) or in an .npz file.

    Raises:
        TruthError: no such file, a key is missing, sizes disagree, or values cannot be a truth.
    """
    file = path / "truth.npz" if path.is_dir() else path
    if not file.is_file():
        raise TruthError(
            f"{file}: no such file; give a studio's truth/ folder or an .npz with {', '.join(REQUIRED)}"
        )
    try:
        with np.load(file, allow_pickle=False) as archive:
            data = {key: archive[key] for key in archive.files}
    except UNREADABLE as fault:
        raise TruthError(
            f"{file}: not a readable .npz ({reason(fault)}); write the truth again with numpy.savez"
        ) from fault
    missing = [key for key in REQUIRED if key not in data]
    if missing:
        raise TruthError(f"{file}: lacks {', '.join(missing)}; a truth holds {', '.join(REQUIRED)}")
    mask = data["mask"]
    if mask.ndim != 2:
        raise TruthError(f"{file}: mask has shape {mask.shape}; it must be height x width")
    mask = mask > 0
    if not mask.any():
        raise TruthError(f"{file}: the mask is empty; mark the object's pixels")
    for key, depth in (("normal", 3), ("albedo", 3), ("roughness", 0), ("depth", 0)):
        want = mask.shape + ((depth,) if depth else ())
        if data[key].shape != want:
            raise TruthError(
                f"{file}: {key} has shape {data[key].shape}, the mask asks for {want};"
                " crop or resize both alike"
            )
        if not np.isfinite(data[key][mask]).all():
            raise TruthError(
                f"{file}: {key} holds NaN or Inf inside the mask; take those pixels out of the mask"
            )
    if (data["depth"][mask] <= 0).any():
        raise TruthError(f"{file}: depth is not positive inside the mask; it is z in front of the camera")
    normal = data["normal"].astype(np.float64)
    length = np.linalg.norm(normal, axis=-1)
    if (np.abs(length[mask] - 1) > 0.05).any():
        raise TruthError(f"{file}: normals inside the mask are not of unit length; normalise them")
    if np.median(normal[mask][:, 2]) > 0:
        raise TruthError(
            f"{file}: most normals look away from the camera; a facing normal has z < 0 here"
            " (y down, z forward)"
        )
    return Truth(
        normal=normal / np.maximum(length, 1e-12)[..., None],
        albedo=data["albedo"].astype(np.float64),
        roughness=data["roughness"].astype(np.float64),
        depth=data["depth"].astype(np.float64),
        mask=mask,
        cam_from_world=_poses(data, file),
        camera=_camera(data, file),
    )


def _poses(data: dict[str, np.ndarray], file: Path) -> Float[np.ndarray, "n 3 4"] | None:
    if "cam_from_world" not in data:
        return None
    poses = data["cam_from_world"].astype(np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (3, 4) or not np.isfinite(poses).all():
        raise TruthError(f"{file}: cam_from_world has shape {poses.shape}; it must be finite, views x 3 x 4")
    return poses


def _camera(data: dict[str, np.ndarray], file: Path) -> Camera | None:
    if "camera" not in data:
        return None
    known = {field.name for field in fields(Camera)}
    try:
        facts = json.loads(str(data["camera"]))
        return Camera(**{key: facts[key] for key in known if key in facts})
    except (TypeError, ValueError) as fault:
        raise TruthError(f"{file}: camera is not a JSON object of {', '.join(sorted(known))}") from fault
