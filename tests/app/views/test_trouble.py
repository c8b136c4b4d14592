"""The dialog says what happened and what to do, and hands out the details."""

from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

from app.state import Trouble
from app.views.trouble import show_trouble


def test_it_says_what_happened_and_what_to_do(qtbot: QtBot) -> None:
    dialog = show_trouble(None, Trouble("a.dng: is <cut> off", "copy it again", "Traceback"))
    qtbot.addWidget(dialog)
    shown = [label.text() for label in dialog.findChildren(QLabel)]
    assert "a.dng: is <cut> off" in shown
    assert "Copy it again" in shown
    assert dialog.isVisible()


def test_details_are_folded_away_and_can_be_copied(qtbot: QtBot) -> None:
    dialog = show_trouble(None, Trouble("what", "remedy", "Traceback: here"))
    qtbot.addWidget(dialog)
    assert not dialog.details.isVisible()
    dialog.show_details.click()
    assert dialog.details.isVisible()
    dialog.copy.click()
    assert QGuiApplication.clipboard().text() == "what\n\nremedy\n\nTraceback: here"


def test_without_details_there_is_nothing_to_unfold(qtbot: QtBot) -> None:
    dialog = show_trouble(None, Trouble("what"))
    qtbot.addWidget(dialog)
    assert not dialog.show_details.isVisible()
