"""The end of a run is told wherever one is, by the system where it can, and leads to the results."""

from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from app.views.main_window import MainWindow
from tests.app.views.conftest import until
from tests.app.work.children import job

DONE = 'emit("done", result={})'
FAILED = 'emit("failed", message="no light; add some")'


def run(window: MainWindow, session: Path, script: str) -> None:
    window.shell.board.enqueue(job(script, "lion", "process", {"session": str(session)}))


@pytest.mark.parametrize(
    ("script", "said", "leads"),
    [(DONE, "lion is processed", "maps"), (FAILED, "lion could not be processed", "process")],
)
def test_the_end_of_a_run_is_told_and_leads_on(
    window: MainWindow, session: Path, qtbot: QtBot, script: str, said: str, leads: str
) -> None:
    run(window, session, script)
    until(qtbot, window.notice.isVisible)
    assert window.notice.said.text() == said
    assert window.notice.geometry().right() < window.width()
    window.notice.go.click()
    assert window.shell.state.session.value == session
    assert window.stack.currentWidget() is window.page(leads)
    assert window.notice.isHidden()


def test_a_run_that_ends_between_two_looks_is_told_once(
    window: MainWindow, session: Path, qtbot: QtBot
) -> None:
    run(window, session, DONE)
    window.shell.board.queue[0].wait()  # the window's loop stands still meanwhile
    until(qtbot, window.notice.isVisible)
    window.notice.hide()
    window.notice._look()
    assert window.notice.isHidden()


def test_the_system_is_asked_while_another_program_is_in_front(
    window: MainWindow, session: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[str, str]] = []
    monkeypatch.setattr(type(window), "isActiveWindow", lambda self: False)
    monkeypatch.setattr("app.views.notice.QSystemTrayIcon.isSystemTrayAvailable", lambda: True)
    monkeypatch.setattr("app.views.notice.QSystemTrayIcon.supportsMessages", lambda: True)
    monkeypatch.setattr(
        "app.views.notice.QSystemTrayIcon.showMessage",
        lambda self, title, message, icon: told.append((title, message)),
    )
    run(window, session, FAILED)
    until(qtbot, lambda: told)
    assert told == [("lion could not be processed", "no light; add some")]


def test_the_process_page_of_the_same_session_says_so_itself(
    window: MainWindow, session: Path, qtbot: QtBot
) -> None:
    window.open_session(session)
    window.show_page("process")
    run(window, session, DONE)
    until(qtbot, lambda: window.shell.board.queue[0] in window.notice._ended)
    qtbot.wait(50)
    assert window.notice.isHidden()
