"""Camera poses made by other programs: reads three formats into our conventions, writes two of them.

The formats live in `transforms_json`, `colmap_model` and `metashape`, which convert to cam_from_world, our
camera axes and pixel centres. Here they are told apart, matched to the photographs by name, and checked: of the
file only what belongs to these photographs.
"""

import unicodedata
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from struct import error as StructError
from xml.etree.ElementTree import ParseError

import numpy as np
from jaxtyping import Bool, Float

from engine.errors import PoseError
from engine.geometry import check_rigid, resized
from engine.io.poses import colmap, metashape, transforms_json
from engine.io.poses.pose_list import Image, Listed
from engine.io.poses.transforms_json import write as write_transforms
from engine.io.suffixes import PICTURE_SUFFIXES
from engine.types import Camera, Poses

__all__ = ["GivenPoses", "read_poses", "write_colmap", "write_transforms"]

# What Python's readers raise of a file that holds something else than they expect.
_DAMAGE = (
    OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError, StructError,
    ParseError,
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class GivenPoses:
    """Poses read from a file, in the order of the asked names. Rows of views without a pose hold NaN."""

    camera: Camera
    cam_from_world: Float[np.ndarray, "n 3 4"]
    registered: Bool[np.ndarray, " n"]
    points: Float[np.ndarray, "m 3"]  # sparse points when the file has them, else empty
    scale: str  # "given", or "unknown" where the file itself says that its unit is arbitrary
    notes: tuple[str, ...]  # which views have none and what was converted, for who imports and the report


def read_poses(path: Path, names: Sequence[str | Sequence[str]], size: tuple[int, int]) -> GivenPoses:
    """Poses of views, each known by a file name or by any of several: with or without folder and suffix.

    Where the file has poses of several names of a view, the first counts. Views may be without a pose while most
    have one. `size` is (width, height) of the photographs.

    Raises:
        PoseError: the file cannot be read, lacks half of the views or more, or holds of those views a matrix that
            is no rigid transform, several cameras, a camera of another aspect, or a lens that `Camera` cannot
            express; or a name fits two of its images, or an image two views.
    """
    unreadable = "cannot be read ({}); export the poses again"
    try:
        unreadable, read = _reader(path, size)
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            listed = read()
            views = [(view,) if isinstance(view, str) else tuple(view) for view in names]
            found = _match(listed.images, views, path)
            note = _tell_missing(found, listed, views, path)
            placed = {row: one for row, one in enumerate(found) if one is not None and not one.unplaced}
            camera, rescaled = _at_size(_one_camera(placed.values(), path), size, path)
            cam_from_world = np.full((len(views), 3, 4), np.nan)
            for row, image in placed.items():
                cam_from_world[row] = _rigid(image, path)
    except _DAMAGE as fault:
        cause = " ".join(f"{type(fault).__name__}: {fault}".split())[:200]
        raise PoseError(f"{path}: {unreadable.format(cause)}") from fault
    registered = np.isin(np.arange(len(views)), list(placed))
    return GivenPoses(camera, cam_from_world, registered, listed.points, listed.scale, (*note, *rescaled))


def _reader(path: Path, size: tuple[int, int]) -> tuple[str, Callable[[], Listed]]:
    """What to say of a file of this kind that cannot be read, and what reads it."""
    if not path.exists():
        raise PoseError(f"{path}: no such file or folder; give a transforms.json, a COLMAP model or an XML")
    if path.is_dir() or path.name in colmap.FILES:
        folder = path if path.is_dir() else path.parent
        return colmap.UNREADABLE, lambda: colmap.read(folder)
    if path.suffix.lower() == ".json":
        return transforms_json.UNREADABLE, lambda: transforms_json.read(path, size)
    if path.suffix.lower() == ".xml":
        return metashape.UNREADABLE, lambda: metashape.read(path)
    raise PoseError(
        f"{path}: not a known kind of pose file; give a transforms.json, the folder of a COLMAP model"
        " (cameras, images, points3D as .txt or .bin) or a Metashape .xml"
    )


def _one_camera(images: Collection[Image], path: Path) -> Camera:
    cameras: dict[Camera, str] = {}
    for image in images:
        cameras.setdefault(image.camera(), image.name)
    if len(cameras) > 1:
        of = [f"{name} ({c.width} x {c.height}, focal length {c.fx:.6g})" for c, name in cameras.items()]
        raise PoseError(
            f"{path}: {len(cameras)} cameras took these photographs, such as of {of[0]} and of {of[1]}; a"
            " session is photographed with one at one zoom: calibrate them as one (COLMAP:"
            " --ImageReader.single_camera 1)"
        )
    return next(iter(cameras))


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


def _rigid(image: Image, path: Path) -> Float[np.ndarray, "3 4"]:
    pose = image.pose()
    check_rigid(pose, f"{path}: {image.name}")
    u, _, vt = np.linalg.svd(pose[:, :3])  # the file's rounding, at most check_rigid's tolerance
    return np.concatenate([u @ vt, pose[:, 3:]], axis=1)


def _parts(name: str) -> tuple[str, ...]:
    """Folders and file name, without regard to the slash's direction, the letters' case or how accents are put."""
    plain = unicodedata.normalize("NFC", name.replace("\\", "/")).lower()
    return tuple(part for part in plain.split("/") if part not in ("", "."))


def _stem(file: str) -> str:
    """Without the suffix of a picture: the .0001 of render.0001 is none."""
    suffix = PurePosixPath(file).suffix
    return file.removesuffix(suffix) if suffix in PICTURE_SUFFIXES else file


def _bare(file: str) -> str:
    """Without any suffix of a picture: IMG_1.dng.jpg is developed from IMG_1.dng."""
    while (stem := _stem(file)) != file:
        file = stem
    return file


# How an image's name may agree with a photograph's: the first of these ways that finds any counts.
_WAYS: tuple[tuple[Callable[[str], str], Callable[[str], str]], ...] = (
    (str, str), (str, _stem), (_stem, _stem), (_bare, _bare),
)  # fmt: skip


class _Names:
    """Finds images by the names of photographs; never by position."""

    def __init__(self, images: Sequence[Image]) -> None:
        parts = [(_parts(image.name) or ("",), image) for image in images]
        self._tables: list[dict[str, list[tuple[tuple[str, ...], Image]]]] = []
        for of_image, _ in _WAYS:
            table: dict[str, list[tuple[tuple[str, ...], Image]]] = {}
            for entry in parts:
                table.setdefault(of_image(entry[0][-1]), []).append(entry)
            self._tables.append(table)

    def like(self, name: str) -> list[tuple[int, Image]]:
        """Images of the photograph's file name; of several those whose folders agree with its own the longest, and
        how many folders that is."""
        *folders, file = _parts(name) or ("",)
        tables = zip(self._tables, _WAYS, strict=True)
        found = next((t[key] for t, (_, way) in tables if (key := way(file)) in t), [])
        agree = [(_shared(parts[:-1], folders), image) for parts, image in found]
        most = max((count for count, _ in agree), default=0)
        return [(count, image) for count, image in agree if count == most]


def _shared(a: Sequence[str], b: Sequence[str]) -> int:
    """How many parts agree, counted from the end."""
    same = [x == y for x, y in zip(reversed(a), reversed(b), strict=False)]
    return same.index(False) if False in same else len(same)


def _match(images: Sequence[Image], views: Sequence[Sequence[str]], path: Path) -> list[Image | None]:
    """The image of each view: the first of its names that has a pose, else any that is listed."""
    listed = _Names(images)
    wanted = [[(name, listed.like(name)) for name in view] for view in views]
    # Of left/a and right/a an image right/a belongs to the second, though the first may find no other a.
    best: dict[int, int] = {}
    for count, image in (one for view in wanted for _, like in view for one in like):
        best[id(image)] = max(count, best.get(id(image), 0))
    owner: dict[int, str] = {}
    result: list[Image | None] = []
    for view in wanted:
        found: list[Image] = []
        for name, like in view:
            own = [image for count, image in like if count == best[id(image)]]
            if len(own) > 1:
                told = ", ".join(image.name for image in own[:3])
                raise PoseError(f"{path}: {name} could be any of {told}; give the poses distinct file names")
            found += own
        for image in found:
            other = owner.setdefault(id(image), view[0][0])
            if other != view[0][0]:
                raise PoseError(
                    f"{path}: {image.name} could be {other} or {view[0][0]}; give the poses distinct file names"
                )
        result.append(min(found, key=lambda image: bool(image.unplaced), default=None))
    return result


def _tell_missing(
    found: Sequence[Image | None], listed: Listed, views: Sequence[Sequence[str]], path: Path
) -> tuple[str, ...]:
    """A note that names the views without a pose, if there are any.

    Raises:
        PoseError: they are not the smaller part.
    """
    missing = [
        view[0] + (f" ({image.unplaced})" if image is not None else "")
        for view, image in zip(views, found, strict=True)
        if image is None or image.unplaced
    ]
    if not missing:
        return ()
    named = ", ".join([*missing[:3], *["..."] * (len(missing) > 3)])
    if 2 * len(missing) < len(views):
        return (f"no pose for {len(missing)} of {len(views)} photographs: {named}",)
    raise PoseError(
        f"{path}: no pose for {len(missing)} of {len(views)} photographs ({named}); the file names"
        f" {', '.join(image.name for image in listed.images[:3]) or 'none'} ...: give the poses of these"
        " photographs, or remove those without a pose"
    )


def write_colmap(folder: Path, poses: Poses, names: Sequence[str]) -> None:
    """Registered views and sparse points as a COLMAP model; `names` become image names."""
    kept = {
        name: pose
        for name, pose, registered in zip(names, poses.cam_from_world, poses.registered, strict=True)
        if registered
    }
    colmap.write(folder, poses.camera, kept, poses.points)
