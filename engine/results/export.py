"""Writes a result where other programs read it: EXR, PNG, PLY, glTF, JSON, COLMAP, transforms.json.

`maps.exr` is in the camera frame (x right, y down, z forward); meshes stand with y up; the light, the poses
and the sparse points are in the world frame. docs/file-formats.md describes every file. A folder appears
whole, by one rename, or not at all.
"""

import contextlib
import json
import os
import re
import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import OpenEXR
from jaxtyping import Float

from engine.errors import ExportError
from engine.io import gltf, mesh, ply
from engine.io.poses.pose_files import write_colmap, write_transforms
from engine.light.gaussians.gaussians import to_3dgs
from engine.progress import Progress
from engine.results import lamps_json, preview_images
from engine.results.params import GREEN, ExportParams
from engine.types import (
    Camera,
    Gaussians,
    Lamps,
    LightProvenance,
    Panorama,
    Poses,
    Surface,
    material_of,
    part_of,
)

INDEX = "export.json"
VIEWS = "images"  # the folder that COLMAP's and NeRF tools take pictures from unless told otherwise


def write(
    to: Path,
    surface: Surface,
    gaussians: Gaussians,
    lamps: Lamps,
    poses: Poses,
    names: Sequence[str],
    panorama: Panorama,
    grounds: LightProvenance,
    photographs: Float[np.ndarray, "n h w 3"],
    params: ExportParams,
    progress: Progress,
) -> None:
    """Write everything into folder `to`, whole or not at all; an earlier export there is replaced.

    Raises:
        ExportError: `to` holds other files, the disk is full, or the place may not be written.
    """

    def fill(folder: Path) -> None:
        write_files(
            folder, surface, gaussians, lamps, poses, names, panorama, grounds, photographs, params, progress
        )

    place(to, fill)


def copy(
    exported: Path,
    to: Path,
    green: str | None = None,
    files: Collection[str] | None = None,
    progress: Progress | None = None,
) -> None:
    """Copy a finished export to folder `to`, whole or not at all; an earlier export there is replaced.

    Args:
        green: "up" (OpenGL) or "down" (DirectX) in the PNG normal maps; None: as they are.
        files: names to copy; None: all. The index, which tells units and frames, always comes along.

    Raises:
        ExportError: `exported` is no export or holds no such file, `green` is unknown, `to` holds other files,
            the disk is full, or `to` is closed.
        Cancelled: `progress` said so; `to` is as it was.
    """
    progress = progress or Progress()
    names = _listed(exported)
    if names is None:
        raise ExportError(
            f"{exported}: holds no {INDEX} that can be read; remove {exported} and process again"
        )
    strangers = sorted(set(files or ()) - set(names))
    if strangers:
        raise ExportError(f"{exported}: holds no {strangers[0]}; choose among {', '.join(names)}")
    index = json.loads((exported / INDEX).read_text())
    index["files"] = wanted = [name for name in names if files is None or name in files]
    turned = green is not None and index["png"]["normal"]["green"] != green
    if green is not None and turned:
        index["png"]["normal"] = {"green": preview_images.checked(green)}

    def fill(folder: Path) -> None:
        for i, name in enumerate(wanted):
            progress.step(i / len(wanted), name)
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if green is not None and turned and name in preview_images.NORMALS:
                (folder / name).write_bytes(preview_images.with_green((exported / name).read_bytes(), green))
            else:
                shutil.copyfile(exported / name, folder / name)
        (folder / INDEX).write_text(json.dumps(index, indent=2) + "\n")

    place(to, fill)


def place(to: Path, fill: Callable[[Path], None]) -> None:
    """Let `fill` write into a folder beside `to`, then put it there by a rename.

    Raises:
        ExportError: `to` holds files that no export wrote, the disk is full, or the place may not be written.
    """
    to = to.absolute()
    partial, old = (to.with_name(f".{to.name}.{word}") for word in ("partial", "old"))
    try:
        _tidy(to, partial, old)  # after a run that was killed
        _refuse_strangers(to)
        partial.mkdir(parents=True)
        fill(partial)
        if to.exists():
            to.rename(old)
        partial.rename(to)
    except OSError as fault:
        raise told(fault, to) from fault
    finally:
        # Whatever stopped it, Ctrl-C too: of a refusal more is known already.
        with contextlib.suppress(OSError):
            _tidy(to, partial, old)


def _tidy(to: Path, partial: Path, old: Path) -> None:
    """Wipe what is unfinished or replaced; what was replaced by nothing goes back to its place."""
    if partial.exists():
        shutil.rmtree(partial)
    if old.exists() and not to.exists():
        old.rename(to)
    if old.exists():
        shutil.rmtree(old)


def write_files(
    folder: Path,
    surface: Surface,
    gaussians: Gaussians,
    lamps: Lamps,
    poses: Poses,
    names: Sequence[str],
    panorama: Panorama,
    grounds: LightProvenance,
    photographs: Float[np.ndarray, "n h w 3"],
    params: ExportParams,
    progress: Progress,
) -> None:
    """Write everything into an existing empty folder; the caller sees to it that it appears whole.

    Raises:
        ExportError: the depth map holds no surface, or writing failed.
    """
    unit = "metre" if poses.metric else "that of the given poses" if poses.scale == "given" else "unknown"
    try:
        progress.step(0.0, "maps.exr")
        _write_maps(folder / "maps.exr", surface, poses.camera, unit)
        _write_panorama(folder / "light.exr", panorama)
        (folder / "coverage.png").write_bytes(preview_images.coverage(grounds))
        progress.step(0.2, "PNG maps")
        green = GREEN[params.normal_png]
        shown = np.asarray(photographs[names.index(panorama.view)])
        drawn, facts = preview_images.draw(surface, shown, green, unit)
        for name, data in drawn.items():
            (folder / name).write_bytes(data)
        progress.step(0.4, "meshes")
        shape = mesh.from_depth(
            surface, poses.camera, mesh.CutParams(params.cut_footprints, params.cut_share)
        )
        (folder / "surface.ply").write_bytes(ply.surface_ply(shape, surface, unit))
        progress.step(0.6, "surface.glb")
        (folder / "surface.glb").write_bytes(
            gltf.surface_glb(shape, surface, unit, f"Roomlight {_version()}")
        )
        progress.step(0.8, "light.ply")
        (folder / "light.ply").write_bytes(ply.splat_ply(to_3dgs(gaussians)))
        (folder / "lamps.json").write_bytes(lamps_json.lamps_json(lamps, unit))
        progress.step(0.9, "views and poses")
        files = [f"{name}.jpg" for name in names]
        _write_views(folder / VIEWS, files, photographs, poses, preview_images.white_of(shown))
        write_colmap(folder / "colmap", poses, files)
        write_transforms(folder / "transforms.json", poses, [f"{VIEWS}/{file}" for file in files])
        index = {
            "program": f"Roomlight {_version()}",
            "unit_of_length": unit,
            "scale_from": poses.scale,
            "camera": asdict(poses.camera),
            "maps_frame": FRAME,
            "mesh_frame": "x right, y up, z towards the viewer; camera frame turned 180 degrees about x",
            "light_frame": f"light.exr, coverage.png: camera frame of view {panorama.view}; light.ply, lamps.json, poses: world",
            "light_on_the_object": {"guessed": grounds.guessed, "lower_bound": grounds.lower_bound},
            "png": facts,
            "triangles": len(shape.triangles),
            "files": sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()),
        }
        (folder / INDEX).write_text(json.dumps(index, indent=2) + "\n")
    except OSError as fault:
        raise told(fault, folder) from fault
    progress.step(1.0, "written")


def _write_views(
    folder: Path, files: Sequence[str], photographs: Float[np.ndarray, "n h w 3"], poses: Poses, white: float
) -> None:
    """The registered views' pictures, as bright as `photograph.png`; a view's name may hold folders."""
    for file, photograph, registered in zip(files, photographs, poses.registered, strict=True):
        if registered:
            path = folder / file
            if not path.resolve().is_relative_to(folder.resolve()):
                raise ExportError(
                    f"{file}: a view's name leads out of the export; import its photographs again"
                )
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(preview_images.view(np.asarray(photograph), white))


FRAME = "camera: x right, y down, z forward; a normal that faces the camera has z < 0"


def told(fault: OSError, place: Path) -> ExportError:
    """An operating system's refusal in one line: file, cause, remedy."""
    # Of a copy, the second name is the one that is written; `.out.partial` becomes `out`.
    where = re.sub(r"/\.([^/]+)\.partial(?=/|$)", r"/\1", str(fault.filename2 or fault.filename or place))
    remedy = {
        28: "free space or export to another disk",
        122: "free space or export to another disk",
        13: "choose a folder you may write to",
        1: "choose a folder you may write to",
        30: "choose a folder you may write to",
        17: "choose a folder in another place",
        20: "choose a folder in another place",
        36: "choose a shorter name",
    }.get(fault.errno or 0, "check the disk and the path")
    return ExportError(f"{where}: {(fault.strerror or str(fault)).lower()}; {remedy}")


def _write_maps(path: Path, surface: Surface, camera: Camera, unit: str) -> None:
    level, metalness = np.moveaxis(material_of(surface), -1, 0)
    channels = {
        **{f"normal.{axis}": surface.normal[..., k] for k, axis in enumerate("XYZ")},
        **{f"albedo.{colour}": surface.albedo[..., k] for k, colour in enumerate("RGB")},
        "roughness.Y": surface.roughness,
        "specular.Y": level,
        "metalness.Y": metalness,
        "depth.Z": surface.depth,
        "part.Y": part_of(surface),
        "mask.Y": surface.mask,
        "stderr.normal_deg": np.degrees(surface.stderr_normal),
        "stderr.albedo": surface.stderr_albedo,
        "stderr.roughness": surface.stderr_roughness,
        "stderr.part": np.zeros_like(surface.depth) if surface.stderr_part is None else surface.stderr_part,
        "residual.Y": surface.residual,
        "flags.Y": surface.flags,
    }
    attributes = {
        "frame": FRAME,
        "unit.depth": unit,
        "part": "1 the largest part of the depth that no jump divides, 2 the next, ..., 0 too small to be told",
        "stderr.part": "in unit.depth; of how far a pixel's part stands before or behind the others, 0 where there is one part",
        "unit.stderr.normal_deg": "degree",
        "colour": "albedo: linear Rec.709, 0..1",
        "roughness": "alpha = roughness^2 (GGX)",
        "specular": "normal reflectance 0.08 specular where metalness is 0, albedo where it is 1",
        "flags": "bit field: 1 grazing, 2 shadowed in most views, 4 saturated, 8 ill-conditioned, 16 lit by what no photograph shows",
        "camera": json.dumps(asdict(camera)),
        "camera.model": "OpenCV pinhole k1 k2 p1 p2; the centre of the first pixel is (0.5, 0.5)",
    }
    _write_exr(path, channels, attributes)


def _write_panorama(path: Path, panorama: Panorama) -> None:
    channels = {
        **{colour: panorama.radiance[..., k] for k, colour in enumerate("RGB")},
        "seen.Y": panorama.seen,
    }
    attributes = {
        "frame": f"camera frame of view {panorama.view}, at the object's centre",
        "layout": "equirectangular; the middle looks along +z (camera's view), the top row along -y (up)",
        "unit": "radiance, linear Rec.709, the session's scale",
        "seen.meaning": "1 photographed, 0 guessed",
    }
    _write_exr(path, channels, attributes)


def _write_exr(path: Path, channels: Mapping[str, np.ndarray], attributes: Mapping[str, str]) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    planes = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in channels.items()}
    # The writer replaces arrays in the dict it is given, and says nothing when the disk fills up while it
    # closes the file: hence a dict of its own, and a look at what arrived.
    try:
        with OpenEXR.File(header, dict(planes)) as file:
            file.write(str(path))
        with OpenEXR.File(str(path), separate_channels=True) as file:
            arrived = {name: channel.pixels for name, channel in file.channels().items()}
    except RuntimeError as fault:
        raise _as_os_error(path, str(fault)) from fault
    if not all(np.array_equal(arrived[name], plane, equal_nan=True) for name, plane in planes.items()):
        raise _as_os_error(path, "the file does not hold what was written")


def _as_os_error(path: Path, said: str) -> OSError:
    """What the system says about writing there; EXR's own words where it now says nothing."""
    try:
        with path.open("ab") as file:
            file.write(b"\0" * 65536)
            file.flush()
            os.fsync(file.fileno())
    except OSError as cause:
        return cause
    return OSError(5, said, str(path))


def _refuse_strangers(to: Path) -> None:
    """An export may replace an earlier export and nothing else."""
    if not to.exists() and not to.is_symlink():
        return
    if not to.is_dir() or to.is_symlink():
        raise ExportError(f"{to}: is not a plain folder; name a new one")
    there = {str(path.relative_to(to)) for path in to.rglob("*") if not path.is_dir()}
    strangers = sorted(there - {*(_listed(to) or ()), INDEX})
    if strangers:
        what = f"{strangers[0]}, which no export wrote"
        if len(strangers) > 1:
            what = f"{len(strangers)} files that no export wrote, such as {strangers[0]}"
        raise ExportError(f"{to}: holds {what}; name a new or empty folder")


def _listed(folder: Path) -> list[str] | None:
    """The files that an export's index lists; None where there is no export."""
    try:
        files = json.loads((folder / INDEX).read_text())["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return [name for name in files if isinstance(name, str)]


def _version() -> str:
    try:
        return version("roomlight")
    except PackageNotFoundError:
        return "from a source tree"
