"""Filament, Open3D's newer renderer, where a graphics card speaks Vulkan.

One renderer for the life of the process: a second one, even after the first has gone, hung for minutes or ended the
process here (Open3D 0.20 on a renderer in software). So it has one large size; smaller pictures are its upper left
corner, and larger ones come out smaller for the window to enlarge. No anti-aliasing and no post-processing:
the first hung too, the second would change colours.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import open3d
from open3d.visualization import rendering

from app.viewer.canvas import Eye, NoGraphics, Picture
from app.viewer.parts import Lines, Part

SIZE = (2560, 1600)
LINE_PX = 1.4
_KEY = (0.35, 0.4, 1.0)  # where light goes: right, down, forward, as the eye has them
_KEY_LUX, _AROUND_LUX = 95_000.0, 22_000.0


class FilamentCanvas:
    """See Canvas."""

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        """
        Raises:
            NoGraphics: Vulkan does not start.
        """
        open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
        self._size = size
        try:
            self._renderer: Any = rendering.OffscreenRenderer(*size)
        except RuntimeError as error:
            raise NoGraphics(
                f"Filament does not start ({error})", "update the driver of the graphics card, then try again"
            ) from error
        self._scene: Any = self._renderer.scene
        self._scene.set_background(np.array([0.0, 0.0, 0.0, 1.0], np.float32))
        self._scene.view.set_post_processing(False)
        # Filament takes one directional light; what comes from all around fills its shadows.
        self._scene.scene.enable_sun_light(True)
        self._scene.scene.enable_indirect_light(True)
        self._scene.scene.set_indirect_light_intensity(_AROUND_LUX)
        self._wanted: dict[int, Mapping[str, Part]] = {}
        self._shown: dict[str, Part] = {}
        self.name = "Filament"

    def show(self, level: int, parts: Mapping[str, Part]) -> None:
        self._wanted[level] = dict(parts)

    def draw(self, level: int, eye: Eye) -> Picture:
        self._send(level)
        # The picture asked for is the upper left corner of a larger one.
        shrink = max(eye.width / self._size[0], eye.height / self._size[1], 1.0)
        width, height = int(eye.width / shrink), int(eye.height / shrink)
        focal = eye.focal / shrink
        lens = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        camera = self._scene.camera
        camera.set_projection(lens, eye.near, eye.far, *map(float, self._size))
        axes = eye.cam_from_world[:, :3]
        place = -axes.T @ eye.cam_from_world[:, 3]
        ahead = place + axes[2] * max(eye.near, 1e-3) * 10
        camera.look_at(*(vector.astype(np.float32) for vector in (ahead, place, -axes[1])))
        key = (np.array(_KEY) @ axes).astype(np.float32)
        self._scene.scene.set_sun_light(key, np.ones(3, np.float32), _KEY_LUX)
        colour = np.asarray(self._renderer.render_to_image())[:height, :width]
        depth = np.asarray(self._renderer.render_to_depth_image(z_in_view_space=True))[:height, :width]
        return _enlarged(colour.astype(np.float32) / 255, eye), _enlarged(
            np.where(np.isfinite(depth), depth, 0).astype(np.float32), eye
        )

    def _send(self, level: int) -> None:
        """Bring the level's parts up to date, show them and hide the other levels'."""
        wanted = {f"{level}/{name}": part for name, part in self._wanted.get(level, {}).items()}
        for name in list(self._shown):
            own = name.startswith(f"{level}/")
            if own and wanted.get(name) is not self._shown[name]:
                self._scene.remove_geometry(name)
                del self._shown[name]
            else:
                self._scene.show_geometry(name, own)
        for name, part in wanted.items():
            if name not in self._shown and len(part.points):
                self._scene.add_geometry(name, *_geometry(part))
                self._shown[name] = part


def _geometry(part: Part) -> tuple[Any, Any]:
    """Shape and material."""
    vector = open3d.utility.Vector3dVector
    points, colours = vector(np.ascontiguousarray(part.points, np.float64)), vector(part.colours / 255.0)
    material = rendering.MaterialRecord()
    if isinstance(part, Lines):
        lines = open3d.geometry.LineSet(points, open3d.utility.Vector2iVector(part.pairs.astype(np.int32)))
        lines.colors = colours
        material.shader, material.line_width = "unlitLine", LINE_PX
        return lines, material
    made = open3d.geometry.TriangleMesh(
        points, open3d.utility.Vector3iVector(part.triangles.astype(np.int32))
    )
    made.vertex_colors = colours
    material.shader = "defaultUnlit"
    if part.normals is not None:
        made.vertex_normals = vector(np.ascontiguousarray(part.normals, np.float64))
        material.shader, material.base_roughness = "defaultLit", 0.6
    return made, material


def _enlarged(picture: np.ndarray, eye: Eye) -> np.ndarray:
    """To the size that was asked for."""
    if picture.shape[:2] == (eye.height, eye.width):
        return np.ascontiguousarray(picture)
    import cv2

    return cv2.resize(picture, (eye.width, eye.height), interpolation=cv2.INTER_NEAREST)
