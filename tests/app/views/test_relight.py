"""The relight page: prepared once by a child, then every wish is drawn at once, the newest only."""

import shutil
import time
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PySide6.QtCore import QPoint, Qt, QTimer
from PySide6.QtGui import QImage
from pytestqt.qtbot import QtBot

from app.inspect import runs
from app.relight import files as relighting_files
from app.relight import relit as relighting
from app.relight import sources as light_sources
from app.relight.pictures import Wish
from app.relight.relit import Setting
from app.views.pages import Shell
from app.views.relight.controls import strength
from app.views.relight.page import RelightPage
from tests.app import furnace
from tests.app.relight.test_relit import arrays, light_of, sky, with_lamp
from tests.app.views.conftest import active, until
from tests.app.views.test_maps import nameless
from tests.app.work.children import QUICK, WILLING, job

VIEW = 4


def keep_light(to: Path, name: str = "view04") -> None:
    light = with_lamp(light_of(sky()), (0.6, -0.3, 0.2))
    fields = {field: np.asarray(getattr(light, field)) for field in type(light).__slots__ if field != "name"}
    relighting_files.keep(to, {**fields, "name": np.array(name), "lamp_clipped": np.array([True])})


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    session = furnace.finished(tmp_path_factory.mktemp("relight") / "lion.session")
    run = runs.runs_of(session)[0]
    relighting_files.keep(relighting_files.transfer_file(run), arrays())
    keep_light(relighting_files.light_file(run, VIEW))
    return session


@pytest.fixture
def session(prepared: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(prepared, tmp_path / "lion.session", symlinks=True))


@pytest.fixture
def page(qtbot: QtBot, shell: Shell) -> RelightPage:
    made = RelightPage(None)
    qtbot.addWidget(made)
    made.use(shell)
    made.resize(900, 640)
    made.show()
    return made


def ready(page: RelightPage, session: Path, qtbot: QtBot) -> RelightPage:
    page.show_session(session)
    until(qtbot, lambda: page.canvas.image is not None)
    still(page, qtbot)
    return page


def still(page: RelightPage, qtbot: QtBot) -> None:
    until(qtbot, lambda: not page._drawing and not page._background.busy)


def picture(page: RelightPage, qtbot: QtBot) -> QImage:
    still(page, qtbot)
    assert page.canvas.image is not None
    return page.canvas.image.copy()


def test_without_results_it_says_what_to_do(page: RelightPage, qtbot: QtBot, tmp_path: Path) -> None:
    assert page.empty.what.text() == "No session is open"
    page.show_session(tmp_path)
    until(qtbot, lambda: "no finished surface" in page.empty.what.text())
    assert not page.controls.isEnabled()
    active(page, qtbot)
    page.setFocus()
    qtbot.keyClicks(page, "pee")
    assert not page.controls.play.isChecked()
    assert page.controls.ev.value() == 0


def test_a_prepared_surface_is_lit_as_it_was(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    assert page.controls.isEnabled()
    assert "view04" in page.controls.view.currentText()
    assert "view04" in page.controls.source.text()
    assert len(page.controls.lamps) == 1
    assert page.controls.lamps[0].label.text() == "Lamp 1 *"
    assert nameless(page) == []
    assert page._transfer is not None
    assert page._light is not None
    expected = relighting.drawn(page._transfer, page._light, Setting(), page._white, 0.0, "srgb", True)
    blue, green, red, _ = (int(v) for v in expected[10, 10])
    colour = picture(page, qtbot).pixelColor(10, 10)
    assert (colour.red(), colour.green(), colour.blue()) == (red, green, blue)


def test_sliders_turn_dim_and_expose(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    last = picture(page, qtbot)
    for slider, value in (
        (page.controls.yaw, 90), (page.controls.pitch, 40), (page.controls.roll, -60),
        (page.controls.room, -8), (page.controls.lamps[0], 8), (page.controls.ev, 3),
    ):  # fmt: skip
        slider.setValue(value)
        now = picture(page, qtbot)
        assert now != last, slider.accessibleName()
        last = now
    assert page.controls.setting() == Setting(90, 40, -60, 0.25, (4.0,))
    page.controls.behind.setChecked(False)
    assert picture(page, qtbot).pixelColor(0, 0).alpha() == 0
    page.controls.as_photographed()
    assert page.controls.setting() == Setting(0, 0, 0, 1.0, (1.0,))


def test_all_the_way_down_is_off() -> None:
    assert strength(-16) == 0
    assert strength(0) == 1
    assert strength(4) == 2


def test_dragging_and_arrow_keys_turn_the_light(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    canvas = page.canvas
    qtbot.mousePress(canvas, Qt.MouseButton.LeftButton, pos=QPoint(100, 100))
    qtbot.mouseMove(canvas, QPoint(150, 80))
    qtbot.mouseRelease(canvas, Qt.MouseButton.LeftButton, pos=QPoint(150, 80))
    assert page.controls.setting().yaw_deg == 20  # to the right
    assert page.controls.setting().pitch_deg == 8  # up
    qtbot.keyClick(canvas, Qt.Key.Key_Left)
    assert page.controls.setting().yaw_deg == 15
    page.controls.turn_by(170, 200)
    assert page.controls.setting().yaw_deg == -175
    assert page.controls.setting().pitch_deg == 90


def test_small_turns_add_up(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    for _ in range(10):
        page.controls.turn_by(0.4, 0)
    assert page.controls.yaw.value() == 4


def test_only_the_newest_wish_is_drawn(
    page: RelightPage, qtbot: QtBot, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready(page, session, qtbot)
    drawn: list[Setting] = []
    really = relighting.drawn

    def counted(transfer, light, setting, *rest):
        drawn.append(setting)
        return really(transfer, light, setting, *rest)

    monkeypatch.setattr(relighting, "drawn", counted)
    for yaw in range(1, 101):
        page.controls.yaw.setValue(yaw)
    still(page, qtbot)
    assert len(drawn) <= 3
    assert drawn[-1].yaw_deg == 100


def test_pictures_keep_coming_while_the_light_is_dragged(
    page: RelightPage, qtbot: QtBot, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready(page, session, qtbot)
    really = relighting.drawn

    def slow(*args):
        time.sleep(0.02)
        return really(*args)

    monkeypatch.setattr(relighting, "drawn", slow)
    shown: list[int] = []
    really_shown = page.canvas.show_pixels
    monkeypatch.setattr(page.canvas, "show_pixels", lambda pixels: (shown.append(1), really_shown(pixels)))
    drag = QTimer()
    drag.timeout.connect(lambda: page.controls.turn_by(1, 0))
    drag.start(2)
    until(qtbot, lambda: len(shown) >= 5)
    drag.stop()


def test_the_light_turns_by_itself_until_the_page_is_left(
    page: RelightPage, qtbot: QtBot, session: Path
) -> None:
    ready(page, session, qtbot)
    page.controls.play.setChecked(True)
    until(qtbot, lambda: page.controls.yaw.value() > 3)
    page.hide()
    assert not page._timer.isActive()
    assert not page.controls.play.isChecked()


def test_an_unprepared_surface_is_prepared_at_once(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    run = runs.runs_of(session)[0]
    kept = session / "kept"
    relighting_files.folder(run).rename(kept)
    asked = []

    def make(name, task, request):
        asked.append((task, dict(request)))
        script = f'hear()\nemit("done", result={{"view": {VIEW}}})'
        return job(script, name, task, request)

    page.errand._make_job = make
    page.show_session(session)
    until(qtbot, lambda: page.errand.busy)
    assert asked == [("relight", {"session": str(session), "fingerprint": "aaaa", "view": None})]
    assert "Preparing" in page.empty.what.text()
    kept.rename(relighting_files.folder(run))
    page.errand.send("go")
    until(qtbot, lambda: page.canvas.image is not None)


def test_preparing_goes_on_while_another_page_is_shown_and_can_be_stopped(
    page: RelightPage, qtbot: QtBot, session: Path, shell: Shell
) -> None:
    shutil.rmtree(relighting_files.folder(runs.runs_of(session)[0]))
    page.errand._make_job = lambda name, task, request: job(WILLING, name, task, request)
    page.show_session(session)
    until(qtbot, lambda: page.errand.busy)
    child = page.errand._job
    assert child is not None
    page.errand.cancel.click()
    assert child.wait(20).ended
    assert "not prepared" in page.empty.what.text()
    page.empty.buttons[0].click()
    assert page.errand.busy
    second = page.errand._job
    assert second is not None
    page.hide()
    page.show()
    until(qtbot, lambda: not page._background.busy)
    assert page.errand._job is second
    assert shell.board.active == (second,)  # the status bar shows it, and closing the window asks
    page.errand.cancel.click()
    until(qtbot, lambda: not shell.board.active)


def test_what_cannot_be_prepared_says_why(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    shutil.rmtree(relighting_files.folder(runs.runs_of(session)[0]))
    script = 'emit("failed", message="made by an older version; process again")'
    page.errand._make_job = lambda name, task, request: job(script, name, task, request)
    page.show_session(session)
    until(
        qtbot,
        lambda: "older version" in page.empty.what.text() and "rocess again" in page.empty.remedy.text(),
    )


def test_a_panorama_becomes_the_light(page: RelightPage, qtbot: QtBot, session: Path, tmp_path: Path) -> None:
    ready(page, session, qtbot)
    before = picture(page, qtbot)

    def make(name, task, request):
        assert task == "panorama"
        light = light_sources.as_light(np.full((32, 64, 3), [0.2, 0.4, 5.0], np.float32))
        relighting_files.keep(
            Path(request["to"]), {**light, "name": np.array("beach.hdr"), **light_sources._no_lamps()}
        )
        return job(f'emit("done", result={{"light": {request["to"]!r}}})', name, task, request)

    page.errand._make_job = make
    page.load_panorama(tmp_path / "beach.hdr")
    until(qtbot, lambda: "beach.hdr" in page.controls.source.text())
    assert picture(page, qtbot) != before
    assert page.controls.lamps == []
    assert page.controls.view.currentIndex() == -1
    # Back to the recovered light.
    page.controls.view.setCurrentIndex(page.controls.view.findData(VIEW))
    page.controls.view_picked.emit(page.controls.view.currentIndex())
    until(qtbot, lambda: "view04" in page.controls.source.text())
    assert picture(page, qtbot) == before


def test_a_panorama_that_is_none_leaves_the_light(
    page: RelightPage, qtbot: QtBot, session: Path, tmp_path: Path, shell: Shell
) -> None:
    ready(page, session, qtbot)
    before = picture(page, qtbot)
    script = 'emit("failed", message="a.png: is 8 x 8; choose another file")'
    page.errand._make_job = lambda name, task, request: job(script, name, task, request)
    with qtbot.waitSignal(shell.wishes.trouble, timeout=20_000) as heard:
        page.load_panorama(tmp_path / "a.png")
    assert heard.args[0].remedy == "choose another file"
    assert picture(page, qtbot) == before


def test_another_views_light_is_asked_of_the_child(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    asked = []

    def make(name, task, request):
        asked.append(request["view"])
        keep_light(relighting_files.light_file(runs.runs_of(session)[0], 7), "view07")
        return job('emit("done", result={"view": 7})', name, task, request)

    page.errand._make_job = make
    page.controls.view.setCurrentIndex(page.controls.view.findData(7))
    page.controls.view_picked.emit(page.controls.view.currentIndex())
    until(qtbot, lambda: "view07" in page.controls.source.text())
    assert asked == [7]


def test_pictures_are_saved_as_shown_and_as_light(
    page: RelightPage, qtbot: QtBot, session: Path, tmp_path: Path, shell: Shell
) -> None:
    ready(page, session, qtbot)
    page.save(tmp_path / "a.png")
    assert QImage(str(tmp_path / "a.png")).convertToFormat(QImage.Format.Format_RGB32) == picture(
        page, qtbot
    ).convertToFormat(QImage.Format.Format_RGB32)
    page.save(tmp_path / "a.exr")
    until(qtbot, lambda: not page._background.busy)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {"R", "G", "B", "A"}
    for name in ("a.png", "a.exr"):
        with qtbot.waitSignal(shell.wishes.trouble, timeout=5000):
            page.save(tmp_path / "no" / name)


def test_what_waits_for_merged_brackets_is_prepared_once_they_are_there(
    page: RelightPage, qtbot: QtBot, session: Path, shell: Shell, tmp_path: Path
) -> None:
    shutil.rmtree(session / "derived")
    (session / "stages" / "hdr").rename(tmp_path / "hdr")
    begun: list[str] = []

    def make(name: str, task: str, request: dict):
        begun.append(task)
        return job('emit("failed", message="not merged yet; wait")', name, task, request)

    page.errand._make_job = make
    page.show_session(session)
    until(qtbot, lambda: begun and not page.errand.busy and not page._background.busy)
    shell.board.hold(True)  # anything that happens on the board, and nothing new
    until(qtbot, lambda: not page._background.busy)
    assert begun == ["relight"]
    (tmp_path / "hdr").rename(session / "stages" / "hdr")
    shell.board.hold(False)
    until(qtbot, lambda: begun == ["relight"] * 2)


def test_a_lamp_is_dragged_on_the_picture(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    before, middle = picture(page, qtbot).copy(), page.canvas.rect().center()
    page.controls.lamp_on.click()
    assert "move the lamp" in page.said.text()
    reach = round(page.canvas._reach())
    qtbot.mousePress(page.canvas, Qt.MouseButton.LeftButton, pos=middle)
    qtbot.mouseMove(page.canvas, middle + QPoint(reach // 2, -reach // 4))
    qtbot.mouseRelease(page.canvas, Qt.MouseButton.LeftButton)
    assert page.controls.lamp == pytest.approx((0.5, 0.25), abs=0.02)
    assert page.controls.yaw.value() == 0  # the room stays where it is
    qtbot.keyClick(page.canvas, Qt.Key.Key_Left)
    assert page.controls.lamp == pytest.approx((0.42, 0.25), abs=0.02)
    still(page, qtbot)
    assert picture(page, qtbot) != before
    page.controls.reset.click()
    assert page.controls.lamp is None
    still(page, qtbot)
    assert picture(page, qtbot) == before


def test_a_light_that_ships_is_one_choice_away_and_videos_and_pages_are_drawn_by_a_child(
    page: RelightPage, qtbot: QtBot, session: Path, tmp_path: Path, shell: Shell
) -> None:
    asked: list[tuple[str, dict]] = []

    def make(name: str, task: str, request: dict):
        asked.append((task, request))
        if task == "panorama":
            keep_light(Path(request["to"]), Path(request["file"]).name)
        return job('emit("done", result={"light": request["to"], **request})', name, task, request)

    ready(page, session, qtbot)
    page.errand._make_job = make
    row = page.controls.ready.findData("sunset")
    page.controls.ready.setCurrentIndex(row)
    page.controls.ready.activated.emit(row)
    until(qtbot, lambda: page._light is not None and page._light.name == "sunset.exr")
    assert page.controls.ready.currentIndex() == row
    page.controls.move_lamp(0.3, 0.4)
    page.controls.lamp_on.click()
    with qtbot.waitSignal(shell.wishes.say, timeout=30_000) as heard:
        page.save(tmp_path / "turn.mp4")
    assert "turn.mp4" in heard.args[0]
    wish = Wish(**asked[-1][1])  # as the child takes it
    assert asked[-1][0] == "relit"
    assert (wish.to, Path(wish.light).name) == (str(tmp_path / "turn.mp4"), "sunset.exr")
    assert tuple(wish.setting["spot"]) == (0.3, 0.4)
    page.controls.ready.setCurrentIndex(0)
    page.controls.ready.activated.emit(0)
    until(qtbot, lambda: page._light is not None and page._light.name == "view04")


def test_a_damaged_preparation_is_told(page: RelightPage, qtbot: QtBot, session: Path, shell: Shell) -> None:
    relighting_files.transfer_file(runs.runs_of(session)[0]).write_bytes(b"PK half")
    with qtbot.waitSignal(shell.wishes.trouble, timeout=20_000) as heard:
        page.show_session(session)
    assert "made again" in heard.args[0].remedy


def test_closing_the_session_takes_the_picture_away(page: RelightPage, qtbot: QtBot, session: Path) -> None:
    ready(page, session, qtbot)
    page.errand._make_job = lambda name, task, request: job(QUICK, name, task, request)
    page.show_session(None)
    assert page.canvas.image is None
    assert not page.controls.isEnabled()


def test_a_session_opened_while_the_page_is_hidden_is_drawn_at_the_next_show_as_photographed(
    page: RelightPage, qtbot: QtBot, session: Path, prepared: Path
) -> None:
    ready(page, session, qtbot)
    page.controls.yaw.setValue(40)
    page.controls.ev.setValue(1)
    still(page, qtbot)
    page.hide()
    page.show_session(prepared)
    until(qtbot, lambda: page.controls.isEnabled())
    page.show()
    until(qtbot, lambda: page.canvas.image is not None)
    assert page.controls.setting() == Setting(0, 0, 0, 1.0, (1.0,))
    assert page.controls.exposure_ev == 0


def test_the_surface_in_this_light_is_handed_to_the_3d_page(
    page: RelightPage, qtbot: QtBot, session: Path, shell: Shell
) -> None:
    ready(page, session, qtbot)
    with qtbot.waitSignal(shell.wishes.show_page, timeout=30_000) as asked:
        qtbot.mouseClick(page.controls.space, Qt.MouseButton.LeftButton)
    assert asked.args == ["view3d"]
    assert shell.state.relit.value is not None
    lit = np.load(shell.state.relit.value)
    mask = furnace.surface().mask
    assert lit.shape == (*mask.shape, 3)
    assert np.percentile(lit[mask].max(-1), 99) == pytest.approx(1, abs=0.05)  # exposed as on this page
    page.controls.ev.setValue(-3)
    with qtbot.waitSignal(shell.wishes.show_page, timeout=30_000):
        page.show_in_space()
    np.testing.assert_allclose(np.load(shell.state.relit.value), lit / 2, rtol=1e-5)
