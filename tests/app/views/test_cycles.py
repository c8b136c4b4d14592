"""Widgets that hold each other die in the window's thread, whoever allocates."""

import gc
import threading
from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from app.views.cycles import collect_here
from tests.app.views.conftest import until


@pytest.fixture(scope="module", autouse=True)
def between_tests() -> Iterator[None]:
    """A thread that outlived its test would take down widgets."""
    assert not gc.isenabled()
    yield
    assert not gc.isenabled()


class Knot(QWidget):
    """A widget that only a look for cycles finds."""

    def __init__(self, died: list[int]) -> None:
        super().__init__()
        self._me, self._died = self, died

    def __del__(self) -> None:
        self._died.append(threading.get_ident())


def test_a_cycle_dies_in_the_windows_thread(qtbot: QtBot) -> None:
    gc.enable()
    window = QWidget()
    qtbot.addWidget(window)
    collect_here(window)
    died: list[int] = []
    Knot(died)
    kept: list[list[object]] = []
    # Ten thousand containers are far more than Python waits for.
    thread = threading.Thread(target=lambda: kept.extend([] for _ in range(10_000)))
    thread.start()
    thread.join()
    until(qtbot, lambda: died)
    assert died == [threading.get_ident()]
