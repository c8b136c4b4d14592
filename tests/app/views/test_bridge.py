"""Calls from other threads arrive in the window's, in order, and never once it is gone."""

import threading

from PySide6.QtCore import QObject, QThread
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from app.views.bridge import Bridge
from tests.app.views.conftest import until


def from_a_thread(call) -> None:
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()


def test_calls_arrive_in_order_in_the_windows_thread(qtbot: QtBot) -> None:
    widget, heard = QWidget(), []
    qtbot.addWidget(widget)
    send = Bridge(widget).queued(
        lambda number: heard.append((number, QThread.currentThread() is widget.thread()))
    )
    from_a_thread(lambda: [send(number) for number in range(100)])
    assert heard == []
    until(qtbot, lambda: len(heard) == 100)
    assert heard == [(number, True) for number in range(100)]


def test_of_states_only_the_newest_arrives(qtbot: QtBot) -> None:
    widget, heard = QWidget(), []
    qtbot.addWidget(widget)
    send = Bridge(widget).latest(heard.append)
    from_a_thread(lambda: [send(number) for number in range(100)])
    until(qtbot, lambda: heard)
    qtbot.wait(10)
    assert heard == [99]
    send(100)
    until(qtbot, lambda: heard == [99, 100])


def test_nothing_arrives_once_the_widget_is_gone(qtbot: QtBot) -> None:
    widget, heard = QObject(), []
    bridge = Bridge(widget)
    queued, latest = bridge.queued(heard.append), bridge.latest(heard.append)
    queued(1)
    bridge.close()
    del widget
    queued(2)
    from_a_thread(lambda: latest(3))
    qtbot.wait(10)
    assert heard == []
