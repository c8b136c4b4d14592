"""Folders of photographs to import, poses and a mask to go with them, and ways to break each."""

import dataclasses
import datetime
import json
import struct
from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR

from hardware.virtual import dng
from hardware.virtual.sensor import Sensor, bracket

WIDTH, HEIGHT, VIEWS = 48, 32, 8
START = datetime.datetime(2024, 5, 1, 10, 0, 0)

Breaking = Callable[[Path], None]


def scene(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    return np.random.default_rng(number).uniform(0.1, 2.0, (height, width, 3))


def write_exr(path: Path, image: np.ndarray) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(image, np.float32)}) as file:
        file.write(str(path))


def write_raw_view(folder: Path, number: int, radiance: np.ndarray, shutter_s: float = 0.01) -> None:
    rng = np.random.default_rng(number)
    start = START + datetime.timedelta(seconds=20 * number)
    for i, photograph in enumerate(bracket(radiance, shutter_s, Sensor(), start, rng)):
        dng.write(folder / f"IMG_{3 * number + i:04d}.DNG", photograph)


def write_raw(folder: Path) -> Path:
    """`VIEWS` brackets of three, IMG_0000.DNG to IMG_0023.DNG."""
    folder.mkdir()
    for number in range(VIEWS):
        write_raw_view(folder, number, scene(number))
    return folder


def tag(files: Iterable[Path], orientation: int) -> None:
    """Let DNG say that the camera was held so: the number of Exif's tag, 1 as they are written."""
    entry = struct.Struct("<HHII")
    for file in files:
        content = file.read_bytes()
        assert content.count(entry.pack(274, 3, 1, 1)) == 1
        file.write_bytes(content.replace(entry.pack(274, 3, 1, 1), entry.pack(274, 3, 1, orientation)))


def write_linear(folder: Path) -> Path:
    """`VIEWS` images, 0000.exr to 0007.exr."""
    folder.mkdir()
    for number in range(VIEWS):
        write_exr(folder / f"{number:04d}.exr", scene(number))
    return folder


def write_poses(path: Path, count: int = VIEWS, stretch: float = 1.0, name: str = "{:04d}.exr") -> Path:
    matrix = np.eye(4)
    matrix[0, 0] = stretch
    frames = [{"file_path": name.format(i), "transform_matrix": matrix.tolist()} for i in range(count)]
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": 50, "fl_y": 50, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    path.write_text(json.dumps({**lens, "frames": frames}))
    return path


def write_mask(path: Path, width: int = WIDTH, height: int = HEIGHT, white: bool = True) -> Path:
    mask = np.zeros((height, width), np.uint8)
    mask[8:20, 10:30] = 255 if white else 0
    cv2.imwrite(str(path), mask)
    return path


def emptied(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def truncated(folder: Path) -> None:
    path = folder / "IMG_0007.DNG"
    path.write_bytes(path.read_bytes()[:-500])


def truncated_beside_a_gap(folder: Path) -> None:
    """What came of a card that was pulled: the last file is cut, and one is missing."""
    truncated(folder)
    incomplete(folder)


def filled(content: bytes) -> Breaking:
    def breaking(folder: Path) -> None:
        (folder / "IMG_0004.DNG").write_bytes(content)

    return breaking


def other_camera(folder: Path) -> None:
    photograph = bracket(scene(4), 0.01, Sensor(), START, np.random.default_rng(0))[0]
    dng.write(folder / "IMG_0012.DNG", dataclasses.replace(photograph, model="Roomlight Virtual Two"))


def other_size(folder: Path) -> None:
    write_raw_view(folder, VIEWS, scene(0, WIDTH + 2))


def incomplete(folder: Path) -> None:
    (folder / "IMG_0010.DNG").unlink()


def clipped(folder: Path) -> None:
    write_raw_view(folder, VIEWS, np.full((HEIGHT, WIDTH, 3), 1e5))


def few(folder: Path) -> None:
    for path in sorted(folder.iterdir())[15:]:
        path.unlink()


def mixed(folder: Path) -> None:
    write_exr(folder / "render.exr", scene(0))


def poisoned(value: float) -> Breaking:
    def breaking(folder: Path) -> None:
        image = scene(3)
        image[5, 7, 1] = value
        write_exr(folder / "0003.exr", image)

    return breaking


def other_image(folder: Path) -> None:
    write_exr(folder / "0005.exr", scene(0, 20, 20))


def cut_image(folder: Path) -> None:
    (folder / "0002.exr").write_bytes(b"v/1\x01")
