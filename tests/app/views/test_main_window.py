"""The window opens light, opens what is dropped on it, and never closes over something that runs without asking."""

import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDragLeaveEvent, QDropEvent
from pytestqt.qtbot import QtBot

from app.settings import Settings
from app.views import theme
from app.views.importing import ImportDialog
from app.views.main_window import MainWindow
from app.views.pages import PAGES, PageRow, load
from app.views.process.page import ProcessPage
from app.views.trouble import TroubleDialog
from app.work import queue_file
from app.work.jobs import JobState
from tests.app.calls import ROOT
from tests.app.plans import Questions
from tests.app.views.conftest import active, make_session, stop, until
from tests.app.work.children import WILLING, Heard, job

HEAVY = (
    "torch", "open3d", "cv2", "pycolmap", "mitsuba", "numba", "matplotlib", "pyqtgraph", "scipy", "rawpy", "OpenEXR",
    "numpy",
)  # fmt: skip


def test_the_window_opens_without_heavy_libraries() -> None:
    code = (
        "import sys, app.views.main_window, app.views.application, app.views.start.page\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"


def test_it_opens_on_the_start_page_and_loads_no_other(window: MainWindow) -> None:
    assert list(window._pages) == ["start"]
    assert window.rail.buttons["start"].isChecked()
    assert window.windowTitle() == "Roomlight"


@pytest.mark.parametrize("row", PAGES, ids=lambda row: row.key)
def test_every_page_can_be_shown_by_its_key(window: MainWindow, row: PageRow, qtbot: QtBot) -> None:
    from PySide6.QtGui import QAction

    (action,) = [
        a for a in window.findChildren(QAction) if row.shortcut in [k.toString() for k in a.shortcuts()]
    ]
    action.trigger()
    page = window.stack.currentWidget()
    assert page is window._pages[row.key]
    assert window.rail.buttons[row.key].isChecked()
    assert isinstance(page, load(row))


def test_opening_a_session_names_it_and_tells_every_page(
    window: MainWindow, session: Path, qtbot: QtBot
) -> None:
    window.show_page("process")
    window.show_page("start")
    window.go_to_session(session)
    process = window.page("process")
    assert isinstance(process, ProcessPage)
    assert window.stack.currentWidget() is process
    assert str(session) in window.windowTitle()
    assert window.status.currentMessage() == "lion is open"
    assert window.shell.settings.value.recent[0] == str(session)
    until(qtbot, lambda: process.column.count() == 6)
    window.close_session()
    assert window.windowTitle() == "Roomlight"
    assert window.stack.currentWidget() is window.page("start")
    until(qtbot, lambda: process.column.count() == 0)


def test_what_is_no_session_is_told_and_the_open_one_stays(
    window: MainWindow, session: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    window.go_to_session(session)
    damaged = make_session(tmp_path / "owl.session")
    (damaged / "session.json").write_text("{")
    window.go_to_session(damaged)
    until(qtbot, lambda: window.findChildren(TroubleDialog))
    (dialog,) = window.findChildren(TroubleDialog)
    assert "damaged" in dialog.trouble.what
    assert window.shell.state.session.value == session
    assert str(damaged) not in window.shell.settings.value.recent
    dialog.close()


def drop(window: MainWindow, *paths: Path) -> None:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    event = QDropEvent(
        QPointF(300, 300),
        Qt.DropAction.CopyAction,
        data,
        Qt.MouseButton.LeftButton,
        Qt.KeyboardModifier.NoModifier,
    )
    window.dropEvent(event)


def test_a_dropped_session_is_opened(window: MainWindow, session: Path, qtbot: QtBot) -> None:
    drop(window, session)
    until(qtbot, lambda: window.shell.state.session.value == session)


def test_a_dropped_folder_of_photographs_is_to_be_imported(
    window: MainWindow, tmp_path: Path, qtbot: QtBot
) -> None:
    (tmp_path / "renders").mkdir()
    drop(window, tmp_path / "renders")
    until(qtbot, lambda: window.findChildren(ImportDialog))
    (dialog,) = window.findChildren(ImportDialog)
    assert dialog.folder.text() == str(tmp_path / "renders")
    dialog.close()


def test_what_is_dragged_over_the_window_is_told_where_it_would_land(
    window: MainWindow, session: Path, tmp_path: Path
) -> None:
    (tmp_path / "renders").mkdir()
    for path, words in ((session, "Open lion"), (tmp_path / "renders", "Import the photographs in renders")):
        data = QMimeData()
        data.setUrls([QUrl.fromLocalFile(str(path))])
        where = QPoint(300, 300), Qt.DropAction.CopyAction
        event = QDragEnterEvent(*where, data, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier)
        window.dragEnterEvent(event)
        assert event.isAccepted()
        assert window.drop_mark.isVisible()
        assert window.drop_mark.words == words
        window.dragLeaveEvent(QDragLeaveEvent())
        assert not window.drop_mark.isVisible()


def test_an_idle_window_closes_at_once_and_keeps_its_size(window: MainWindow, questions: Questions) -> None:
    window.resize(900, 610)  # the screen of the tests is small
    assert window.close()
    assert questions.closed
    again = MainWindow(Settings(), Questions())  # type: ignore[arg-type]
    assert again.height() == 610
    again.deleteLater()


def test_closing_asks_while_something_runs_and_staying_changes_nothing(
    window: MainWindow, session: Path, qtbot: QtBot
) -> None:
    run = job(WILLING, "lion", request={"session": str(session)})
    heard = Heard(run)
    window.shell.board.enqueue(run)
    heard.wait(lambda status: status.stage == "hdr")
    assert not window.close()
    assert not window.close()  # asked once
    question = window.closing.question
    assert question is not None
    assert "lion" in question.text()
    question.reject()
    assert window.isVisible()
    assert run.status.state is JobState.RUNNING


def test_stopping_and_closing_ends_what_runs_and_remembers_the_queue(
    window: MainWindow, session: Path, qtbot: QtBot
) -> None:
    run, beside, waiting = (
        job(WILLING, name, request={"session": str(session)}) for name in ("run", "beside", "waiting")
    )
    heard = Heard(run)
    window.shell.board.enqueue(run)
    window.shell.board.enqueue(waiting)
    window.shell.board.start(beside)
    heard.wait(lambda status: status.stage == "hdr")
    window.close()
    assert window.closing.question is not None
    (agree,) = [button for button in window.closing.question.buttons() if "Stop" in button.text()]
    agree.click()
    # On a busy machine the children may have ended before the click returns: the window may be gone by now.
    until(qtbot, lambda: not window.isVisible())
    assert run.status.state is beside.status.state is JobState.CANCELLED
    assert [other.status.name for other in queue_file.read()] == ["run", "waiting"]


def test_a_job_that_does_not_stop_is_ended_after_patience(window: MainWindow, qtbot: QtBot) -> None:
    from app.views.closing import Closing

    deaf = job('emit("stage", name="deaf", number=1, count=1)\nwhile True: time.sleep(60)', patience_s=None)
    heard = Heard(deaf)
    window.shell.board.start(deaf)
    heard.wait(lambda status: status.stage == "deaf")
    closing = Closing(window, window.shell.board, patience_ms=1)
    with qtbot.waitSignal(closing.stopped, timeout=30_000):
        closing.agree()
    assert deaf.status.ended


def test_the_queue_of_last_time_waits_for_a_word(questions: Questions, session: Path, qtbot: QtBot) -> None:
    from app.work.queue import Board

    board = Board()
    board.hold(True)
    board.enqueue(job(WILLING, "lion", request={"session": str(session), "device": "cpu"}))
    queue_file.write(board)
    window = MainWindow(Settings(), questions)  # type: ignore[arg-type]
    qtbot.addWidget(window)
    assert window.shell.board.held
    (back,) = window.shell.board.queue
    assert (back.status.name, back.status.state) == ("lion", JobState.QUEUED)
    stop(window.shell.board)


def test_a_damaged_settings_file_is_said_and_the_window_opens(
    qtbot: QtBot, questions: Questions, tmp_path: Path
) -> None:
    path = tmp_path / "settings.toml"
    path.write_text("theme = ")
    window = MainWindow(Settings(path), questions)  # type: ignore[arg-type]
    qtbot.addWidget(window)
    window.show()
    assert "damaged" in window.status.currentMessage()


def test_hidden_pages_change_their_colours_too(window: MainWindow, qtbot: QtBot, qapp) -> None:
    theme.install(qapp, "light")
    window.show_page("process")
    rail = window.rail.buttons["start"].icon().pixmap(24).toImage()
    start = window.page("start")
    tile = start.add.icon().pixmap(28).toImage()  # type: ignore[attr-defined]
    theme.choose("dark")
    until(qtbot, lambda: window.rail.buttons["start"].icon().pixmap(24).toImage() != rail)
    window.show_page("start")
    until(qtbot, lambda: start.add.icon().pixmap(28).toImage() != tile)  # type: ignore[attr-defined]


def test_undo_belongs_to_the_page_in_view(window: MainWindow, session: Path, qtbot: QtBot) -> None:
    window.go_to_session(session)
    process = window.page("process")
    assert isinstance(process, ProcessPage)
    until(qtbot, lambda: process.column.count() == 6)
    process.bar.seed.setValue(9)
    assert window.undo.canUndo()
    window.show_page("start")
    assert not window.undo.canUndo()
    window.show_page("process")
    window.undo.activeStack().undo()
    until(qtbot, lambda: process.bar.seed.value() == 0)


def test_a_close_event_while_stopping_waits(window: MainWindow, qtbot: QtBot) -> None:
    run = job(WILLING, "lion")
    heard = Heard(run)
    window.shell.board.start(run)
    heard.wait(lambda status: status.stage == "hdr")
    window.closing.agreed = True
    event = QCloseEvent()
    window.closeEvent(event)
    assert not event.isAccepted()
    assert window.closing.question is None


def test_moving_over_the_window_is_taken_where_it_is_a_folder(window: MainWindow) -> None:
    data = QMimeData()
    data.setText("words")
    event = Mock(spec=QDragEnterEvent, mimeData=Mock(return_value=data))
    window.dragEnterEvent(event)
    event.acceptProposedAction.assert_not_called()
    data.setUrls([QUrl.fromLocalFile("/")])
    window.dragEnterEvent(event)
    event.acceptProposedAction.assert_called_once()


def test_full_screen_and_back_leaves_a_maximised_window_maximised(window: MainWindow) -> None:
    from PySide6.QtGui import QAction

    (action,) = [a for a in window.findChildren(QAction) if a.shortcut().toString() == "F11"]
    window.setWindowState(Qt.WindowState.WindowMaximized)
    action.trigger()
    assert window.isFullScreen()
    action.trigger()
    assert window.isMaximized()
    assert not window.isFullScreen()


def test_one_line_of_the_rail_is_lit_whoever_turned_the_page(
    window: MainWindow, session: Path, qtbot: QtBot
) -> None:
    active(window, qtbot)
    window.rail.buttons["start"].setFocus()
    window.go_to_session(session)
    assert window.rail.buttons["process"].hasFocus()
    other = MainWindow(Settings(), window.shell.enquiries)
    qtbot.addWidget(other)
    other.rail.buttons["start"].setFocus()
    other.show_page("charts")  # before it is on the screen
    other.show()
    active(other, qtbot)
    assert other.focusWidget() is other.rail.buttons["charts"]
