"""The whole path through the real window: capture, process, look, export; and what is cancelled, killed or unplugged.

Nothing is played here: the window's own children hold the virtual rig, process, draw and export.
"""

import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from PySide6.QtGui import QImage

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from app.capture.panel import Panel
from app.state import place_of
from app.views import pages
from app.views.capture.page import CapturePage
from app.views.charts.page import ChartsPage
from app.views.export.page import ExportPage
from app.views.main_window import MainWindow
from app.views.maps.page import MapsPage
from app.views.pages import PageRow
from app.views.process.page import ProcessPage
from app.views.start.page import StartPage
from app.views.view3d.page import View3dPage
from app.work.jobs import Job, JobState, JobStatus
from engine.io import session as sessions
from tests.app.views.conftest import cycles_here
from tests.end_to_end import bundled, windowed
from tests.end_to_end.windowed import LEAST, until

STAGES = ("hdr", "segment", "poses", "light", "surface", "export")
POSES = 5  # of captures that only have to be interrupted


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory, qapp: object) -> Iterator[Path]:
    """A place of this module's own for sessions and settings."""
    folder = tmp_path_factory.mktemp("window")
    with pytest.MonkeyPatch.context() as patch:
        for name, place in windowed.own_places(folder / "xdg").items():
            patch.setenv(name, place)
        with cycles_here():
            yield folder


@pytest.fixture(scope="module")
def captured(home: Path) -> Path:
    """A session of twelve poses, from New capture on the start page."""
    session = home / "first.session"
    with windowed.opened() as window:
        start = window.page("start")
        assert isinstance(start, StartPage)
        start.new_capture.click()
        page = window.stack.currentWidget()
        assert isinstance(page, CapturePage)
        windowed.connect(page, windowed.RIG, windowed.NEAR_CAMERA)
        windowed.choose_plan(page, "file", file=windowed.plan_file(home / "near.csv"))
        windowed.start(page, session)
        state = windowed.finished(page)
        assert state.ended is not None
        assert (state.ended.taken, state.ended.missing) == (12, ())
        until(lambda: page.scene.picture.image is not None, "the last photograph")
        until(lambda: page.scene.coverage.panorama.image is not None, "the light that was seen")
        assert not windowed.is_blank(page.grab().toImage())
        until(lambda: window.shell.state.session.value == session, "the new session is the open one")
    return session


@dataclass(frozen=True)
class Cancelled:
    """What was seen of a run that was cancelled in a stage."""

    stage: str
    status: JobStatus
    stages: set[str]  # that it went through
    done: list[str]  # that were finished when it had ended


@pytest.fixture(scope="module")
def opened(captured: Path) -> Iterator[MainWindow]:
    """A window with that session."""
    with windowed.opened() as window:
        window.go_to_session(captured)
        windowed.configure(windowed.page(window, "process", ProcessPage), LEAST)
        yield window


@pytest.fixture(scope="module")
def cancelled(opened: MainWindow, captured: Path) -> list[Cancelled]:
    """Runs that were begun in it one after the other, each cancelled one stage later than the last."""
    page, seen = windowed.page(opened, "process", ProcessPage), []
    for stage in STAGES:
        job = windowed.begin(page)
        stages: set[str] = set()
        job.listen(lambda status, stages=stages: stages.add(status.stage))
        until(lambda job=job, stage=stage: job.status.stage == stage or job.status.ended, f"{stage} runs")
        until(page.stop.isEnabled, "it can be cancelled")
        page.stop.trigger()
        seen.append(Cancelled(stage, windowed.ended(job), stages - {""}, done(captured)))
    return seen


@pytest.fixture(scope="module")
def window(opened: MainWindow, cancelled: list[Cancelled]) -> MainWindow:
    """A window in which the session was processed to its end in spite of them."""
    windowed.processed(windowed.page(opened, "process", ProcessPage))
    return opened


def test_a_capture_in_the_window_is_a_session_of_twelve_poses(captured: Path) -> None:
    shots = sessions.shots(sessions.open_session(captured))
    assert [shot.name for shot in shots] == [f"pose{index:04d}" for index in range(12)]
    for shot in shots:
        sessions.verify(shot)
        assert len(shot.files) == 3


def test_cancelled_in_each_stage_the_next_start_goes_on_from_there(cancelled: list[Cancelled]) -> None:
    for number, (stage, run) in enumerate(zip(STAGES, cancelled, strict=True)):
        assert (run.status.state, run.status.stage) == (JobState.CANCELLED, stage), run
        # What was done before is not done again: it began in the stage that was cancelled the last time.
        assert run.stages <= set(STAGES[max(number - 1, 0) : number + 1])
        assert run.done == list(STAGES[:number])


def test_processing_in_the_window_finishes_every_stage_with_the_parameters_of_the_page(
    window: MainWindow, captured: Path
) -> None:
    for stage in STAGES:
        assert len(list((captured / "stages" / stage).glob("*/record.json"))) == 1
    assert not list(captured.rglob("*.partial"))
    assert "max_gaussians = 1500" in (captured / "params.toml").read_text()
    page = windowed.page(window, "process", ProcessPage)
    assert "export" in page.log.toPlainText()
    assert not windowed.is_blank(page.grab().toImage())


def test_the_maps_page_shows_normals_that_turn_with_the_surface(window: MainWindow) -> None:
    page = windowed.page(window, "maps", MapsPage)
    image = windowed.map_of(page, "normal").convertToFormat(QImage.Format.Format_RGB32)
    assert (image.width(), image.height()) == (160, 120)
    colours = {image.pixel(x, y) for x in range(60, 100) for y in range(40, 80)}
    assert len(colours) > 100
    for layer in ("photograph", "albedo", "depth"):
        assert not windowed.map_of(page, layer).isNull()
    assert not windowed.is_blank(page.grab().toImage())


def test_the_3d_page_shows_a_surface_and_comes_back_with_it_when_its_child_is_killed(
    window: MainWindow, captured: Path
) -> None:
    page = windowed.page(window, "view3d", View3dPage)
    assert not windowed.is_blank(windowed.scene_of(page))
    contents = page.state.contents
    assert contents.triangles > 500
    assert len(contents.names) == 12
    (child,) = windowed.children("app.viewer.child")
    picture = page.canvas.picture
    os.kill(child, signal.SIGKILL)
    until(lambda: page.status.restarts == 1, "the drawing process is started again")
    until(lambda: page.status.state == "showing" and page.canvas.picture is not picture, "a new picture")
    assert not windowed.is_blank(windowed.scene_of(page))
    assert page.state.contents == contents
    assert windowed.children("app.viewer.child") != [child]
    assert page.isEnabled()


def test_the_charts_show_the_residuals_of_every_view(window: MainWindow) -> None:
    page = windowed.page(window, "charts", ChartsPage)
    rows = [page.list.item(row) for row in range(page.list.count())]
    for key in ("views", "exposures", "times"):
        page.list.setCurrentItem(next(item for item in rows if item.data(256) == key))
        until(lambda key=key: page.chart is not None and page.chart.key == key, f"the chart {key}")
    assert page.chart is not None
    assert not page.chart.missing
    assert not windowed.is_blank(page.grab().toImage())


def test_every_format_is_exported_to_a_folder(window: MainWindow, tmp_path: Path) -> None:
    to = windowed.exported(windowed.page(window, "export", ExportPage), tmp_path / "out")
    names = {path.relative_to(to).as_posix() for path in to.rglob("*") if path.is_file()}
    wanted = {"maps.exr", "normal.png", "albedo.png", "surface.ply", "surface.glb", "light.ply", "light.exr"}
    assert wanted | {"transforms.json"} <= names
    assert any(name.startswith("colmap/images") for name in names)
    assert len(json.loads((to / "transforms.json").read_text())["frames"]) == 12
    normal = QImage(str(to / "normal.png"))
    assert (normal.width(), normal.height()) == (160, 120)


@pytest.mark.skipif(
    shutil.which("xvfb-run") is None, reason="there is no xvfb-run: no screen to show a window on"
)
def test_on_a_screen_no_page_is_blank(window: MainWindow, captured: Path, tmp_path: Path) -> None:
    words = [
        *windowed.module_command("tests.bench.window_pictures"), str(tmp_path), "--session", str(captured),
        "--rig", windowed.RIG, "--camera", windowed.NEAR_CAMERA, "--poses", "4", "--shot", "3", "--until", "0",
    ]  # fmt: skip
    ran = subprocess.run(
        ["xvfb-run", "-a", "-s", "-screen 0 1280x900x24", *words],
        cwd=bundled.ROOT,
        env={**os.environ, "QT_QPA_PLATFORM": "xcb", "PYTHONPATH": str(bundled.ROOT)},
        capture_output=True,
        text=True,
        timeout=windowed.PATIENCE_S,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    pictures = sorted(tmp_path.glob("*.jpg"))
    assert [picture.stem for picture in pictures] == ["capture", "maps", "process", "view3d"]
    for picture in pictures:
        image = QImage(str(picture))
        assert (image.width(), image.height()) == (1240, 780)
        assert not windowed.is_blank(image)


def done(session: Path) -> list[str]:
    return [stage for stage in STAGES if list((session / "stages" / stage).glob("*/record.json"))]


def in_mid_capture(window: MainWindow, session: Path) -> CapturePage:
    """A slow capture of POSES that has taken its first."""
    page = windowed.page(window, "capture", CapturePage)
    windowed.connect(page, windowed.SLOW_RIG, windowed.CAMERA)
    windowed.choose_plan(page, "turntable", POSES)
    windowed.start(page, session, bracket="0")
    until(lambda: windowed.taken(page.state) >= 1, "the first pose is taken")
    return page


def test_a_rig_that_is_unplugged_is_told_of_and_the_capture_resumes(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, session = tmp_path / "out", tmp_path / "loose.session"
    command = windowed.module_command("tests.end_to_end.loose_desk")

    def desk() -> Job:
        return Job("capture", "desk", {"out": str(out)},
                   command=lambda task, request: [*command, task, json.dumps(dict(request))])  # fmt: skip

    load = pages.load

    def loaded(row: PageRow):
        return (
            (lambda parent: CapturePage(parent, lambda: Panel(desk))) if row.key == "capture" else load(row)
        )

    monkeypatch.setattr(pages, "load", loaded)
    with windowed.opened() as window:
        page = in_mid_capture(window, session)
        out.touch()
        state = windowed.finished(page)
        assert state.ended is not None
        assert state.ended.trouble is not None
        assert "no such port" in state.ended.trouble.what
        assert 1 <= state.ended.taken < POSES
        until(page.banner.isVisible, "the banner")
        assert "no such port" in page.banner.what.text()
        out.unlink()
        windowed.pressed(page.banner, "Resume")
        until(lambda: page.state.capturing, "the capture goes on")
        ended = windowed.finished(page).ended
        assert ended is not None
        assert (ended.taken, ended.trouble) == (POSES, None), ended
    assert whole(session)


def test_closed_in_mid_capture_and_opened_again_the_capture_is_finished(home: Path, tmp_path: Path) -> None:
    session, before = tmp_path / "closed.session", set(windowed.children("app.work.worker"))
    with windowed.opened() as window:
        page = in_mid_capture(window, session)
        window.close()
        assert window.isVisible()
        question = window.closing.question
        assert question is not None
        assert "capture" in question.text()
        windowed.pressed(question, "Keep running")
        assert window.isVisible()
        assert page.state.capturing
        windowed.shut(window)
    kept = len(sessions.shots(sessions.open_session(session)))
    assert 1 <= kept < POSES
    until(lambda: set(windowed.children("app.work.worker")) <= before, "no child outlives the window")
    with windowed.opened() as window:
        window.go_to_session(session)
        page = windowed.page(window, "capture", CapturePage)
        until(lambda: page.captured is not None, "the page sees how far it came")
        assert f"{kept} of {POSES}" in page.banner.what.text()
        windowed.pressed(page.banner, "Resume")
        until(lambda: page.state.capturing, "the capture goes on")
        ended = windowed.finished(page).ended
        assert ended is not None
        assert (ended.taken, ended.trouble) == (POSES, None), ended
    assert whole(session)


def whole(session: Path) -> bool:
    """Every pose is there once, undamaged."""
    shots = sessions.shots(sessions.open_session(session))
    for shot in shots:
        sessions.verify(shot)
    assert place_of(session).kind == "session"
    return sorted(shot.name for shot in shots) == [f"pose{index:04d}" for index in range(POSES)]
