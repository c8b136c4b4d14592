"""The sheet lists what there is: each key once, under where it belongs."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from app.settings import Settings
from app.views.main_window import MainWindow
from app.views.pages import PAGES
from app.views.shortcuts import SHORTCUT, ShortcutsDialog, collect
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
    told = [(line.parent().text(0), line.text(0), line.text(1)) for line in dialog.lines]
    whats = [what for _, what, _ in told]
    assert whats.count("Fit the object") == 3  # 3D, Maps and Mask, shown before or not
    assert sum("PgUp" in keys for *_, keys in told) == 4  # and Photographs
    assert "Undo" in whats
    assert (told[-3][0], told[-3][2]) == ("Mouse", "Right drag")
    dialog.close()


def test_other_keys_hold_at_once_and_after_a_restart_but_not_those_that_are_taken(
    window: MainWindow, qtbot: QtBot
) -> None:
    window.show_shortcuts()
    (dialog,) = window.findChildren(ShortcutsDialog)
    lines = {(line.parent().text(0), line.text(0)): line for line in dialog.lines}
    fit = lines["Maps", "Fit the object"]
    action = fit.data(0, SHORTCUT).of
    fit.setText(1, "Ctrl+E")
    assert "taken by Everywhere: Export" in dialog.said.text()
    assert (fit.text(1), action.shortcut().toString()) == ("F", "F")
    fit.setText(1, "K")
    assert action.shortcut().toString() == "K"
    assert Settings().value.shortcuts == {"Maps: Fit the object": "K"}
    again = MainWindow(Settings(), window.shell.enquiries)
    qtbot.addWidget(again)
    sheet = collect([("Maps", again.page("maps"))])
    assert [one.keys for one in sheet if one.what == "Fit the object"] == ["K"]
    dialog.restore.click()
    assert (fit.text(1), action.shortcut().toString()) == ("F", "F")
    assert not Settings().value.shortcuts
    dialog.close()


def test_whatever_names_a_key_names_the_one_in_force(window: MainWindow) -> None:
    tools, stop = window.page("mask").tools, window.page("capture").setup.stop  # type: ignore[attr-defined]
    mode, maps = window.page("maps").bar.modes[1], window.rail.buttons["maps"]  # type: ignore[attr-defined]
    exposure = window.page("maps").bar.ev  # type: ignore[attr-defined]
    remove = window.page("process").queue.remove  # type: ignore[attr-defined]

    def told() -> list[str]:
        tips = (widget.toolTip() for widget in (tools.sides[True], mode, maps, exposure, remove))
        return [*(tip[tip.index("(") :] for tip in tips), stop.text()]

    shipped = told()
    assert shipped[0] == "(A; X swaps)"
    assert stop.text() == "STOP  (Esc)"
    window.show_shortcuts()
    (dialog,) = window.findChildren(ShortcutsDialog)
    lines = {(line.parent().text(0), line.text(0)): line for line in dialog.lines}
    for *of, keys in (
        ("Mask", "Add to the object", "Y"), ("Mask", "Swap adding and taking", "A"), ("Everywhere", "Maps", "Ctrl+M"),
        ("Maps", "Photograph against re-rendering", ""), ("Maps", "Darker", "Ctrl+Down"), ("Process", remove.accessibleName(), "Del"),
        ("Capture", "Stop rig and camera", "F12"),
    ):  # fmt: skip
        lines[tuple(of)].setText(1, keys)
    assert told() == [
        "(Y; A swaps)",
        "(no key)",
        "(Ctrl+M)",
        "(E, Ctrl+Down; Shift+0 resets)",
        "(Del)",
        "STOP  (F12)",
    ]
    dialog.restore.click()
    assert told() == shipped
    dialog.close()


def test_question_mark_opens_the_sheet(window: MainWindow, qtbot: QtBot) -> None:
    active(window, qtbot)
    qtbot.keyClick(window, Qt.Key.Key_Question)
    until(qtbot, lambda: window.findChildren(ShortcutsDialog))
    (dialog,) = window.findChildren(ShortcutsDialog)
    for row in PAGES:
        assert row.shortcut in {line.text(1) for line in dialog.lines}
    assert "Keyboard shortcuts" in {line.text(0) for line in dialog.lines}
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
