"""transforms.json of nerfstudio and instant-ngp: reads and writes it.

Source: https://docs.nerf.studio/quickstart/data_conventions.html. Their poses are world_from_cam with
OpenGL's camera axes; they are turned into cam_from_world with ours here, and back.
"""

import json
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from engine.errors import PoseError
from engine.geometry import inverse, opencv_from_opengl
from engine.io.poses.pose_list import Image, Listed, affine, folded_lens
from engine.types import Camera, Poses

UNREADABLE = "not a transforms.json ({}); it needs a list `frames` of file_path and transform_matrix (4 x 4)"
MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")


def _number(table: Mapping[str, Any], key: str, default: float, path: Path) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PoseError(f"{path}: {key} is {value!r}, not a number; export the file again")
    return float(value)


def _intrinsics(table: Mapping[str, Any], size: tuple[int, int], path: Path) -> Camera:
    def get(key: str, default: float) -> float:
        return _number(table, key, default, path)

    model = "fisheye" if table.get("is_fisheye") else table.get("camera_model", "OPENCV")
    if model not in MODELS:
        raise PoseError(f"{path}: camera model {model} is not supported; undistort to a pinhole first")
    width, height = round(get("w", float(size[0]))), round(get("h", float(size[1])))

    def seen_under(key: str, pixels: int) -> float:
        angle = get(key, 0.0)
        if not 0 < angle < math.pi:
            raise PoseError(
                f"{path}: {key} is {angle:g}; it must lie between 0 and pi: export the file again"
            )
        return pixels / 2 / math.tan(angle / 2)

    fx = get("fl_x", 0.0)
    if fx == 0 and "camera_angle_x" in table:
        fx = seen_under("camera_angle_x", width)
    fy = get("fl_y", 0.0)
    if fy == 0 and "fl_x" not in table and "camera_angle_y" in table:
        fy = seen_under("camera_angle_y", height)
    fy = fy or fx
    if not (fx > 0 and fy > 0 and width > 0 and height > 0):
        raise PoseError(f"{path}: no focal length (fl_x or camera_angle_x) or no size (w, h); add them")
    camera = Camera(
        width, height, fx, fy, get("cx", width / 2), get("cy", height / 2),
        p1=get("p1", 0.0), p2=get("p2", 0.0),
    )  # fmt: skip
    return folded_lens(camera, [get(f"k{i}", 0.0) for i in (1, 2, 3, 4)], 0.0, str(path))


def _pose(frame: Mapping[str, Any]) -> Float[np.ndarray, "3 4"]:
    matrix = affine(frame["transform_matrix"], str(frame["file_path"]))
    return inverse(np.concatenate([matrix[:, :3] @ opencv_from_opengl, matrix[:, 3:]], axis=1))


def read(path: Path, size: tuple[int, int]) -> Listed:
    """The frames; `size` (width, height) stands in where the file gives none."""
    table = json.loads(path.read_bytes())
    # nerfstudio may repeat the intrinsics in each frame. A frame that names no file belongs to no photograph.
    images = tuple(
        Image(str(frame["file_path"]), partial(_intrinsics, {**table, **frame}, size, path), partial(_pose, frame))
        for frame in table["frames"]
        if isinstance(frame, dict) and "file_path" in frame
    )  # fmt: skip
    return Listed(images, np.zeros((0, 3)), "given")


def write(path: Path, poses: Poses, names: Sequence[str]) -> None:
    """Registered views as transforms.json that nerfstudio and instant-ngp read; `names` become file_path."""
    camera = poses.camera
    frames = []
    for name, cam_from_world, registered in zip(names, poses.cam_from_world, poses.registered, strict=True):
        if registered:
            matrix = np.eye(4)
            matrix[:3] = inverse(cam_from_world)
            matrix[:3, :3] = matrix[:3, :3] @ opencv_from_opengl
            frames.append({"file_path": name, "transform_matrix": matrix.tolist()})
    table = {
        "camera_model": "OPENCV", "w": camera.width, "h": camera.height,
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
        "camera_angle_x": 2 * math.atan(camera.width / 2 / camera.fx),
        "camera_angle_y": 2 * math.atan(camera.height / 2 / camera.fy),
        "k1": camera.k1, "k2": camera.k2, "p1": camera.p1, "p2": camera.p2,
        "frames": frames,
    }  # fmt: skip
    path.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
