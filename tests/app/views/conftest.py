"""Windows without a screen, settings and state of their own, and an engine that answers from a table."""

import contextlib
import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from app.settings import Settings
from app.state import State
from app.views.main_window import MainWindow
from app.views.pages import Shell, Wishes
from app.work.queue import Board
from tests.app.plans import Questions


@pytest.fixture(autouse=True)
def own_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("CONFIG", "STATE", "CACHE", "DATA"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / "xdg" / name.lower()))


@contextlib.contextmanager
def cycles_here() -> Iterator[None]:
    """No other thread looks for cycles, or widgets would die in it and the process with them: not even between two tests, which
    threads outlive that allocate, as the one that loads a window's other pages.
    """
    gc.disable()
    yield
    gc.collect()
    gc.enable()


@pytest.fixture(scope="package", autouse=True)
def package_cycles() -> Iterator[None]:
    with cycles_here():
        yield


@pytest.fixture(autouse=True)
def cycles() -> Iterator[None]:
    """Widgets die in this thread, as in the program; a test's are young."""
    yield
    gc.collect(1)


@pytest.fixture
def questions() -> Questions:
    return Questions(done=2)


@pytest.fixture
def shell(questions: Questions, qtbot: QtBot) -> Iterator[Shell]:
    """What pages share, without a window."""
    board = Board()
    yield Shell(State(), board, Settings(), questions, Wishes())  # type: ignore[arg-type]
    stop(board)


@pytest.fixture
def window(questions: Questions, qtbot: QtBot) -> Iterator[MainWindow]:
    made = MainWindow(Settings(), questions)  # type: ignore[arg-type]
    qtbot.addWidget(made)
    made.show()
    yield made
    stop(made.shell.board)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A session's folder as far as the window looks at it."""
    return make_session(tmp_path / "lion.session")


def make_session(folder: Path) -> Path:
    (folder / "shots").mkdir(parents=True)
    (folder / "session.json").write_text('{"schema": 1, "kind": "raw", "camera": {}, "rig": null}')
    return folder


def stop(board: Board) -> None:
    """End every child that a test left running."""
    board.hold(True)
    for job in board.active:
        job.kill()
        job.wait(30)


def active(window: QWidget, qtbot: QtBot) -> None:
    """Give the window the keyboard: without a window manager that takes effect only once it is on the screen."""
    until(qtbot, lambda: window.windowHandle() is not None and window.windowHandle().isExposed())
    window.activateWindow()
    until(qtbot, window.isActiveWindow)


def until(qtbot: QtBot, what: Callable[[], object], timeout_ms: int = 30_000) -> None:
    """Let the window live until `what` is true."""
    qtbot.waitUntil(lambda: bool(what()), timeout=timeout_ms)
