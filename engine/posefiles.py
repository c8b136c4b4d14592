"""Camera poses made by other programs: reads three formats into our conventions, writes two of them.

The formats live in `transforms_json`, `colmap_model` and `metashape`, which convert to cam_from_world, our
camera axes and pixel centres. Here they are told apart, checked, and matched to the photographs by name.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

import numpy as np
from jaxtyping import Bool, Float

from engine import colmap_model, metashape, transforms_json
from engine.errors import PoseError
from engine.geometry import check_rigid, resized
from engine.poselist import Listed
from engine.transforms_json import write as write_transforms
from engine.types import Camera, Poses

__all__ = ["GivenPoses", "read_poses", "write_colmap", "write_transforms"]


@dataclass(frozen=True, slots=True, eq=False)
class GivenPoses:
    """Poses read from a file, in the order of the asked names. Rows of views without a pose hold NaN."""

    camera: Camera
    cam_from_world: Float[np.ndarray, "n 3 4"]
    registered: Bool[np.ndarray, " n"]
    points: Float[np.ndarray, "m 3"]  # sparse points when the file has them, else empty
    scale: str  # "given", or "unknown" where the file itself says that its unit is arbitrary
    notes: tuple[str, ...]  # what was converted on the way, for the report


def read_poses(path: Path, names: Sequence[str], size: tuple[int, int]) -> GivenPoses:
    """Poses of the views `names` (file names, with or without folder and suffix); `size` is (width, height).

    Raises:
        PoseError: the file cannot be read, holds poses of other photographs, a matrix that is no rigid
            transform, a camera of another aspect, or a lens that `Camera` cannot express.
    """
    if not path.exists():
        raise PoseError(f"{path}: no such file or folder; give a transforms.json, a COLMAP model or an XML")
    if path.is_dir() or path.name in colmap_model.FILES:
        model = colmap_model.read(path if path.is_dir() else path.parent)
        listed = Listed(model.camera, model.poses, True, model.points, "given", ())
    elif path.suffix.lower() == ".json":
        listed = transforms_json.read(path, size)
    elif path.suffix.lower() == ".xml":
        listed = metashape.read(path)
    else:
        raise PoseError(
            f"{path}: not a known kind of pose file; give a transforms.json, the folder of a COLMAP model"
            " (cameras, images, points3D as .txt or .bin) or a Metashape .xml"
        )
    camera, notes = _at_size(listed.camera, size, path)
    cam_from_world, registered = _match(listed, names, path)
    return GivenPoses(
        camera, cam_from_world, registered, listed.points, listed.scale, (*listed.notes, *notes)
    )


def _at_size(camera: Camera, size: tuple[int, int], path: Path) -> tuple[Camera, tuple[str, ...]]:
    width, height = size
    if (camera.width, camera.height) == size:
        return camera, ()
    # One pixel of rounding in either direction is what resizing leaves behind.
    if abs(camera.width * height - camera.height * width) > max(width, height, camera.width, camera.height):
        raise PoseError(
            f"{path}: the camera is {camera.width} x {camera.height} but the photographs are"
            f" {width} x {height}, another aspect; export the poses for these photographs"
            " (uncropped and not turned)"
        )
    note = f"intrinsics rescaled from {camera.width} x {camera.height} to {width} x {height}"
    return resized(camera, width, height), (note,)


def _tails(name: str) -> tuple[str, str, str]:
    """Full path, file name and stem, without regard to the slash's direction or the letters' case."""
    path = PurePosixPath(PureWindowsPath(name).as_posix().lower())
    return str(path).removeprefix("./"), path.name, path.stem


def _match(
    listed: Listed, names: Sequence[str], path: Path
) -> tuple[Float[np.ndarray, "n 3 4"], Bool[np.ndarray, " n"]]:
    """Rows in the order of `names`: by whole path, else by file name, else by stem; never by position."""
    tables: tuple[dict[str, list[str]], ...] = ({}, {}, {})
    for key in listed.poses:
        for table, tail in zip(tables, _tails(key), strict=True):
            table.setdefault(tail, []).append(key)
    result = np.full((len(names), 3, 4), np.nan)
    absent: list[str] = []
    for row, name in enumerate(names):
        found = next((t[k] for t, k in zip(tables, _tails(name), strict=True) if k in t), [])
        if not found:
            absent.append(name)
            continue
        if len(found) > 1:
            raise PoseError(
                f"{path}: {name} could be any of {', '.join(found[:3])}; give the poses distinct file names"
            )
        pose = listed.poses[found[0]]
        if pose is not None:
            check_rigid(pose, f"{path}: {found[0]}")
            u, _, vt = np.linalg.svd(pose[:, :3])  # the file's rounding, at most check_rigid's tolerance
            result[row] = np.concatenate([u @ vt, pose[:, 3:]], axis=1)
    registered = np.asarray(np.isfinite(result).all((1, 2)))
    # A format that drops unaligned views may miss some, but must speak of most of these photographs.
    if absent and (not listed.partial or len(absent) > len(names) / 2):
        raise PoseError(
            f"{path}: no pose for {len(absent)} of {len(names)} photographs ({', '.join(absent[:3])}"
            f"{', ...' if len(absent) > 3 else ''}); the file names"
            f" {', '.join(list(listed.poses)[:3]) or 'none'} ...: give the poses of these"
            " photographs, or remove those without a pose"
        )
    if not registered.any():
        raise PoseError(f"{path}: no photograph is aligned in it; align them and export again")
    return result, registered


def write_colmap(folder: Path, poses: Poses, names: Sequence[str]) -> None:
    """Registered views and sparse points as a COLMAP text model; `names` become image names."""
    kept = {
        name: pose
        for name, pose, registered in zip(names, poses.cam_from_world, poses.registered, strict=True)
        if registered
    }
    colmap_model.write(folder, colmap_model.Model(poses.camera, kept, poses.points))
