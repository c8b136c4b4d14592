"""*Open demo* leads to finished results; what does not ship is made in the background."""

import functools
import sys
from collections.abc import Mapping
from typing import Any

import pytest
from pytestqt.qtbot import QtBot

from app import demo
from app.views.main_window import MainWindow
from app.views.start.page import StartPage
from app.work.jobs import Job
from tests.app.views.conftest import make_session, until

LAYS_OUT = """
import json, sys
from tests.app.views.conftest import make_session
from pathlib import Path
make_session(Path(sys.argv[1]))
print(json.dumps({"event": "done", "result": {"session": sys.argv[1], "until": "hdr"}}))
"""


def open_demo(window: MainWindow) -> None:
    start = window.page("start")
    assert isinstance(start, StartPage)
    start.demo.click()


def test_the_first_time_it_is_laid_out_and_what_is_missing_is_queued(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    def command(task: str, request: Mapping[str, Any]) -> list[str]:
        assert task == "demo"
        return [sys.executable, "-c", LAYS_OUT, request["session"]]

    monkeypatch.setattr("app.views.demo.Job", functools.partial(Job, command=command))
    window.shell.board.hold(True)
    open_demo(window)
    open_demo(window)  # twice is once
    until(qtbot, lambda: window.shell.state.session.value == demo.place())
    assert window.stack.currentWidget() is window.page("maps")
    (job,) = window.shell.board.queue
    assert (job.task, job.request["until"]) == ("process", "hdr")


def test_afterwards_it_opens_at_once(window: MainWindow) -> None:
    make_session(demo.place())
    open_demo(window)
    assert window.shell.state.session.value == demo.place()
    assert window.stack.currentWidget() is window.page("maps")
    assert not window.shell.board.queue
