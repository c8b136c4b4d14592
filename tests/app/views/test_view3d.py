"""The 3D page: what is seen and wanted, without waiting for the process that draws."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("PySide6")
from PySide6.QtCore import QPoint, QPointF, Qt, QTimer
from PySide6.QtGui import QAction, QImage, QKeySequence
from PySide6.QtWidgets import QAbstractButton, QAbstractSlider, QApplication, QComboBox, QLabel, QWidget

from app.state import Trouble
from app.viewer import orbit, showing
from app.viewer.events import Picture
from app.viewer.film import Film
from app.viewer.protocol import LAYERS, Style
from app.viewer.showing import Showing
from app.viewer.supervisor import Supervisor
from app.viewer.watch import Patience
from app.views.pages import Shell
from app.views.view3d.page import View3dPage
from engine.io import scale_edit
from engine.io import session as sessions
from engine.scale_bar import on_surface
from tests.app import furnace
from tests.app.viewer import fake_child, made

CALM = Patience(ready=120, loaded=120, frame=120, pong=120)
BRIEF = Patience(ready=120, loaded=120, frame=120, pong=120, restarts=1)
SHARP = Patience(ready=120, loaded=120, frame=1.5, pong=1.5)
BOUND_MS = 60_000

Open = Callable[..., View3dPage]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made.session(tmp_path_factory.mktemp("view3d") / "s", views=2)


@pytest.fixture
def page(qtbot, monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    monkeypatch.delenv("DISPLAY", raising=False)
    opened: list[View3dPage] = []

    def one(*words: str, patience: Patience = CALM) -> View3dPage:
        command = (sys.executable, "-m", "tests.app.viewer.fake_child", *words)
        made_page = View3dPage(supervise=partial(Supervisor, command=command, patience=patience))
        made_page.turn.milliseconds = 0
        made_page.resize(900, 600)
        qtbot.addWidget(made_page)
        made_page.show()
        opened.append(made_page)
        return made_page

    yield one
    for made_page in opened:
        made_page.end()


def shown(qtbot, page: View3dPage) -> Picture:
    """The picture of what is wanted now."""

    def there() -> bool:
        picture = page.canvas.picture
        return (
            picture is not None
            and picture.look.orbit == page.state.eye
            and picture.look.style == page.state.style
        )

    qtbot.waitUntil(there, timeout=BOUND_MS)
    assert page.canvas.picture is not None
    return page.canvas.picture


@pytest.fixture
def own_page(qtbot, page: Open, session: Path) -> View3dPage:
    """A page whose drawing process may be harmed."""
    made_page = page()
    made_page.show_session(session)
    shown(qtbot, made_page)
    return made_page


@pytest.fixture(scope="module")
def lasting(qapp, session: Path) -> Iterator[View3dPage]:
    """A page for all tests that leave its process alone."""
    command = (sys.executable, "-m", "tests.app.viewer.fake_child")
    one = View3dPage(supervise=partial(Supervisor, command=command, patience=CALM))
    one.resize(900, 600)
    one.show()
    one.show_session(session)
    yield one
    one.end()
    one.deleteLater()


@pytest.fixture
def open_page(qtbot, lasting: View3dPage, session: Path) -> View3dPage:
    """The page as it is when a session has been opened."""
    qtbot.waitUntil(lambda: lasting.state.contents.folder == str(session), timeout=BOUND_MS)
    lasting.turn.milliseconds = 0
    lasting.resize(900, 600)
    lasting.activateWindow()  # shortcuts are those of the active window
    qtbot.waitUntil(lasting.isActiveWindow, timeout=BOUND_MS)
    lasting._close_photograph()
    lasting.banner.hide()
    fresh = Style(
        top=lasting.state.style.top, bottom=lasting.state.style.bottom, line=lasting.state.style.line
    )
    contents = fake_child.contents(str(session))
    lasting._show(showing.opened(Showing(style=fresh), contents, lasting._aspect))
    lasting._ask(moving=False)
    shown(qtbot, lasting)
    return lasting


def child(page: View3dPage) -> int:
    assert page._supervisor is not None
    assert page._supervisor._child is not None
    return page._supervisor._child.pid


# What is seen


def test_without_a_session_it_says_what_to_do(page: Open) -> None:
    one = page()
    assert one.empty.isVisible()
    assert "No session" in one.empty.what.text()
    assert one._supervisor is None
    assert not one.canvas.isVisible()


def test_a_session_is_shown(qtbot, page: Open, session: Path) -> None:
    one = page()
    start = time.monotonic()
    one.show_session(session)
    assert time.monotonic() - start < 1.0
    assert one.cover.isVisible()
    picture = shown(qtbot, one)
    assert not one.cover.isVisible()
    assert (picture.width, picture.height) == one.canvas.device_size()
    image = one.canvas.grab().toImage()
    value = picture.look.number % 251
    assert image.pixelColor(200, 300).getRgb()[:3] == (value, value, value)


def test_a_hidden_page_starts_nothing_until_it_is_shown(qtbot, page: Open, session: Path) -> None:
    one = page()
    one.hide()
    one.show_session(session)
    qtbot.wait(100)
    assert one._supervisor is None
    one.show()
    shown(qtbot, one)


def test_showing_the_page_again_reads_only_new_results(qtbot, own_page: View3dPage) -> None:
    before = own_page._loaded
    contents = own_page.state.contents
    own_page.hide()
    own_page.show()
    qtbot.waitUntil(lambda: not own_page._background.busy, timeout=BOUND_MS)
    assert own_page._loaded is before
    own_page._loaded = {}
    own_page.refresh()
    qtbot.waitUntil(lambda: own_page.state.contents is not contents, timeout=BOUND_MS)


def test_closing_the_session_clears_the_picture(own_page: View3dPage) -> None:
    own_page.show_session(None)
    assert own_page.canvas.picture is None
    assert own_page.empty.isVisible()
    assert own_page.state.contents.folder == ""


def test_the_panel_counts_what_there_is(open_page: View3dPage) -> None:
    counts = {name: label.text() for name, label in open_page.panel.counts.items()}
    assert counts == {
        "surface": "34 triangles",
        "emitters": "12",
        "lamps": "1",
        "cameras": "2",
        "points": "5",
    }
    assert all(box.isEnabled() for box in open_page.panel.layers.values())


def test_what_is_not_computed_yet_is_said(qtbot, open_page: View3dPage) -> None:
    from dataclasses import replace

    open_page._take(replace(open_page.state.contents, missing=("light", "surface"), emitters=0))
    assert open_page.banner.isVisible()
    assert "light, surface" in open_page.banner.text()
    assert not open_page.panel.layers["emitters"].isEnabled()
    assert open_page.panel.counts["emitters"].text() == "none"


def test_a_page_that_nobody_looks_at_lets_its_process_go(qtbot, own_page: View3dPage) -> None:
    qtbot.keyClick(own_page.canvas, Qt.Key.Key_Left)
    eye, old = own_page.state.eye, child(own_page)
    own_page._unseen.setInterval(50)
    own_page.hide()
    qtbot.waitUntil(lambda: own_page._supervisor is None, timeout=BOUND_MS)
    with pytest.raises(ProcessLookupError):
        os.kill(old, 0)
    own_page.show()
    qtbot.waitUntil(lambda: own_page._supervisor is not None, timeout=BOUND_MS)
    qtbot.waitUntil(lambda: own_page.status.state == "showing", timeout=BOUND_MS)
    assert own_page.state.eye == eye


# What is wanted


@pytest.mark.parametrize("layer", LAYERS)
def test_layers_follow_their_check_boxes_and_back(qtbot, open_page: View3dPage, layer: str) -> None:
    box = open_page.panel.layers[layer]
    before = box.isChecked()
    assert before == (layer in open_page.state.style.visible)
    box.click()
    assert (layer in open_page.state.style.visible) != before
    assert (layer in shown(qtbot, open_page).look.style.visible) != before


def test_surface_emitters_brightness_and_front_are_chosen(qtbot, open_page: View3dPage) -> None:
    panel = open_page.panel
    panel.surface.setCurrentIndex(1)
    panel.surface.activated.emit(1)
    panel.ways["ellipsoids"].click()
    panel.exposure.setValue(3)
    panel.front.click()
    style = shown(qtbot, open_page).look.style
    assert (style.surface, style.emitters, style.exposure_ev, style.open_front) == (
        "albedo", "ellipsoids", 1.5, False,
    )  # fmt: skip
    assert panel.stops.text() == "+1.5 EV"


def drag(qtbot, page: View3dPage, modifier=Qt.KeyboardModifier.NoModifier) -> None:
    canvas = page.canvas
    start, end = QPoint(30, 40), QPoint(90, 70)
    qtbot.mousePress(canvas, Qt.MouseButton.LeftButton, modifier, start)
    from PySide6.QtCore import QEvent
    from PySide6.QtGui import QMouseEvent

    for at in (start + QPoint(20, 10), end):
        event = QMouseEvent(
            QEvent.Type.MouseMove, QPointF(at), QPointF(canvas.mapToGlobal(at)), Qt.MouseButton.NoButton,
            Qt.MouseButton.LeftButton, modifier,
        )  # fmt: skip
        canvas.mouseMoveEvent(event)
    qtbot.mouseRelease(canvas, Qt.MouseButton.LeftButton, modifier, end)


def test_dragging_orbits(qtbot, open_page: View3dPage) -> None:
    before = open_page.state.eye
    drag(qtbot, open_page)
    after = open_page.state.eye
    assert after.target == before.target
    assert after.azimuth < before.azimuth
    assert after.elevation > before.elevation
    assert not shown(qtbot, open_page).look.moving


def test_dragging_with_shift_pans(qtbot, open_page: View3dPage) -> None:
    before = open_page.state.eye
    drag(qtbot, open_page, Qt.KeyboardModifier.ShiftModifier)
    after = open_page.state.eye
    assert (after.azimuth, after.elevation, after.distance) == (
        before.azimuth,
        before.elevation,
        before.distance,
    )
    canvas = open_page.canvas
    x, y, _ = orbit.project(after, np.array(before.target), canvas.width(), canvas.height())
    assert (x - canvas.width() / 2, y - canvas.height() / 2) == pytest.approx((60, 30), abs=0.5)


def test_the_eye_rests_by_itself_after_a_move(qtbot, open_page: View3dPage) -> None:
    qtbot.keyClick(open_page.canvas, Qt.Key.Key_Left)
    qtbot.waitUntil(lambda: shown(qtbot, open_page).look.moving is False, timeout=BOUND_MS)


@pytest.mark.parametrize(
    ("key", "modifier", "what"),
    [
        (Qt.Key.Key_Left, Qt.KeyboardModifier.NoModifier, "azimuth"),
        (Qt.Key.Key_Up, Qt.KeyboardModifier.NoModifier, "elevation"),
        (Qt.Key.Key_Right, Qt.KeyboardModifier.ShiftModifier, "target"),
        (Qt.Key.Key_Down, Qt.KeyboardModifier.ShiftModifier, "target"),
        (Qt.Key.Key_Plus, Qt.KeyboardModifier.NoModifier, "distance"),
        (Qt.Key.Key_Minus, Qt.KeyboardModifier.NoModifier, "distance"),
    ],
)
def test_keys_orbit_pan_and_zoom(qtbot, open_page: View3dPage, key, modifier, what: str) -> None:
    before = open_page.state.eye
    qtbot.keyClick(open_page.canvas, key, modifier)
    changed = {
        name for name in ("azimuth", "elevation", "target", "distance")
        if getattr(open_page.state.eye, name) != getattr(before, name)
    }  # fmt: skip
    assert changed == {what}


@pytest.mark.parametrize(("key", "view"), list(zip("123456", orbit.VIEWS, strict=True)))
def test_number_keys_go_to_the_standing_views(qtbot, open_page: View3dPage, key: str, view: str) -> None:
    open_page.canvas.setFocus()
    qtbot.keyClick(open_page.canvas, getattr(Qt.Key, f"Key_{key}"))
    assert (open_page.state.eye.azimuth, open_page.state.eye.elevation) == orbit.VIEWS[view]


@pytest.mark.parametrize("key", [Qt.Key.Key_R, Qt.Key.Key_Home])
def test_the_view_is_reset_by_key(qtbot, open_page: View3dPage, key) -> None:
    home = open_page.state.eye
    qtbot.keyClick(open_page.canvas, Qt.Key.Key_Left)
    qtbot.keyClick(open_page.canvas, Qt.Key.Key_Plus)
    assert open_page.state.eye != home
    qtbot.keyClick(open_page.canvas, key)
    assert open_page.state.eye == home


def test_a_turn_goes_its_way_and_arrives(qtbot, open_page: View3dPage) -> None:
    open_page.turn.milliseconds = 60
    open_page._actions["top"].trigger()
    assert open_page.state.eye.elevation != orbit.VIEWS["top"][1]
    qtbot.waitUntil(lambda: open_page.state.eye.elevation == orbit.VIEWS["top"][1], timeout=BOUND_MS)
    shown(qtbot, open_page)


def room_seen(qtbot, page: View3dPage) -> None:
    """From so far away that every camera is in the picture."""
    page.turn.milliseconds = 1
    page._actions["everything"].trigger()
    room = page.state.contents.room
    qtbot.waitUntil(lambda: page.canvas._seen_from.target == pytest.approx(room), timeout=BOUND_MS)
    shown(qtbot, page)


def camera_pixel(page: View3dPage, view: int) -> QPoint:
    canvas = page.canvas
    flat = orbit.project(canvas._seen_from, canvas._pyramids[view], canvas.width(), canvas.height())
    middle = (flat[0, :2] + flat[3, :2]) / 2
    return QPoint(round(middle[0]), round(middle[1]))


def test_clicking_a_camera_asks_for_its_photograph(qtbot, open_page: View3dPage) -> None:
    room_seen(qtbot, open_page)
    with qtbot.waitSignal(open_page.view_picked, timeout=BOUND_MS) as asked:
        qtbot.mouseClick(open_page.canvas, Qt.MouseButton.LeftButton, pos=camera_pixel(open_page, 1))
    assert asked.args == [1]
    assert (open_page.state.chosen, open_page.state.style.view) == (1, 1)
    assert open_page.panel.views.currentData() == 1
    assert open_page.photograph.isVisible()
    qtbot.waitUntil(lambda: not open_page.photograph.picture.pixmap().isNull(), timeout=BOUND_MS)
    qtbot.keyClick(open_page.canvas, Qt.Key.Key_Escape)
    assert not open_page.photograph.isVisible()


def test_cameras_are_drawn_and_clicked_as_large_as_the_slider_says(qtbot, open_page: View3dPage) -> None:
    usual = open_page.canvas._pyramids
    open_page.panel.frusta.setValue(open_page.panel.frusta.maximum())
    assert shown(qtbot, open_page).look.style.frusta == 8.0
    larger = open_page.canvas._pyramids
    np.testing.assert_allclose(larger[0, 1] - larger[0, 0], 8 * (usual[0, 1] - usual[0, 0]))
    other = showing.opened(open_page.state, fake_child.contents("another"), 1.5)
    assert other.style.frusta == 8.0


def test_the_photograph_is_offered_on_the_maps_page_too(qtbot, open_page: View3dPage, shell: Shell) -> None:
    open_page.use(shell)
    room_seen(qtbot, open_page)
    qtbot.mouseClick(open_page.canvas, Qt.MouseButton.LeftButton, pos=camera_pixel(open_page, 1))
    qtbot.waitUntil(lambda: shell.state.view.value == 1, timeout=BOUND_MS)
    for ask in (
        lambda: qtbot.mouseClick(open_page.photograph.larger, Qt.MouseButton.LeftButton),
        lambda: qtbot.keyClick(open_page.canvas, Qt.Key.Key_M),
    ):
        shell.state.view.set(None)
        with qtbot.waitSignal(shell.wishes.show_page, timeout=BOUND_MS) as asked:
            ask()
        assert (asked.args, shell.state.view.value) == (["maps"], 1)
    open_page.view_picked.disconnect()
    open_page._shell = None


def test_a_surface_relit_elsewhere_is_shown_now_or_when_the_view_begins(
    qtbot, page: Open, session: Path, shell: Shell
) -> None:
    one = page()
    one.use(shell)
    shell.state.session.set(session)
    shell.state.relit.set(Path("/relit-1.npy"))
    one.show_session(session)
    qtbot.waitUntil(lambda: one.state.style.surface == "relit", timeout=BOUND_MS)
    one._restyle(showing.styled(one.state, surface="albedo"))
    shell.state.relit.set(Path("/relit-2.npy"))
    qtbot.waitUntil(lambda: one.state.style.surface == "relit", timeout=BOUND_MS)
    shell.state.session.set(None)
    assert shell.state.relit.value is None
    assert one._relit is None


def test_clicking_beside_every_camera_asks_for_nothing(qtbot, open_page: View3dPage) -> None:
    with qtbot.assertNotEmitted(open_page.view_picked, wait=QApplication.doubleClickInterval() + 100):
        qtbot.mouseClick(open_page.canvas, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    assert open_page.state.chosen == -1


def test_cameras_are_chosen_by_key(qtbot, open_page: View3dPage) -> None:
    for key, view in (("]", 0), ("]", 1), ("[", 0)):
        open_page.canvas.setFocus()
        qtbot.keyClicks(open_page.canvas, key)
        assert open_page.state.chosen == view
    with qtbot.waitSignal(open_page.view_picked, timeout=BOUND_MS) as asked:
        qtbot.keyClick(open_page.canvas, Qt.Key.Key_P)
    assert asked.args == [0]
    qtbot.keyClick(open_page.canvas, Qt.Key.Key_L)
    pose = np.reshape(open_page.state.contents.poses[0], (3, 4))
    np.testing.assert_allclose(orbit.cam_from_world(open_page.state.eye), pose, atol=1e-9)


def test_a_double_click_turns_about_what_is_under_it(qtbot, open_page: View3dPage) -> None:
    canvas = open_page.canvas
    middle = QPoint(canvas.width() // 4, canvas.height() // 2)
    with qtbot.assertNotEmitted(canvas.picked, wait=QApplication.doubleClickInterval() + 100):
        qtbot.mouseClick(canvas, Qt.MouseButton.LeftButton, pos=middle)
        qtbot.mouseDClick(canvas, Qt.MouseButton.LeftButton, pos=middle)
    qtbot.waitUntil(lambda: open_page.state.eye.target[2] == 1.0, timeout=BOUND_MS)  # the fake's answer
    assert open_page.state.eye.target[:2] == pytest.approx((0.25, 0.5), abs=0.01)


def test_a_screenshot_is_the_picture_with_axes_and_scale(open_page: View3dPage, tmp_path: Path) -> None:
    assert open_page.take_screenshot(tmp_path / "shot.png") is None
    image = QImage(str(tmp_path / "shot.png"))
    assert (image.width(), image.height()) == open_page.canvas.device_size()
    colours = {image.pixel(x, y) for x in range(0, 120) for y in range(image.height() - 120, image.height())}
    assert len(colours) > 5  # the axes
    failed = open_page.take_screenshot(tmp_path / "nowhere" / "shot.png")
    assert failed is not None
    assert failed.remedy


@pytest.mark.parametrize("name", ["turn.mp4", "turn"])
def test_a_turntable_is_saved_whole(
    qtbot, open_page: View3dPage, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    eye, looks, add = open_page.state.eye, [], Film.add
    monkeypatch.setattr(Film, "add", lambda film, picture: (looks.append(picture.look), add(film, picture)))
    assert open_page.save_film("turntable", tmp_path / name) is None
    qtbot.waitUntil(lambda: open_page._filming is None, timeout=BOUND_MS)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    step = 2 * np.pi / 72
    assert [look.orbit.azimuth for look in looks] == pytest.approx(
        [eye.azimuth + step * k for k in range(72)]
    )
    for look in looks:
        assert (*look.orbit.target, look.orbit.elevation) == pytest.approx((*eye.target, eye.elevation))
    film = cv2.VideoCapture(str(tmp_path / name if name.endswith(".mp4") else tmp_path / name / "%04d.png"))
    pictures = [film.read()[1] for _ in range(72)]
    assert film.read()[0] is False
    assert pictures[0].shape[:2] == tuple(n // 2 * 2 for n in open_page.canvas.device_size())[::-1]
    drawn = [look.number % 251 for look in looks]  # what the fake fills them with
    assert [picture.mean() for picture in pictures] == pytest.approx(
        drawn, abs=5 if name.endswith(".mp4") else 0
    )
    assert shown(qtbot, open_page).look.orbit == eye


@pytest.mark.parametrize("name", ["turn.mp4", "turn"])
def test_a_cancelled_turntable_leaves_nothing_and_the_view_as_it_was(
    qtbot, open_page: View3dPage, tmp_path: Path, name: str
) -> None:
    assert open_page.save_film("turntable", tmp_path / name) is None
    qtbot.waitUntil(lambda: any(tmp_path.iterdir()), timeout=BOUND_MS)
    assert open_page._filming is not None
    open_page._filming.findChild(QAbstractButton).click()
    qtbot.waitUntil(lambda: open_page._filming is None, timeout=BOUND_MS)
    assert not any(tmp_path.iterdir())
    shown(qtbot, open_page)


def test_a_turntable_replaces_no_folder_with_files(open_page: View3dPage, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    failed = open_page.save_film("turntable", tmp_path)
    assert failed is not None
    assert "holds other files" in failed.what
    assert failed.remedy == "choose a new name"


@pytest.mark.parametrize(
    ("said", "kind", "path"),
    [("lion", "Video", "lion.mp4"), ("lion.v2.mp4", "Video", "lion.v2.mp4"), ("lion.mp4", "PNG", "lion"),
     ("lion.v2", "PNG", "lion.v2"), ("", "Video", None), ("mine", "Video", None)],
)  # fmt: skip
def test_a_turntable_gets_the_ending_of_its_kind_and_replaces_nothing_unasked(
    open_page: View3dPage,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    said: str,
    kind: str,
    path: str | None,
) -> None:
    (tmp_path / "mine.mp4").touch()
    saved: list[tuple[str, Path]] = []
    told: list[Trouble] = []

    def choose(parent: QWidget, title: str, name: str, kinds: str) -> tuple[str, str]:
        chosen = next(one for one in kinds.split(";;") if one.startswith(kind))
        return (str(tmp_path / said), chosen) if said else ("", "")

    monkeypatch.setattr("app.views.view3d.page.QFileDialog.getSaveFileName", choose)
    monkeypatch.setattr("app.views.view3d.page.show_trouble", lambda parent, failed: told.append(failed))
    monkeypatch.setattr(open_page, "save_film", lambda kind, to: saved.append((kind, to)))
    for film in ("turntable", "path"):
        saved.clear()
        told.clear()
        open_page._actions[film].trigger()
        assert saved == ([] if path is None else [(film, tmp_path / path)])
        assert [one.remedy for one in told] == (["choose another name"] if said == "mine" else [])


def test_a_turntable_that_cannot_be_written_says_so(
    qtbot, open_page: View3dPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Trouble] = []
    monkeypatch.setattr("app.views.view3d.page.show_trouble", lambda parent, failed: told.append(failed))
    assert open_page.save_film("turntable", tmp_path / "nowhere" / "turn.mp4") is None
    qtbot.waitUntil(lambda: bool(told), timeout=BOUND_MS)
    assert "cannot be written" in told[0].what
    assert told[0].remedy


def test_the_eye_keeps_home_when_the_window_changes_its_shape(qtbot, open_page: View3dPage) -> None:
    before = open_page.state.eye.distance
    open_page.resize(420, 640)
    qtbot.waitUntil(lambda: open_page.state.eye.distance > before, timeout=BOUND_MS)
    qtbot.waitUntil(
        lambda: (
            (open_page.canvas.picture.width, open_page.canvas.picture.height)
            == open_page.canvas.device_size()
        ),
        timeout=BOUND_MS,
    )


# When the drawing process fails


def test_a_killed_child_comes_back_with_the_same_eye(qtbot, own_page: View3dPage) -> None:
    qtbot.keyClick(own_page.canvas, Qt.Key.Key_Left)
    eye = own_page.state.eye
    old = child(own_page)
    os.kill(old, signal.SIGKILL)
    qtbot.waitUntil(
        lambda: own_page.status.restarts == 1 and own_page.status.state == "showing", timeout=BOUND_MS
    )
    assert own_page.state.eye == eye
    assert child(own_page) != old
    assert "SIGKILL" in own_page.banner.text()
    assert not own_page.cover.isVisible()  # the last picture stays


def test_a_hung_child_never_stops_the_window(qtbot, page: Open, session: Path) -> None:
    one = page(patience=SHARP)
    one.show_session(session)
    shown(qtbot, one)
    gaps, last = [], [time.monotonic()]

    def tick() -> None:
        now = time.monotonic()
        gaps.append(now - last[0])
        last[0] = now

    timer = QTimer()
    timer.timeout.connect(tick)
    timer.start(5)
    os.kill(child(one), signal.SIGSTOP)
    for _ in range(20):
        qtbot.keyClick(one.canvas, Qt.Key.Key_Left)
    qtbot.waitUntil(lambda: one.status.restarts == 1 and one.status.state == "showing", timeout=BOUND_MS)
    shown(qtbot, one)
    timer.stop()
    assert max(gaps) < 1.0  # the child was silent for longer than that; alone, gaps are some ten milliseconds


def test_after_too_many_restarts_a_person_may_try_again(qtbot, page: Open, session: Path) -> None:
    one = page("--die-at", "load", patience=BRIEF)
    one.show_session(session)
    qtbot.waitUntil(lambda: one.status.state == "failed", timeout=BOUND_MS)
    assert one.cover.isVisible()
    assert one.cover.again.isVisible()
    one.cover.copy.click()
    from PySide6.QtGui import QGuiApplication

    assert "fake: dying at load" in QGuiApplication.clipboard().text()
    one.cover.again.click()
    qtbot.waitUntil(lambda: one.status.state != "failed", timeout=BOUND_MS)


def test_a_machine_without_graphics_is_told(qtbot, page: Open, session: Path) -> None:
    one = page("--unable")
    one.show_session(session)
    qtbot.waitUntil(lambda: one.status.state == "unable", timeout=BOUND_MS)
    assert "it is a fake" in one.cover.what.text()
    assert one.cover.remedy.text() == "Use a real one"
    assert one.cover.again.isVisible()


def test_a_damaged_session_is_told(qtbot, page: Open, session: Path) -> None:
    one = page("--refuse")
    one.show_session(session)
    qtbot.waitUntil(lambda: one.status.state == "refused", timeout=BOUND_MS)
    assert one.cover.what.text() == "It is damaged"
    assert one.cover.remedy.text() == "Restore it"


def test_closing_the_page_ends_the_child(qtbot, own_page: View3dPage) -> None:
    old = child(own_page)
    own_page.close()
    with pytest.raises(ProcessLookupError):
        os.kill(old, 0)


# For everybody


def test_every_control_has_a_name_and_is_reached_by_key(open_page: View3dPage) -> None:
    assert open_page.accessibleName()
    for kind in (QAbstractButton, QAbstractSlider, QComboBox):
        for widget in open_page.panel.findChildren(kind):
            if (
                widget.objectName().startswith("qt_")
                or isinstance(widget.parent(), QComboBox)
                or not widget.isVisible()
            ):
                continue
            if widget.metaObject().className() == "QScrollBar":
                continue
            assert widget.accessibleName(), widget
            assert widget.focusPolicy() & Qt.FocusPolicy.TabFocus or isinstance(widget, QAbstractButton), (
                widget
            )
    assert open_page.canvas.accessibleName()
    assert open_page.canvas.accessibleDescription()


def test_shortcuts_are_all_different_and_said(open_page: View3dPage) -> None:
    keys = [
        shortcut.toString() for action in open_page.findChildren(QAction) for shortcut in action.shortcuts()
        if action in open_page.actions()
    ]  # fmt: skip
    assert len(keys) == len(set(keys)) >= 15
    assert all(QKeySequence(key) for key in keys)
    assert all(action.text() and action.toolTip() for action in open_page.actions())


def test_no_text_is_cut_off(open_page: View3dPage) -> None:
    for label in open_page.panel.findChildren(QLabel):
        if label.isVisible() and label.text():
            assert label.width() >= label.fontMetrics().horizontalAdvance(label.text()), label.text()
    for button in open_page.panel.findChildren(QAbstractButton):
        with_text = (
            getattr(button, "toolButtonStyle", lambda: None)() != Qt.ToolButtonStyle.ToolButtonIconOnly
        )
        if button.isVisible() and with_text:
            assert button.width() >= button.fontMetrics().horizontalAdvance(button.text()), button.text()


def test_nothing_heavy_is_imported_for_the_page() -> None:
    import subprocess

    code = "import sys, app.views.view3d.page; print([m for m in ('open3d','torch','cv2','numba','scipy') if m in sys.modules])"
    root = Path(__file__).parents[3]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env={**os.environ, "PYTHONPATH": f"{root}:{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_the_page_is_a_widget_made_with_its_parent_alone(qtbot) -> None:
    parent = QWidget()
    qtbot.addWidget(parent)
    one = View3dPage(parent)
    assert one.title
    assert one.parent() is parent


def test_two_points_in_space_and_a_length_set_the_scale(
    open_page: View3dPage, tmp_path: Path, qtbot, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions.create(tmp_path / "ball.session", "linear", {"make": "", "model": "", "width": 40, "height": 30})
    folder = furnace.finished(tmp_path / "ball.session")
    monkeypatch.setattr(open_page, "_session", folder)
    row = open_page.scale
    row.show_session(folder)
    open_page._actions["measure"].trigger()
    qtbot.waitUntil(row.isVisible, timeout=BOUND_MS)
    pose = showing.pose_of(open_page.state.contents, showing.standing(open_page.state))
    assert pose is not None
    for pixel in ((14.5, 15.5), (25.5, 15.5)):
        _, point = on_surface(pixel, (40, 30), furnace.surface(), furnace.CAMERA)
        open_page._mark((point - pose[:, 3]) @ pose[:, :3])  # as the drawing process answers a click
        assert np.allclose(row.marks[-1].toTuple(), np.array(pixel) / 40, atol=1e-6)
    assert len(open_page.canvas._marks) == 2
    assert row.said.text().endswith("scene units apart")
    row.length.setValue(50.0)
    row.set.click()
    qtbot.waitUntil(lambda: row.said.text() == "50 mm apart", timeout=BOUND_MS)
    kept = scale_edit.read(folder)
    assert kept is not None
    assert (np.round(kept.points, 3).tolist(), kept.length_m) == ([[14.5, 15.5], [25.5, 15.5]], 0.05)
    marks = len(row.marks)
    open_page.canvas.clicked.emit(0.5, 0.5)
    qtbot.waitUntil(lambda: len(row.marks) != marks, timeout=BOUND_MS)  # a third begins anew
    row.leave()
    assert not len(open_page.canvas._marks)
