"""Open3D's renderer: every point at its pixel and depth, whatever windows come and go.

In a process of its own, as in the application: a renderer that aborts must not take the tests with it.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
CODE = """
import json, os, sys
from app import cores
cores.leave_out_plots()
import numpy as np
from app.viewer.canvas import Eye, NoGraphics
from app.viewer.canvas_opengl import OpenGLCanvas
from app.viewer.parts import Lines, Triangles

try:
    canvas = OpenGLCanvas()
except NoGraphics as error:
    print(json.dumps({"none": error.remedy})); sys.stdout.flush(); os._exit(0)

def square(x, y, z, half, colour, lit=False):
    corners = np.array([[x - half, y - half, z], [x + half, y - half, z], [x + half, y + half, z], [x - half, y + half, z]])
    normals = np.tile([0.0, 0.0, -1.0], (4, 1)) if lit else None
    return Triangles(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.tile(np.uint8(colour), (4, 1)), normals)

def seen(level, width, height, pose=np.eye(3, 4)):
    colour, depth = canvas.draw(level, Eye(pose, height * 1.0, width, height, 0.01, 100.0))
    rows, columns = np.nonzero(depth)
    middle = colour[rows, columns].mean(0) if len(rows) else [0, 0, 0]
    box = [int(v) for v in (columns.min(), columns.max(), rows.min(), rows.max())] if len(rows) else []
    return {"shape": colour.shape, "box": box, "colour": [round(float(c), 2) for c in middle],
            "depth": round(float(depth.max()), 4)}

said = {}
red, green = square(1.0, -0.25, 4.0, 0.5, (255, 0, 0)), square(0, 0, 2.0, 0.5, (0, 255, 0))
canvas.show(0, {"red": red}); canvas.show(1, {"green": green})
said["red"] = seen(0, 160, 120)
said["green, half the size"] = seen(1, 80, 60)
said["red again"] = seen(0, 160, 120)
said["green, another size"] = seen(1, 40, 30)
said["red after that"] = seen(0, 160, 120)
said["red, resized"] = seen(0, 200, 100)
said["green after that"] = seen(1, 80, 60)
canvas.show(0, {"red": red, "green": green})
said["both"] = seen(0, 160, 120)
canvas.show(0, {"green": green})
said["red gone"] = seen(0, 160, 120)
moved = np.eye(3, 4); moved[2, 3] = 2.0
said["from further back"] = seen(0, 160, 120, moved)
canvas.show(0, {"line": Lines(np.array([[-1.0, 0, 3], [1, 0, 3]]), np.array([[0, 1]]), np.uint8([[0, 0, 255]]))})
said["line"] = seen(0, 160, 120)
canvas.show(0, {})
said["nothing"] = seen(0, 160, 120)
said["loaded in vain"] = {"names": sorted({"dash", "plotly"} & set(sys.modules))}
canvas.show(0, {"lit": square(0, 0, 2.0, 0.5, (200, 200, 200), True)})
said["lit"] = seen(0, 160, 120)
from app.viewer.canvas_opengl import MOST_WINDOWS
for k in range(2 * MOST_WINDOWS):
    seen(1, 32 + k, 24)
said["windows"] = {"few": len(canvas._windows) <= MOST_WINDOWS}
print(json.dumps(said)); sys.stdout.flush(); os._exit(0)
"""


def run(**environment: str) -> dict[str, dict]:
    kept = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=ROOT, env={**kept, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def seen() -> dict[str, dict]:
    found = run()
    if "none" in found:
        pytest.skip("no OpenGL on this machine")
    return found


RED = {"shape": [120, 160, 3], "box": [95, 124, 37, 66], "colour": [1.0, 0.0, 0.0], "depth": 4.0}
GREEN = {"shape": [60, 80, 3], "box": [25, 54, 15, 44], "colour": [0.0, 1.0, 0.0], "depth": 2.0}


def test_a_square_is_at_its_pixels_and_depth(seen: dict[str, dict]) -> None:
    """Focal 120, centre (80, 60): x from 80 + 15 to 80 + 45, y from 60 - 0.75 * 30 to 60 + 0.25 * 30."""
    left, right, top, low = seen["red"]["box"]
    assert abs(left - 95) <= 1
    assert abs(right - 124) <= 1
    assert abs(top - 37) <= 1
    assert abs(low - 67) <= 1
    assert seen["red"]["depth"] == pytest.approx(4.0, rel=1e-3)
    assert seen["red"]["colour"] == RED["colour"]


def test_each_level_has_parts_of_its_own(seen: dict[str, dict]) -> None:
    assert seen["green, half the size"]["colour"] == GREEN["colour"]
    assert seen["green, half the size"]["shape"] == GREEN["shape"]


@pytest.mark.parametrize("name", ["red again", "red after that"])
def test_other_windows_coming_and_going_change_nothing(seen: dict[str, dict], name: str) -> None:
    assert seen[name] == seen["red"]


def test_pictures_of_another_size_are_whole(seen: dict[str, dict]) -> None:
    assert seen["red, resized"]["shape"] == [100, 200, 3]
    assert seen["red, resized"]["colour"] == RED["colour"]
    assert seen["green after that"] == seen["green, half the size"]


def test_windows_of_sizes_that_are_gone_are_closed(seen: dict[str, dict]) -> None:
    assert seen["windows"]["few"]


def test_parts_are_hidden_when_they_are_no_longer_shown(seen: dict[str, dict]) -> None:
    assert seen["both"]["depth"] == pytest.approx(4.0, rel=1e-3)
    assert 0 < seen["both"]["colour"][0] < seen["both"]["colour"][1]  # red peeps out from behind
    assert seen["red gone"]["colour"] == GREEN["colour"]
    assert (seen["nothing"]["box"], seen["nothing"]["depth"]) == ([], 0.0)
    assert seen["loaded in vain"]["names"] == []


def test_the_eye_moves(seen: dict[str, dict]) -> None:
    assert seen["from further back"]["depth"] == pytest.approx(4.0, rel=1e-3)


def test_lines_have_their_colour(seen: dict[str, dict]) -> None:
    assert seen["line"]["colour"] == [0.0, 0.0, 1.0]


def test_a_lit_square_that_faces_the_eye_is_light(seen: dict[str, dict]) -> None:
    assert 0.5 < min(seen["lit"]["colour"]) <= max(seen["lit"]["colour"]) <= 1.0


def test_without_opengl_the_remedy_is_said() -> None:
    found = run(__EGL_VENDOR_LIBRARY_FILENAMES="/nonexistent.json")
    assert "install" in str(found.get("none"))
