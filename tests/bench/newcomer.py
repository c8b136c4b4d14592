"""A newcomer's two paths through the window, by its buttons alone; prints what each step took, beside what it may take.

    python -m tests.bench.newcomer [--demo | --capture] [--poses 12] [--camera URL]

Open demo, maps, 3D, relight, export for Blender, and the GLB as trimesh reads it; then, from an empty window, a capture in
the virtual studio that ships, its draft, and the report. Settings, cache and sessions are of an empty folder; kernels are
this person's, as `roomlight set-up` compiled them.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import trimesh
from PySide6.QtWidgets import QFileDialog

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from app import cores
from app.views.capture.page import CapturePage
from app.views.export.page import ExportPage
from app.views.main_window import MainWindow
from app.views.maps.page import MapsPage
from app.views.process.page import ProcessPage
from app.views.relight.page import RelightPage
from app.views.start.page import StartPage
from app.views.view3d.page import View3dPage
from tests.bench import gui_start
from tests.end_to_end import windowed
from tests.end_to_end.windowed import until

LIMITS_S = {"session opened: planned": 0.3, "3D: first picture": 4.0, "test shot": 5.0}


@contextmanager
def step(name: str) -> Iterator[None]:
    """Time it."""
    start, worked = time.monotonic(), windowed.worked_s()
    yield
    limit = f"  (limit {LIMITS_S[name]:.1f} s)" if name in LIMITS_S else ""
    took, core = time.monotonic() - start, windowed.worked_s() - worked
    print(f"{name:28} {took:7.2f} s, {core:6.1f} s of a core{limit}", flush=True)


def to_page(window: MainWindow, key: str, kind: type[windowed.Page]) -> windowed.Page:
    """By the rail."""
    window.rail.buttons[key].click()
    shown = window.stack.currentWidget()
    assert isinstance(shown, kind)
    return shown


def demo(window: MainWindow, scratch: Path) -> None:
    """From the start page to a mesh in another program."""
    start = window.stack.currentWidget()
    assert isinstance(start, StartPage)
    with step("open demo: maps"):
        start.demo.click()
        until(lambda: isinstance(window.stack.currentWidget(), MapsPage), "the maps page")
        maps = window.stack.currentWidget()
        assert isinstance(maps, MapsPage)
        for layer in ("normal", "albedo"):
            windowed.map_of(maps, layer)
    with step("3D: first picture"):
        view = to_page(window, "view3d", View3dPage)
        until(lambda: view.canvas.picture is not None, "a picture")
    with step("3D: as good as it gets"):
        assert not windowed.is_blank(windowed.scene_of(view))
    with step("relight"):
        relight = to_page(window, "relight", RelightPage)
        until(lambda: relight.canvas.image is not None, "the object relit")
        relight.controls.yaw.setValue(40)
    with step("export for Blender"):
        export = to_page(window, "export", ExportPage)
        export.target.setCurrentIndex(export.target.findData("blender"))
        until(lambda: export.state.text().startswith("up to date"), "the files are made")
        export.target.activated.emit(export.target.currentIndex())
        export.to.setText(str(scratch / "blender"))
        export.go.click()
        until(lambda: not export.errand.busy and (scratch / "blender").is_dir(), "the export")
    with step("GLB in trimesh"):
        mesh = trimesh.load(scratch / "blender" / "surface.glb", force="mesh")
        assert isinstance(mesh, trimesh.Trimesh)
        material = mesh.visual.material  # type: ignore[union-attr]
        textures = [material.baseColorTexture, material.normalTexture]
        sizes = ", ".join(f"{texture.width} x {texture.height}" for texture in textures)
    print(
        f"{len(mesh.vertices)} vertices, {len(mesh.faces)} triangles, {mesh.extents} m, colour and normals {sizes}"
    )


def capture(window: MainWindow, scratch: Path, poses: int, camera: str) -> None:
    """From the start page to a report of one's own capture."""
    start = window.page("start")
    assert isinstance(start, StartPage)
    start.new_capture.click()
    page = window.stack.currentWidget()
    assert isinstance(page, CapturePage)
    devices = page.setup.devices
    with step("connect"):
        windowed.connect(page, devices.urls[0], camera or devices.urls[1])
    with step("test shot"):
        page.setup.bracket.preview.click()
        until(lambda: page.scene.picture.image is not None, "the first photograph")
    with step(f"capture of {poses} poses"):
        windowed.choose_plan(page, "suited", poses)
        windowed.start(page, scratch / "mine.session")
        state = windowed.finished(page)
        assert state.ended is not None
        assert (state.ended.taken, state.ended.trouble) == (poses, None), state.ended
    with step("draft"):
        windowed.pressed(page.banner, "Process")
        process = window.stack.currentWidget()
        assert isinstance(process, ProcessPage)
        windowed.configure(process, {}, "draft")
        windowed.processed(process)
    with step("report"):
        window.rail.buttons["export"].click()
        export = window.stack.currentWidget()
        assert isinstance(export, ExportPage)
        until(lambda: export.state.text().startswith("up to date"), "the export page knows")
        to = scratch / "report.html"
        QFileDialog.getSaveFileName = staticmethod(lambda *words, **named: (str(to), ""))  # type: ignore[method-assign]
        export.report.click()
        until(lambda: not export.errand.busy and to.is_file(), "the report")
    print(f"report of {to.stat().st_size / 1e6:.1f} MB")


def planned(window: MainWindow, scratch: Path) -> None:
    """A session that was there before is opened once more."""
    session = window.shell.state.session.value
    assert session is not None
    window.close_session()
    with step("session opened: planned"):
        window.go_to_session(session)
        process = window.page("process")
        assert isinstance(process, ProcessPage)
        windowed.planned(process)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--demo", action="store_true", help="the first path alone")
    only.add_argument("--capture", action="store_true", help="the second")
    parser.add_argument("--poses", type=int, default=12)
    parser.add_argument("--camera", default="", help="in place of the one that the page offers")
    args = parser.parse_args()
    cores.keep_kernels()
    gui_start.main(1)
    paths: list[Callable[[MainWindow, Path], None]] = []
    if not args.capture:
        paths += [demo, planned]
    if not args.demo:
        paths.append(lambda window, scratch: capture(window, scratch, args.poses, args.camera))
    with tempfile.TemporaryDirectory(prefix="roomlight-newcomer-") as scratch:
        os.environ.update(windowed.own_places(Path(scratch) / "xdg"))
        with windowed.opened() as window:
            for path in paths:
                path(window, Path(scratch))
    return 0


if __name__ == "__main__":
    sys.exit(main())
