"""Drive the real window as a person would: its pages by their fields, buttons and shortcuts, its children for real.

For tests and benches, offscreen or on a screen. Everything waits for what it caused, in the window's own event loop.
"""

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from PySide6.QtCore import QCoreApplication, QEvent, QEventLoop, QTimer
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QAbstractButton, QApplication, QWidget

from app.capture.panel import PanelState
from app.settings import Settings
from app.views import application, theme
from app.views.capture.page import CapturePage
from app.views.export.page import ExportPage
from app.views.main_window import MainWindow
from app.views.maps.page import MapsPage
from app.views.process.page import ProcessPage
from app.views.view3d.page import View3dPage
from app.work.jobs import Job, JobState, JobStatus

PATIENCE_S = 240.0  # of a core, for anything to happen; nothing takes as long
AT_WORK, WATCHED_S = 0.05, 30.0  # least share of a core, over so long, of who is still at something
LOOK_MS = 10

# A rig whose moves take a third of a second, and a scene that takes no time.
RIG, CAMERA = "virtual:grbl?speed=200", "virtual:?size=64x48"
SLOW_RIG = "virtual:grbl?speed=20&kind=turntable"  # a second for each pose

# Twelve poses that show one side of the card room, each near enough to the next to be found in it.
NEAR = [(9.0 * i, (-8.0, 0.0, 8.0)[i % 3]) for i in range(12)]
NEAR_CAMERA = "virtual:?size=160x120"

# As little as makes every stage do its work.
LEAST: Mapping[str, Any] = {
    "poses.features.maximum": 500,
    "light.max_gaussians": 1500,
    "light.max_image_width": 64,
    "light.epochs": [2, 2],
    "surface.directions": 128,
    "surface.coarse_iterations": 1,
    "surface.fine_iterations": 1,
    "surface.gauss_newton_steps": 1,
    "surface.probe_grid_xy": 1,
    "surface.probe_grid_z": 1,
    "surface.probe_resolution": 24,
    "surface.normal_candidates": 40,
    "surface.without": ["light_gains", "detect_metal", "classify_material"],
    "surface.validation_views": 2,
    "surface.object_distance": 0.3,
}

Page = TypeVar("Page", bound=QWidget)


def own_places(home: Path) -> dict[str, str]:
    """The environment of a person who never started the program."""
    return {f"XDG_{name}_HOME": str(home / name.lower()) for name in ("CONFIG", "STATE", "CACHE", "DATA")}


@contextlib.contextmanager
def opened() -> Iterator[MainWindow]:
    """The window as `roomlight gui` opens it; at the end it is closed, and whatever runs is stopped."""
    app = QApplication.instance() or application.make()
    assert isinstance(app, QApplication)
    settings = Settings()
    theme.install(app, settings.value.theme)
    window = MainWindow(settings)
    window.show()
    try:
        yield window
    finally:
        shut(window)
        window.deleteLater()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def shut(window: MainWindow) -> None:
    """Close it, agreeing to stop what runs, and wait until it is gone."""
    if window.isVisible():
        window.close()
        if window.closing.question is not None:
            pressed(window.closing.question, "Stop")
        until(lambda: not window.isVisible(), "the window closes")


def until(what: Callable[[], object], why: str = "", timeout_s: float = PATIENCE_S) -> None:
    """Let the window live until `what` is true.

    Beside other programs everything takes longer: who is at work is waited for until it had a core for `timeout_s`.

    Raises:
        TimeoutError: it never was; names `why`.
    """
    begun = marked = time.monotonic()
    worked = before = worked_s()
    at_work = True
    while not what():
        live(LOOK_MS / 1000)
        now = time.monotonic()
        if now - marked > WATCHED_S:
            latest = worked_s()
            at_work = latest - before > AT_WORK * (now - marked) and latest - worked < timeout_s
            marked, before = now, latest
        if now - begun > timeout_s and not at_work:
            raise TimeoutError(f"waited {now - begun:.0f} s in vain: {why}")


def worked_s() -> float:
    """Seconds of a core that this process and its children have had; of Linux, elsewhere its own."""
    if not sys.platform.startswith("linux"):
        return time.process_time()
    parents, ticks = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            parents[stat.parent.name] = fields[1]
            ticks[stat.parent.name] = sum(map(int, fields[11:15]))  # with those of children that have ended
    ours = {str(os.getpid())}
    while found := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= found
    return sum(ticks.get(pid, 0) for pid in ours) / os.sysconf("SC_CLK_TCK")


def live(seconds: float) -> None:
    """Let the window live for a while, in a true event loop."""
    loop = QEventLoop()
    QTimer.singleShot(round(1000 * seconds), loop.quit)
    loop.exec()


def pressed(parent: QWidget, text: str) -> None:
    """Press the button that says so."""
    found = [button for button in parent.findChildren(QAbstractButton) if text in _words(button)]
    if not found:
        raise LookupError(
            f"no button says {text!r}: {[_words(b) for b in parent.findChildren(QAbstractButton)]}"
        )
    found[0].click()


def _words(button: QAbstractButton) -> str:
    return button.text().replace("&", "")


def page(window: MainWindow, key: str, kind: type[Page]) -> Page:
    """Turn to a page."""
    window.show_page(key)
    shown = window.page(key)
    assert isinstance(shown, kind)
    return shown


# ---- capturing


def plan_file(to: Path) -> Path:
    """The plan of `NEAR`, as a person would write it."""
    to.write_text("pan_deg,tilt_deg\n" + "".join(f"{pan},{tilt}\n" for pan, tilt in NEAR))
    return to


def connect(shown: CapturePage, rig: str, camera: str) -> None:
    """Open these devices."""
    shown.setup.devices.choose(rig, camera)
    shown.setup.devices.toggle.click()
    until(lambda: shown.state.open and not shown.state.order, f"{rig} and {camera} open")


def choose_plan(shown: CapturePage, kind: str, poses: int = 0, file: Path | None = None) -> None:
    """Fill in the plan."""
    box = shown.setup.plan
    before = shown.state.planned
    box.kind.setCurrentIndex(box.kind.findData(kind))
    if poses:
        box.poses.setValue(poses)
    if file is not None:
        box.file.setText(str(file))
    wanted = len(NEAR) if file is not None else poses

    def drawn() -> bool:
        planned = shown.state.planned
        return planned is not None and planned is not before and len(planned.poses) == wanted

    until(drawn, f"a plan of {wanted} poses")


def start(shown: CapturePage, session: Path, bracket: str = "-3 0 3") -> None:
    """Start the capture; returns once it runs."""
    shown.setup.bracket.bracket.setEditText(bracket)
    shown.setup.place.folder.setText(str(session))
    until(lambda: shown.does.start.isEnabled(), "the capture can be started")
    shown.does.start.trigger()
    until(lambda: shown.state.capturing or shown.state.session == session, "the capture begins")


def taken(state: PanelState) -> int:
    return 0 if state.going is None else state.going.taken


def finished(shown: CapturePage) -> PanelState:
    """Wait for the capture's end."""
    until(lambda: shown.state.ended is not None and not shown.state.capturing, "the capture ends")
    return shown.state


# ---- processing


def planned(shown: ProcessPage) -> None:
    """Wait until the page knows what would run."""
    until(lambda: shown.model is not None and shown.model.cards, "the session is planned")


def configure(shown: ProcessPage, changes: Mapping[str, Any], preset: str = "draft") -> None:
    """Edit parameters as their editors do."""
    planned(shown)
    shown.bar.preset_chosen.emit(preset)
    for name, value in changes.items():
        shown.parameters.edited.emit(name, value)

    def known() -> bool:
        plan = shown.model.plan.value if shown.model is not None else None
        if plan is None or plan.settings.preset != preset:
            return False
        return all(
            _same(parameter.value, changes[name]) for name in changes if (parameter := plan.parameter(name))
        )

    until(known, "the edits are planned")


def _same(one: Any, other: Any) -> bool:
    return list(one) == list(other) if isinstance(other, list) else one == other


def begin(shown: ProcessPage) -> Job:
    """Start processing; returns its job."""
    until(lambda: shown.start.isEnabled(), "the session can be processed")
    assert shown.model is not None
    window = shown.window()
    assert isinstance(window, MainWindow)
    before = set(window.shell.board.queue)
    shown.start.trigger()
    (job,) = set(window.shell.board.queue) - before
    return job


def ended(job: Job) -> JobStatus:
    """Wait for a job's end."""
    until(lambda: job.status.ended, f"{job.status.name} ends")
    return job.status


def processed(shown: ProcessPage) -> None:
    """Process to the end.

    Raises:
        RuntimeError: it failed.
    """
    status = ended(begin(shown))
    if status.state is not JobState.DONE:
        raise RuntimeError(f"processing {status.state.value}: {status.message}\n{status.details}")
    until(lambda: shown.bar.left.text() == "all done", "the page says that all is done")


# ---- looking


def map_of(shown: MapsPage, layer: str) -> QImage:
    """The picture of the first panel with this layer."""
    panel = next(panel for panel in shown.grid.panels if panel.layer == layer)
    until(lambda: panel.image() is not None, f"the map {layer}")
    image = panel.image()
    assert image is not None
    return image


def scene_of(shown: View3dPage) -> QImage:
    """What the 3D view shows once it is drawn in full."""
    until(lambda: shown.status.stuck or _full(shown), "the 3D view's picture")
    image = shown.canvas.screenshot()
    if image is None:
        raise RuntimeError(f"the 3D view: {shown.status.message}; {shown.status.details}")
    return image


def _full(shown: View3dPage) -> bool:
    return (
        shown.canvas.picture is not None and shown.canvas.picture.last and bool(shown.state.contents.folder)
    )


def exported(shown: ExportPage, to: Path) -> Path:
    """Export every format."""
    until(
        lambda: shown.table.isVisible() and shown.state.text().startswith("up to date"), "an export is there"
    )
    shown.to.setText(str(to))
    until(lambda: shown.action.isEnabled(), "the export can be started")
    shown.action.trigger()
    until(lambda: not shown.errand.busy and to.is_dir(), "the export ends")
    return to


def is_blank(image: QImage) -> bool:
    """Nothing but ground: one colour on nearly all of it, or hardly any others."""
    small = image.convertToFormat(QImage.Format.Format_RGB32).scaled(160, 100)
    colours = [small.pixel(x, y) for y in range(small.height()) for x in range(small.width())]
    counts = {colour: colours.count(colour) for colour in set(colours)}
    return len(counts) < 16 or max(counts.values()) > 0.985 * len(colours)


# ---- children


def children(module: str) -> list[int]:
    """Ids of this process's children that run a module."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            words = (path / "cmdline").read_bytes().decode(errors="replace").split("\0")
            if parent == os.getpid() and module in words:
                found.append(int(path.name))
    return found


def module_command(module: str) -> list[str]:
    """What runs a module with this interpreter."""
    return [sys.executable, "-P", "-u", "-m", module]
