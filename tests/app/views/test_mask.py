"""The mask page by hand and by keys: strokes are seen, saved, taken back, and used when the object is found again."""

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QImage, QPointingDevice, QTabletEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from app import processing
from app.mask_files import STROKES, WAITING
from app.masking import ADD, NOTHING, TAKE
from app.settings import Settings
from app.state import State, trouble
from app.views.mask.bar import grown
from app.views.mask.page import MaskPage
from app.views.pages import Shell, Wishes
from app.work import answers
from app.work.enquiries import Answer
from app.work.queue import Board
from engine.errors import RoomlightError
from engine.io import session as sessions
from engine.pipeline import run, stage_table
from engine.pipeline.settings import Settings as Asked
from tests.app import sessions as small
from tests.app.views.conftest import stop, until
from tests.app.views.test_maps import nameless
from tests.app.work.children import QUICK, WILLING, job

Key, Left = Qt.Key, Qt.MouseButton.LeftButton


class Planner:
    """Stands in for the child that answers: the engine's own plan, at once."""

    def ask(self, question: str, then: Any, **facts: Any) -> int:
        try:
            then(Answer(answers.plan(facts)))
        except RoomlightError as error:
            then(Answer(None, trouble(str(error))))
        return 0

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def processed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs developed, and the object found: a given mask of rows 8 to 15, columns 10 to 19."""
    made = small.small(tmp_path_factory.mktemp("mask"))
    run.process(sessions.open_session(made), stage_table.stages(), Asked(), "cpu", "segment")
    return made


@pytest.fixture
def session(processed: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(processed, tmp_path / "lion.session"))


@pytest.fixture
def shell(qtbot: QtBot) -> Iterator[Shell]:
    board = Board()
    yield Shell(State(), board, Settings(), Planner(), Wishes())  # type: ignore[arg-type]
    stop(board)


@pytest.fixture
def page(qtbot: QtBot, shell: Shell) -> MaskPage:
    made = MaskPage(None)
    qtbot.addWidget(made)
    made.use(shell)
    made.resize(900, 640)
    made.show()
    return made


def ready(page: MaskPage, session: Path, qtbot: QtBot) -> MaskPage:
    page.show_session(session)
    until(qtbot, lambda: page.editor.painting is not None and page.canvas._levels)
    idle(page, qtbot)
    page._resize(3)
    page.canvas.setFocus()
    return page


def idle(page: MaskPage, qtbot: QtBot) -> None:
    until(qtbot, lambda: page.saving.saved and not page._background.busy)


def place(page: MaskPage, x: float, y: float):
    wide = page.canvas.viewport.picture.width
    return page.canvas.from_picture(QPointF(x / wide, y / wide)).toPoint()


def stroke(page: MaskPage, qtbot: QtBot, *way: tuple[float, float]) -> None:
    qtbot.mousePress(page.canvas, Left, pos=place(page, *way[0]))
    for at in way[1:]:
        qtbot.mouseMove(page.canvas, place(page, *at))
    qtbot.mouseRelease(page.canvas, Left, pos=place(page, *way[-1]))


def labels(page: MaskPage) -> np.ndarray:
    assert page.editor.painting is not None
    return page.editor.painting.labels


def saved(session: Path) -> np.ndarray | None:
    """Blue, green, red of what is on disk."""
    path = session / "edits" / STROKES
    return cv2.imread(str(path)) if path.exists() else None


def words(page: MaskPage) -> str:
    return page.line.words.text()


def grabbed(page: MaskPage) -> QImage:
    return page.canvas.grab().toImage()


def test_without_a_session_it_says_what_to_do(page: MaskPage) -> None:
    assert "No session is open" in page.empty.what.text()
    assert [button.text() for button in page.empty.buttons] == ["&Open session…", "Open &demo"]
    assert not page.run.isEnabled()


def test_photograph_and_object_are_shown(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    assert page.stack.currentWidget() is page.canvas
    assert "given mask" in words(page)
    assert nameless(page) == []
    shown = grabbed(page)
    qtbot.keyClick(page.canvas, Key.Key_V)
    plain = grabbed(page)
    inside, outside = place(page, 15, 12), place(page, 28, 4)
    assert shown.pixelColor(inside) != plain.pixelColor(inside)
    assert shown.pixelColor(outside) == plain.pixelColor(outside)


def test_every_view_and_the_mean_are_shown(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    page.views.overlay.setChecked(False)
    seen = []
    for keys in (Key.Key_M, Key.Key_PageDown, Key.Key_PageDown, Key.Key_PageUp):
        qtbot.keyClick(page.canvas, keys)
        idle(page, qtbot)
        seen.append((page.views.name.text(), grabbed(page)))
    assert [name for name, _ in seen] == ["Mean over the views", "0000  (1/8)", "0001  (2/8)", "0000  (1/8)"]
    assert seen[1][1] == seen[3][1] != seen[2][1] != seen[0][1]
    qtbot.keyClick(page.canvas, Key.Key_PageUp)
    assert page.views.chosen == 7
    before = grabbed(page)
    page.views.ev.setValue(3)
    idle(page, qtbot)
    assert grabbed(page) != before


def test_a_stroke_is_seen_saved_and_taken_back(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    before = grabbed(page)
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    assert (labels(page)[3, 3:9] == ADD).all()
    at = place(page, 6.2, 3.7)
    assert grabbed(page).pixelColor(at) != before.pixelColor(at)
    idle(page, qtbot)
    on_disk = saved(session)
    assert on_disk is not None
    assert (on_disk[3, 3:9] == (0, 255, 0)).all()
    page.undo_stack.undo()
    assert not labels(page).any()
    idle(page, qtbot)
    assert saved(session) is None
    page.undo_stack.redo()
    assert (labels(page)[3, 3:9] == ADD).all()
    idle(page, qtbot)
    np.testing.assert_array_equal(saved(session), on_disk)


def test_keys_choose_tool_side_and_size(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    for key, tool in ((Key.Key_E, "eraser"), (Key.Key_P, "polygon"), (Key.Key_B, "brush")):
        qtbot.keyClick(page.canvas, key)
        assert page.editor.tool == tool
        assert [name for name, button in page.tools.tools.items() if button.isChecked()] == [tool]
    for key, adds in ((Key.Key_R, False), (Key.Key_A, True), (Key.Key_X, False), (Key.Key_X, True)):
        qtbot.keyClick(page.canvas, key)
        assert page.editor.adds == adds
        assert page.tools.sides[adds].isChecked()
    qtbot.keyClick(page.canvas, Key.Key_BracketRight)
    assert page.editor.size == page.tools.size_box.value() == 4
    qtbot.keyClick(page.canvas, Key.Key_BracketLeft)
    qtbot.keyClick(page.canvas, Key.Key_BracketLeft)
    assert page.editor.size == 2
    page.tools.size_box.setValue(9)
    assert page.editor.size == 9


def test_every_size_is_left_by_the_next_press() -> None:
    assert all(grown(size, -1) < size < grown(size, 1) for size in range(1, 400))


def test_painting_by_keys_alone(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    page._resize(1)
    qtbot.keyClick(page.canvas, Key.Key_R)
    qtbot.keyClick(page.canvas, Key.Key_Left)
    start = page.canvas.viewport.pixel()
    assert start is not None
    x, y = start
    qtbot.keyClick(page.canvas, Key.Key_Space)
    assert np.argwhere(labels(page)).tolist() == [[y, x]]
    qtbot.keyPress(page.canvas, Key.Key_Space)
    qtbot.keyClick(page.canvas, Key.Key_Right, Qt.KeyboardModifier.ShiftModifier)
    qtbot.keyRelease(page.canvas, Key.Key_Space)
    qtbot.keyClick(page.canvas, Key.Key_Down)
    assert (labels(page)[y, x : x + 11] == TAKE).all()
    assert (labels(page) > 0).sum() == 11
    assert page.undo_stack.count() == 2


def test_a_polygon_by_mouse(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    qtbot.keyClick(page.canvas, Key.Key_P)
    corners = [(2.0, 2.0), (9.0, 2.0), (9.0, 7.0), (30.0, 20.0)]
    for at in corners:
        qtbot.mouseClick(page.canvas, Left, pos=place(page, *at))
    assert len(page.editor.corners) == 4
    qtbot.keyClick(page.canvas, Key.Key_Backspace)
    qtbot.mouseClick(page.canvas, Left, pos=place(page, 2.0, 7.0))
    assert not labels(page).any()
    qtbot.mouseMove(page.canvas, place(page, 20, 20))  # Enter closes wherever the mouse went
    qtbot.keyClick(page.canvas, Key.Key_Return)
    expected = np.zeros(labels(page).shape, bool)
    expected[2:7, 2:9] = True
    np.testing.assert_array_equal(labels(page) == ADD, expected)
    assert page.editor.corners == []
    # Closed by a double click, and by a click on the first corner.
    for close in ("double", "first"):
        page.undo_stack.undo()
        for at in corners[:3]:
            qtbot.mouseClick(page.canvas, Left, pos=place(page, *at))
        if close == "double":
            qtbot.mouseDClick(page.canvas, Left, pos=place(page, *corners[2]))
        else:
            qtbot.mouseClick(page.canvas, Left, pos=place(page, *corners[0]))
        assert labels(page)[3, 7] == ADD
    qtbot.mouseClick(page.canvas, Left, pos=place(page, 20, 20))
    qtbot.keyClick(page.canvas, Key.Key_Escape)
    assert page.editor.corners == []


def test_a_polygon_by_keys_alone(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    qtbot.keyClick(page.canvas, Key.Key_P)
    for key, presses in ((Key.Key_Left, 1), (Key.Key_Right, 6), (Key.Key_Down, 5), (Key.Key_Left, 6)):
        for _ in range(presses):
            qtbot.keyClick(page.canvas, key)
        qtbot.keyClick(page.canvas, Key.Key_Return)
    assert len(page.editor.corners) == 4
    qtbot.keyClick(page.canvas, Key.Key_Return)  # where the last corner is: closes
    assert (labels(page) == ADD).sum() in range(25, 43)


def test_a_pen_paints_as_hard_as_it_is_pressed(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    page._resize(9)
    painted = []
    for pressure in (0.1, 1.0):
        for kind, buttons in (
            (QEvent.Type.TabletPress, Left),
            (QEvent.Type.TabletRelease, Qt.MouseButton.NoButton),
        ):
            at = QPointF(place(page, 16, 12))
            QApplication.sendEvent(
                page.canvas,
                QTabletEvent(kind, QPointingDevice.primaryPointingDevice(), at, at, pressure, 0, 0, 0, 0, 0,
                             Qt.KeyboardModifier.NoModifier, Left, buttons),
            )  # fmt: skip
        painted.append(int((labels(page) > 0).sum()))
        page.undo_stack.undo()
    assert 0 < painted[0] < painted[1] / 3


def test_zoom_and_pan_as_in_other_pictures(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    port = page.canvas.viewport
    whole = port.span
    qtbot.keyClick(page.canvas, Key.Key_F)
    assert port.span > whole
    qtbot.keyClick(page.canvas, Key.Key_F, Qt.KeyboardModifier.ShiftModifier)
    assert port.span == whole
    qtbot.keyClick(page.canvas, Key.Key_Plus)
    assert port.span > whole
    centre = QPointF(port.centre)
    qtbot.mousePress(page.canvas, Qt.MouseButton.MiddleButton, pos=place(page, 10, 10))
    qtbot.mouseMove(page.canvas, place(page, 12, 10))
    qtbot.mouseRelease(page.canvas, Qt.MouseButton.MiddleButton, pos=place(page, 12, 10))
    assert port.centre != centre
    assert not labels(page).any()


def test_clearing_all_strokes_is_taken_back(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    assert not page.clear.isEnabled()
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    before = labels(page).copy()
    page.clear.trigger()
    assert not labels(page).any()
    page.undo_stack.undo()
    np.testing.assert_array_equal(labels(page), before)


def test_finding_again_uses_the_strokes(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    """The whole way, through a real child."""
    ready(page, session, qtbot)
    assert not page.run.isEnabled()
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    qtbot.keyClick(page.canvas, Key.Key_R)
    stroke(page, qtbot, (11.5, 9.5), (18.5, 9.5))
    assert page.run.isEnabled()
    page.run.trigger()
    until(qtbot, lambda: page._developed.object[3, 5], 120_000)
    assert not page._developed.object[9, 12:18].any()
    until(qtbot, lambda: "given mask" in words(page) and not page.run.isEnabled())
    # Taking it all back leads to the first result, which is still there.
    page.undo_stack.setIndex(0)
    until(qtbot, lambda: not page._developed.object[3, 5])
    assert page._developed.object.sum() == 80


def test_the_plan_tells_why_the_object_is_to_be_found_again(
    page: MaskPage, session: Path, qtbot: QtBot
) -> None:
    ready(page, session, qtbot)
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    until(qtbot, lambda: "Strokes added" in words(page))


def test_progress_is_shown_and_finding_is_cancelled(
    page: MaskPage, session: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready(page, session, qtbot)
    asked = []

    def make(name, task, request):
        asked.append((task, request["session"], request["until"]))
        begun = 'emit("stage", name="segment", number=1, count=1)\nemit("progress", fraction=0.5, note="guessing")\n'
        return job(begun + WILLING.replace("hdr", "segment").partition("\n\n")[0].replace(
            'emit("stage", name="segment", number=1, count=1)', ""), name, task, request)  # fmt: skip

    monkeypatch.setattr(processing, "Job", make)
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    page.run.trigger()
    until(qtbot, lambda: "Finding the object: guessing" in words(page))
    assert asked == [("process", str(session), "segment")]
    assert (session / "edits" / STROKES).exists()  # saved before the run began
    assert page.line.bar.value() == 500
    assert not page.run.isEnabled()
    page.stop.trigger()
    until(qtbot, lambda: page.run.isEnabled())
    assert not page.stop.isVisible()


def test_a_run_that_fails_says_why_once(
    page: MaskPage, session: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, shell: Shell
) -> None:
    ready(page, session, qtbot)
    script = 'emit("failed", message="nothing stays put; give a mask")'
    monkeypatch.setattr(processing, "Job", lambda name, task, request: job(script, name, task, request))
    heard = []
    shell.wishes.trouble.connect(heard.append)
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    page.run.trigger()
    until(qtbot, lambda: heard)
    assert [(fault.what, fault.remedy) for fault in heard] == [("nothing stays put", "give a mask")]
    until(qtbot, lambda: page.run.isEnabled())


def test_photographs_are_developed_first(
    page: MaskPage, session: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    aside = session / "aside"
    (session / "stages").rename(aside)
    page.show_session(session)
    until(qtbot, lambda: "not developed" in page.empty.what.text())

    def make(name, task, request):
        return job(
            f"hear()\nos.rename({str(aside)!r}, {str(session / 'stages')!r})\n{QUICK}", name, task, request
        )

    monkeypatch.setattr(processing, "Job", make)
    page.empty.buttons[0].click()
    until(qtbot, lambda: "being developed" in page.empty.what.text() and page.model.job.value is not None)
    (run_,) = page._shell.board.queue
    until(qtbot, lambda: run_.status.active)
    run_.send("go")
    until(qtbot, lambda: page.editor.painting is not None)
    assert page.stack.currentWidget() is page.canvas


def test_strokes_are_kept_while_another_process_works_and_placed_when_it_ended(
    page: MaskPage, session: Path, qtbot: QtBot
) -> None:
    ready(page, session, qtbot)
    page.saving.settle_timer.setInterval(20)
    held, let_go = threading.Event(), threading.Event()

    def hold() -> None:
        with sessions.lock(sessions.open_session(session)):
            held.set()
            let_go.wait(60)

    other = threading.Thread(target=hold)
    other.start()
    assert held.wait(30)
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    until(qtbot, lambda: "is working on this session" in words(page))
    assert saved(session) is None
    assert (session / "edits" / WAITING).exists()
    page.find_again()
    until(qtbot, lambda: not page._find_wanted)
    assert page._shell.board.queue == ()
    let_go.set()
    other.join()
    until(qtbot, lambda: saved(session) is not None)
    until(qtbot, lambda: "working" not in words(page))


def test_leaving_the_session_or_the_page_saves_at_once(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    ready(page, session, qtbot)
    stroke(page, qtbot, (3.5, 3.5), (8.5, 3.5))
    page.show_session(None)
    assert page.undo_stack.count() == 0
    until(qtbot, lambda: saved(session) is not None)
    ready(page, session, qtbot)
    assert (labels(page)[3, 3:9] == ADD).all()
    page._pick_tool("eraser")
    stroke(page, qtbot, (3.5, 3.5), (3.5, 3.5))
    page.close()
    on_disk = saved(session)
    assert on_disk is not None
    assert labels(page)[3, 3] == NOTHING
    assert (on_disk[3, 3] == 0).all()


def test_a_broken_session_says_so(page: MaskPage, session: Path, qtbot: QtBot) -> None:
    (session / "session.json").write_text("{")
    page.show_session(session)
    until(qtbot, lambda: "damaged" in page.empty.what.text())
