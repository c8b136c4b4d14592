"""Open3D's older renderer through EGL: needs no screen and no graphics card.

One window for each level and size: each has its own OpenGL context, so that going from the coarse to the full set of
parts sends nothing again. Closing one makes all others draw nothing (seen with Open3D 0.20 and Mesa 22.3:
it ends their common connection to EGL), so they are closed together.
"""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import open3d

from app.viewer.canvas import Eye, NoGraphics, Picture
from app.viewer.parts import Lines, Part

_LIGHTS = {  # positions: right, up, towards the eye, in sizes of the scene
    "light_ambient_color": [0.32, 0.33, 0.35],
    "light0_position": [-1.2, 1.6, 1.6], "light0_color": [1.0, 0.98, 0.95],
    "light0_diffuse_power": 0.80, "light0_specular_power": 0.10, "light0_specular_shininess": 24.0,
    "light1_position": [1.8, 0.3, 1.0], "light1_color": [0.86, 0.92, 1.0],
    "light1_diffuse_power": 0.30, "light1_specular_power": 0.04, "light1_specular_shininess": 16.0,
    "light2_position": [0.2, -1.6, 0.6], "light2_diffuse_power": 0.08, "light2_specular_power": 0.0,
    "light3_position": [-0.2, 0.6, -2.0], "light3_diffuse_power": 0.10, "light3_specular_power": 0.0,
}  # fmt: skip


MOST_WINDOWS = 10


@dataclass(slots=True)
class _Window:
    visualizer: Any
    shown: dict[str, tuple[Part, Any]] = field(default_factory=dict)


class OpenGLCanvas:
    """See Canvas."""

    def __init__(self) -> None:
        """
        Raises:
            NoGraphics: there is no OpenGL.
        """
        open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
        self._windows: dict[tuple[int, int, int], _Window] = {}  # by level, width and height
        self._wanted: dict[int, Mapping[str, Part]] = {}
        self._window(0, 64, 48)
        self.name = "OpenGL"

    def show(self, level: int, parts: Mapping[str, Part]) -> None:
        self._wanted[level] = dict(parts)

    def draw(self, level: int, eye: Eye) -> Picture:
        window = self._window(level, eye.width, eye.height)
        self._send(window, self._wanted.get(level, {}))
        control = window.visualizer.get_view_control()
        pinhole = open3d.camera.PinholeCameraParameters()
        pinhole.intrinsic = open3d.camera.PinholeCameraIntrinsic(
            eye.width, eye.height, eye.focal, eye.focal, eye.width / 2 - 0.5, eye.height / 2 - 0.5
        )
        pinhole.extrinsic = np.concatenate([eye.cam_from_world, [[0.0, 0.0, 0.0, 1.0]]])
        control.convert_from_pinhole_camera_parameters(pinhole, True)
        control.set_constant_z_near(eye.near)
        control.set_constant_z_far(eye.far)
        # Asking for the depth draws; the colours are those of the same drawing. The other way round draws twice,
        # since a picture that was shown has lost its depth.
        depth = np.array(window.visualizer.capture_depth_float_buffer(True))
        colour = np.asarray(window.visualizer.capture_screen_float_buffer(False))
        return colour, depth

    def _window(self, level: int, width: int, height: int) -> _Window:
        known = self._windows.get((level, width, height))
        if known is not None:
            return known
        # A full picture of another size: those of the old one will not be wanted again.
        if level == 0 or len(self._windows) >= MOST_WINDOWS:
            for window in self._windows.values():
                window.visualizer.destroy_window()
            self._windows.clear()
        made = open3d.visualization.Visualizer()
        if not made.create_window("roomlight", width, height, visible=False):
            raise NoGraphics(
                "there is no OpenGL on this machine",
                "install the driver of your graphics card, or Mesa's (Debian, Ubuntu: sudo apt install libegl1"
                " libgl1-mesa-dri), then try again",
            )
        _dress(made.get_render_option())
        window = self._windows[(level, width, height)] = _Window(made)
        return window

    def _send(self, window: _Window, parts: Mapping[str, Part]) -> None:
        for name in [name for name, (part, _) in window.shown.items() if parts.get(name) is not part]:
            window.visualizer.remove_geometry(window.shown.pop(name)[1], False)
        for name, part in parts.items():
            if name not in window.shown and len(part.points):
                geometry = _geometry(part)
                window.visualizer.add_geometry(geometry, not window.shown)
                window.shown[name] = (part, geometry)


def _geometry(part: Part) -> Any:
    vector = open3d.utility.Vector3dVector
    points = vector(np.ascontiguousarray(part.points, np.float64))
    colours = vector(part.colours / 255.0)
    if isinstance(part, Lines):
        lines = open3d.geometry.LineSet(points, open3d.utility.Vector2iVector(part.pairs.astype(np.int32)))
        lines.colors = colours
        return lines
    made = open3d.geometry.TriangleMesh(
        points, open3d.utility.Vector3iVector(part.triangles.astype(np.int32))
    )
    made.vertex_colors = colours
    if part.normals is not None:
        made.vertex_normals = vector(np.ascontiguousarray(part.normals, np.float64))
        made.compute_triangle_normals()  # without them the renderer does not shade at all
    return made


def _dress(option: Any) -> None:
    """Soft light from the upper left, which only a file can ask for."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "options.json"
        option.save_to_json(str(path))
        path.write_text(json.dumps(json.loads(path.read_text()) | _LIGHTS))
        option.load_from_json(str(path))
    option.mesh_show_back_face = True
    option.background_color = np.zeros(3)
