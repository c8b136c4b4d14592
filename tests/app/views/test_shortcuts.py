"""The sheet lists what there is: each key once, under where it belongs."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from app.views.main_window import MainWindow
from app.views.pages import PAGES
from app.views.shortcuts import ShortcutsDialog, collect
from tests.app.views.conftest import active, until


def test_actions_and_shortcuts_are_found_once(qtbot: QtBot) -> None:
    page, window = QWidget(), QWidget()
    qtbot.addWidget(window)
    page.setParent(window)
    action = QAction("&Undo…", page)
    action.setShortcuts([QKeySequence("Ctrl+Z"), QKeySequence("Alt+Backspace")])
    page.addAction(action)
    brush = QShortcut(QKeySequence("B"), page)
    brush.setWhatsThis("Brush")
    QShortcut(QKeySequence("X"), page)  # says nothing of itself
    QAction("Without keys", window)
    found = collect([("Mask", page), ("Everywhere", window)])
    assert [(s.group, s.keys, s.what) for s in found] == [
        ("Mask", "Ctrl+Z, Alt+Backspace", "Undo"),
        ("Mask", "B", "Brush"),
    ]


def test_a_key_that_two_pages_have_stands_under_both_and_undo_names_no_edit(
    window: MainWindow, qtbot: QtBot
) -> None:
    window.show_shortcuts()
    (dialog,) = window.findChildren(ShortcutsDialog)
    sheet = dialog.sheet.text()
    assert sheet.count("Fit the object") == 3  # 3D, Maps and Mask, shown before or not
    assert sheet.count("PgUp") == 4  # and Photographs
    assert "Undo preset" not in sheet
    assert "Mouse" in sheet
    dialog.close()


def test_question_mark_opens_the_sheet(window: MainWindow, qtbot: QtBot) -> None:
    active(window, qtbot)
    qtbot.keyClick(window, Qt.Key.Key_Question)
    until(qtbot, lambda: window.findChildren(ShortcutsDialog))
    (dialog,) = window.findChildren(ShortcutsDialog)
    for row in PAGES:
        assert row.shortcut in dialog.sheet.text()
    assert "Keyboard shortcuts" in dialog.sheet.text()
    dialog.close()


def test_no_two_actions_of_the_window_share_a_key(window: MainWindow) -> None:
    keys = [keys.toString() for action in window.actions() + window.findChildren(QAction) for keys in action.shortcuts()
            if action.shortcutContext() != Qt.ShortcutContext.WidgetShortcut]  # fmt: skip
    owners: dict[str, set[int]] = {}
    for action in window.findChildren(QAction):
        for key in action.shortcuts():
            if action.shortcutContext() != Qt.ShortcutContext.WidgetShortcut:
                owners.setdefault(key.toString(), set()).add(id(action))
    assert keys
    assert {key for key, who in owners.items() if len(who) > 1} == set()
