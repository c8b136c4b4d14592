"""COLMAP's sparse model on disk: reads text and binary, writes text.

Source: COLMAP's documented output format (https://colmap.github.io/format.html). Its frames and pixel
centres are ours: cam_from_world with x right, y down, z forward, first pixel centred on (0.5, 0.5).
pycolmap is not used to read: it ends the process on a damaged file, and we owe a message.
"""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.types import Camera

FILES = ("cameras.txt", "images.txt", "points3D.txt", "cameras.bin", "images.bin", "points3D.bin")

# Model name, COLMAP's number of it, and what its parameters are in order.
_MODELS = {
    "SIMPLE_PINHOLE": (0, ("f", "cx", "cy")),
    "PINHOLE": (1, ("fx", "fy", "cx", "cy")),
    "SIMPLE_RADIAL": (2, ("f", "cx", "cy", "k1")),
    "RADIAL": (3, ("f", "cx", "cy", "k1", "k2")),
    "OPENCV": (4, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
}
_BY_NUMBER = {number: name for name, (number, _) in _MODELS.items()}


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """One camera, the registered images by name, and the sparse points."""

    camera: Camera
    poses: Mapping[str, Float[np.ndarray, "3 4"]]
    points: Float[np.ndarray, "m 3"]


_Contents = tuple[dict[int, Camera], dict[str, tuple[int, np.ndarray]], list[list[float]]]


def rotation_of(wxyz: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a quaternion, which need not be of unit length."""
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


def _camera(model: str, width: int, height: int, values: list[float], path: Path) -> Camera:
    if model not in _MODELS:
        raise PoseError(
            f"{path}: camera model {model} is not supported (only {', '.join(_MODELS)}); run COLMAP with one"
            " of these, or undistort the images"
        )
    terms = _MODELS[model][1]
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


def _pose(values: list[float], name: str) -> Float[np.ndarray, "3 4"]:
    wxyz, shift = np.array(values[:4]), np.array(values[4:7])
    if not np.isfinite(values).all() or abs(np.linalg.norm(wxyz) - 1) > 1e-3:
        raise ValueError(f"the quaternion of {name} is not of unit length, or not finite")
    return np.column_stack([rotation_of(wxyz), shift])


def _lines(path: Path) -> Iterator[str]:
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            yield line.strip()


def _read_text(folder: Path) -> _Contents:
    cameras = {}
    for line in filter(None, _lines(folder / "cameras.txt")):
        number, model, width, height, *values = line.split()
        cameras[int(number)] = _camera(model, int(width), int(height), [float(v) for v in values], folder)
    images = {}
    # Two lines an image; the second lists its features and may be empty, so empty lines count.
    lines = list(_lines(folder / "images.txt"))
    while lines and not lines[0]:
        lines.pop(0)
    for line in lines[::2]:
        if line:
            _, *values, camera, name = line.split(maxsplit=9)
            images[name] = (int(camera), _pose([float(v) for v in values], name))
    points = folder / "points3D.txt"
    kept = filter(None, _lines(points)) if points.exists() else ()
    return cameras, images, [[float(v) for v in line.split()[1:4]] for line in kept]


class _Bytes:
    """A cursor over a little-endian file; struct.error past the end."""

    def __init__(self, path: Path) -> None:
        self.data, self.at = path.read_bytes(), 0

    def take(self, form: str) -> tuple:
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values

    def skip(self, count: int) -> None:
        self.at += count
        if self.at > len(self.data):
            raise ValueError("the file ends too early")

    def text(self) -> str:
        end = self.data.index(b"\0", self.at)
        value, self.at = self.data[self.at : end].decode("utf-8"), end + 1
        return value


def _read_binary(folder: Path) -> _Contents:
    source = _Bytes(folder / "cameras.bin")
    cameras = {}
    for _ in range(source.take("Q")[0]):
        number, model, width, height = source.take("IiQQ")
        name = _BY_NUMBER.get(model, f"number {model}")
        values = list(source.take(f"{len(_MODELS[name][1])}d")) if name in _MODELS else []
        cameras[number] = _camera(name, width, height, values, folder)
    source = _Bytes(folder / "images.bin")
    images = {}
    for _ in range(source.take("Q")[0]):
        _, *values, camera = source.take("I7dI")
        name = source.text()
        images[name] = (camera, _pose(values, name))
        source.skip(24 * source.take("Q")[0])
    points: list[list[float]] = []
    if (folder / "points3D.bin").exists():
        source = _Bytes(folder / "points3D.bin")
        for _ in range(source.take("Q")[0]):
            points.append(list(source.take("Q3d3Bd")[1:4]))
            source.skip(8 * source.take("Q")[0])
    return cameras, images, points


def _find(folder: Path) -> tuple[Path, str]:
    for place in (folder, folder / "sparse" / "0", folder / "sparse", folder / "0"):
        for suffix in ("bin", "txt"):
            if (place / f"cameras.{suffix}").exists() and (place / f"images.{suffix}").exists():
                return place, suffix
    raise PoseError(
        f"{folder}: no COLMAP model in it (cameras and images, .txt or .bin); give the folder of one model,"
        " such as sparse/0"
    )


def read(folder: Path) -> Model:
    """The model in `folder`, or in its sparse/0.

    Raises:
        PoseError: no model there, a damaged one, an unsupported lens, or more than one camera in use.
    """
    place, suffix = _find(folder)
    try:
        cameras, images, points = _read_binary(place) if suffix == "bin" else _read_text(place)
        used = {cameras[number] for number, _ in images.values()}
    except (OSError, ValueError, KeyError, TypeError, struct.error) as error:
        raise PoseError(
            f"{place}: the COLMAP model cannot be read ({type(error).__name__}: {error}); export it again"
        ) from error
    if len(used) != 1:
        raise PoseError(
            f"{place}: {len(used)} cameras are in use; a session is photographed with one: run COLMAP with"
            " --ImageReader.single_camera 1"
        )
    return Model(used.pop(), {k: pose for k, (_, pose) in images.items()}, np.array(points).reshape(-1, 3))


def write(folder: Path, model: Model) -> None:
    """Text files that COLMAP, pycolmap and the programs reading its models open; points have no tracks."""
    folder.mkdir(parents=True, exist_ok=True)
    camera = model.camera
    terms = " ".join(repr(float(getattr(camera, term))) for term in _MODELS["OPENCV"][1])
    (folder / "cameras.txt").write_text(
        f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n1 OPENCV {camera.width} {camera.height} {terms}\n"
    )
    with (folder / "images.txt").open("w", encoding="utf-8") as out:
        out.write("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of features\n")
        for number, (name, pose) in enumerate(model.poses.items(), start=1):
            values = [*quaternion_of(pose[:, :3]), *pose[:, 3]]
            out.write(f"{number} {' '.join(repr(float(v)) for v in values)} 1 {name}\n\n")
    with (folder / "points3D.txt").open("w", encoding="utf-8") as out:
        out.write("# POINT3D_ID X Y Z R G B ERROR TRACK\n")
        for number, point in enumerate(model.points, start=1):
            out.write(f"{number} {' '.join(repr(float(v)) for v in point)} 128 128 128 0\n")
