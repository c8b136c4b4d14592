"""COLMAP's sparse model on disk: reads text and binary, writes binary.

Source: COLMAP's documented output format (https://colmap.github.io/format.html). Its frames and pixel
centres are ours: cam_from_world with x right, y down, z forward, first pixel centred on (0.5, 0.5).
pycolmap is not used to read: it ends the process on a damaged file, and we owe a message. Text is not written:
COLMAP reads a name from it only up to the first space.
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.io.poses.pose_list import Image, Listed, text_of
from engine.types import Camera

UNREADABLE = "the COLMAP model cannot be read ({}); export it again"
FILES = ("cameras.txt", "images.txt", "points3D.txt", "cameras.bin", "images.bin", "points3D.bin")

# Model name, COLMAP's number of it, and what its parameters are in order.
_MODELS = {
    "SIMPLE_PINHOLE": (0, ("f", "cx", "cy")),
    "PINHOLE": (1, ("fx", "fy", "cx", "cy")),
    "SIMPLE_RADIAL": (2, ("f", "cx", "cy", "k1")),
    "RADIAL": (3, ("f", "cx", "cy", "k1", "k2")),
    "OPENCV": (4, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
}
# Those that `Camera` cannot express, with how many parameters stand in the binary file.
_OTHERS = {
    5: ("OPENCV_FISHEYE", 8), 6: ("FULL_OPENCV", 12), 7: ("FOV", 5), 8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5), 10: ("THIN_PRISM_FISHEYE", 12), 11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4), 13: ("DIVISION", 5), 14: ("SIMPLE_FISHEYE", 3), 15: ("FISHEYE", 4),
    16: ("EUCM", 6), 17: ("EQUIRECTANGULAR", 2),
}  # fmt: skip
_BY_NUMBER = {number: (name, len(terms)) for name, (number, terms) in _MODELS.items()} | _OTHERS

_Lens = tuple[str, int, int, Sequence[float | str]]  # model, width, height, parameters
_Found = tuple[str, int, Sequence[float | str]]  # name, its camera's number, quaternion and shift
_Contents = tuple[dict[int, _Lens], list[_Found], list[list[float]]]


def rotation_of(wxyz: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a quaternion of any length but zero."""
    wxyz = wxyz / np.abs(wxyz).max()  # whose squares might not be numbers
    w, x, y, z = wxyz / np.linalg.norm(wxyz)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def quaternion_of(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 4"]:
    """Unit (w, x, y, z), w >= 0: eigenvector of Bar-Itzhack's matrix (2000), safe near half turns."""
    r = rotation
    matrix = np.array([
        [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
        [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
        [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1]],
    ])  # fmt: skip
    vector = np.linalg.eigh(matrix)[1][:, -1]
    return vector if vector[0] >= 0 else -vector


def _unsupported(path: Path, model: str) -> PoseError:
    return PoseError(
        f"{path}: camera model {model} is not supported (only {', '.join(_MODELS)}); run COLMAP with one of"
        " these, or undistort the images"
    )


def _camera(lenses: Mapping[int, _Lens], number: int, path: Path) -> Camera:
    if number not in lenses:
        raise ValueError(f"no camera has the number {number}")
    model, width, height, words = lenses[number]
    if model not in _MODELS:
        raise _unsupported(path, model)
    values, terms = [float(word) for word in words], _MODELS[model][1]
    if len(values) != len(terms):
        raise ValueError(f"{model} has {len(terms)} parameters, found {len(values)}")
    if not np.isfinite(values).all():
        raise ValueError("a camera parameter is not finite")
    named = dict(zip(terms, values, strict=True))
    focal = named.pop("f", None)
    if focal is not None:
        named |= {"fx": focal, "fy": focal}
    if not (named["fx"] > 0 and named["fy"] > 0 and width > 0 and height > 0):
        raise ValueError("a focal length or size is not positive")
    return Camera(width, height, **named)


def _pose(words: Sequence[float | str], name: str) -> Float[np.ndarray, "3 4"]:
    values = np.array([float(word) for word in words])
    if not np.isfinite(values).all() or not values[:4].any():
        raise ValueError(f"the quaternion of {name} is zero, or its pose is not finite")
    return np.column_stack([rotation_of(values[:4]), values[4:]])


def _lines(path: Path) -> Iterator[str]:
    lines = (line.strip() for line in text_of(path).split("\n"))
    return (line for line in lines if not line.startswith("#"))


# A feature is x, y and the number of its point; four of them tell. No image's line looks so, but of a name of numbers.
_FEATURES = re.compile(r"F{4}|F{0,3}$".replace("F", r"([-+.\deE]+\s+[-+.\deE]+\s+-?\d+(\s+|$))"))


def _images(lines: Iterator[str]) -> Iterator[_Found]:
    """An image's line is followed by one of its features, which may be empty; some programs leave that out."""
    after_image = False
    for line in lines:
        if after_image and _FEATURES.match(line):
            after_image = False
        elif line:
            words = line.split(maxsplit=9)
            if len(words) < 10:
                raise ValueError(f"images.txt has a line that is no image's: {line[:40]}")
            yield words[9], int(words[8]), words[1:8]
            after_image = True


def _read_text(folder: Path) -> _Contents:
    lenses: dict[int, _Lens] = {}
    for line in filter(None, _lines(folder / "cameras.txt")):
        number, model, width, height, *values = line.split()
        lenses[int(number)] = model, int(width), int(height), values
    points = folder / "points3D.txt"
    kept = filter(None, _lines(points)) if points.exists() else ()
    images = list(_images(_lines(folder / "images.txt")))
    return lenses, images, [[float(v) for v in line.split(maxsplit=4)[1:4]] for line in kept]


class _Bytes:
    """A cursor over a little-endian file; ValueError past the end."""

    def __init__(self, path: Path) -> None:
        self.data, self.at, self.name = path.read_bytes(), 0, path.name

    def take(self, form: str) -> tuple:
        begin = self.at
        self.skip(struct.calcsize("<" + form))
        return struct.unpack_from("<" + form, self.data, begin)

    def skip(self, count: int) -> None:
        self.at += count
        if self.at > len(self.data):
            raise ValueError(f"{self.name} ends too early")

    def text(self) -> str:
        begin, end = self.at, self.data.find(b"\0", self.at)
        self.skip(len(self.data) if end < 0 else end + 1 - begin)
        return self.data[begin:end].decode("utf-8", errors="replace")


def _read_binary(folder: Path) -> _Contents:
    source = _Bytes(folder / "cameras.bin")
    lenses: dict[int, _Lens] = {}
    for _ in range(source.take("Q")[0]):
        number, model, width, height = source.take("IiQQ")
        if model not in _BY_NUMBER:
            raise _unsupported(folder, f"number {model}")  # how long its entry is, nobody here knows
        name, count = _BY_NUMBER[model]
        lenses[number] = name, width, height, source.take(f"{count}d")
    source = _Bytes(folder / "images.bin")
    images: list[_Found] = []
    for _ in range(source.take("Q")[0]):
        _, *values, camera = source.take("I7dI")
        images.append((source.text(), camera, values))
        source.skip(24 * source.take("Q")[0])
    points: list[list[float]] = []
    if (folder / "points3D.bin").exists():
        source = _Bytes(folder / "points3D.bin")
        for _ in range(source.take("Q")[0]):
            points.append(list(source.take("Q3d3Bd")[1:4]))
            source.skip(8 * source.take("Q")[0])
    return lenses, images, points


def _find(folder: Path) -> tuple[Path, str]:
    for place in (folder, folder / "sparse" / "0", folder / "sparse", folder / "0"):
        for suffix in ("bin", "txt"):
            if (place / f"cameras.{suffix}").exists() and (place / f"images.{suffix}").exists():
                return place, suffix
    raise PoseError(
        f"{folder}: no COLMAP model in it (cameras and images, .txt or .bin); give the folder of one model,"
        " such as sparse/0"
    )


def read(folder: Path) -> Listed:
    """The images and points of the model in `folder`, or in its sparse/0.

    Raises:
        PoseError: no model there. What a damaged one raises is Python's.
    """
    place, suffix = _find(folder)
    lenses, images, points = _read_binary(place) if suffix == "bin" else _read_text(place)
    cloud = np.array(points, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(cloud).all():
        raise ValueError("a point is not finite")
    listed = (
        Image(name, partial(_camera, lenses, number, place), partial(_pose, values, name))
        for name, number, values in images
    )
    return Listed(tuple(listed), cloud, "given")


def write(
    folder: Path,
    camera: Camera,
    poses: Mapping[str, Float[np.ndarray, "3 4"]],
    points: Float[np.ndarray, "m 3"],
) -> None:
    """Files that COLMAP, pycolmap and the programs reading its models open; points have no tracks."""
    folder.mkdir(parents=True, exist_ok=True)
    number, terms = _MODELS["OPENCV"]
    values = [float(getattr(camera, term)) for term in terms]
    (folder / "cameras.bin").write_bytes(
        struct.pack("<QIiQQ8d", 1, 1, number, camera.width, camera.height, *values)
    )
    images = [
        struct.pack("<I7dI", i, *quaternion_of(pose[:, :3]), *pose[:, 3], 1) + name.encode() + bytes(9)
        for i, (name, pose) in enumerate(poses.items(), start=1)
    ]  # after the name its end, and no features
    (folder / "images.bin").write_bytes(struct.pack("<Q", len(images)) + b"".join(images))
    cloud = [
        struct.pack("<Q3d3BdQ", i, *point, *[128] * 3, 0.0, 0) for i, point in enumerate(points, start=1)
    ]
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", len(cloud)) + b"".join(cloud))
