"""Every page: each control has a name for a screen reader, is reached by keyboard, and speaks through tr()."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QLabel,
    QLineEdit,
    QListView,
    QTabBar,
    QWidget,
)
from pytestqt.qtbot import QtBot

from app.state import Trouble
from app.views.main_window import MainWindow
from app.views.pages import PAGES
from tests.app.calls import ROOT
from tests.app.views.conftest import until

# What a person operates. Parts inside of these (the line of a spin box, a list that pops up) belong to them.
CONTROLS = (QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QLineEdit, QAbstractScrollArea)


def controls(root: QWidget) -> Iterator[QWidget]:
    """Visible and hidden controls under `root` that are not parts of another."""
    for widget in root.findChildren(QWidget):
        if not isinstance(widget, CONTROLS) and widget.focusPolicy() == Qt.FocusPolicy.NoFocus:
            continue
        # A label speaks its text; some can be clicked to copy it.
        if isinstance(widget, QLabel) or type(widget) is QWidget:
            continue
        if isinstance(widget, QTabBar) or widget.objectName().startswith("qt_"):
            continue
        parent = widget.parent()
        inside = False
        while isinstance(parent, QWidget) and parent is not root:
            inside = inside or isinstance(parent, QComboBox | QAbstractSpinBox | QLineEdit | QTabBar)
            inside = inside or (isinstance(parent, QListView) and isinstance(widget, QAbstractSlider))
            inside = inside or parent.objectName().startswith("qt_")
            parent = parent.parent()
        if not inside:
            yield widget


def nameless(root: QWidget) -> list[str]:
    """Controls a screen reader has no word for."""
    return [
        f"{type(widget).__name__} {widget.toolTip()!r} in {type(widget.parent()).__name__}"
        for widget in controls(root)
        if not widget.accessibleName() and widget.focusPolicy() != Qt.FocusPolicy.NoFocus
    ]


def unreachable(root: QWidget) -> list[str]:
    """Buttons that the keyboard cannot press: no focus by Tab and no shortcut."""
    return [
        f"{type(widget).__name__} {widget.accessibleName()!r}"
        for widget in controls(root)
        if isinstance(widget, QAbstractButton)
        and widget.isEnabled()
        and not widget.focusPolicy() & Qt.FocusPolicy.TabFocus
        and widget.shortcut().isEmpty()
        and widget.toolTip().count("(") == 0  # tool buttons name the shortcut of the action they stand for
    ]


@pytest.mark.parametrize("key", [row.key for row in PAGES])
def test_every_control_of_a_page_has_a_name_and_is_reached(
    window: MainWindow, session: Path, qtbot: QtBot, key: str
) -> None:
    window.open_session(session)
    window.show_page(key)
    qtbot.wait(50)
    assert nameless(window.page(key)) == []
    assert unreachable(window.page(key)) == []


def test_rail_and_status_bar_have_names(window: MainWindow) -> None:
    assert nameless(window.rail) == []
    assert nameless(window.status) == []


def test_dialogs_have_names(window: MainWindow, qtbot: QtBot) -> None:
    window.show_shortcuts()
    window.add_photographs(None)
    window.tell(Trouble("what", "remedy", "details"))
    until(qtbot, lambda: len([d for d in window.findChildren(QDialog) if d.isVisible()]) == 3)
    for dialog in window.findChildren(QDialog):
        assert nameless(dialog) == [], type(dialog)
        dialog.close()


def test_tab_walks_through_the_whole_start_page(window: MainWindow, qtbot: QtBot) -> None:
    window.activateWindow()
    page = window.page("start")
    page.new_capture.setFocus()  # type: ignore[attr-defined]
    seen = []
    for _ in range(60):
        focus = QApplication.focusWidget()
        if focus is not None:
            seen.append(focus.accessibleName())
        qtbot.keyClick(focus or window, Qt.Key.Key_Tab)
    assert {"New capture", "Open session", "Import photographs", "Start"} <= set(seen)


def test_arrows_walk_along_the_rail(window: MainWindow, qtbot: QtBot) -> None:
    window.activateWindow()
    window.rail.buttons["start"].setFocus()
    for row in PAGES[1:3]:
        qtbot.keyClick(QApplication.focusWidget(), Qt.Key.Key_Down)
        assert window.stack.currentWidget() is window.page(row.key)


def test_names_are_said_for_what_they_are(qtbot: QtBot) -> None:
    """The walk itself finds a control without a name."""
    from PySide6.QtWidgets import QPushButton, QVBoxLayout

    page = QWidget()
    qtbot.addWidget(page)
    layout = QVBoxLayout(page)
    good, bad, out = QPushButton("a"), QPushButton("b"), QPushButton("c")
    good.setAccessibleName("a")
    out.setAccessibleName("c")
    out.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    for button in (good, bad, out):
        layout.addWidget(button)
    assert len(nameless(page)) == 1
    assert len(unreachable(page)) == 1


SAID = {
    "setText", "setToolTip", "setWindowTitle", "setPlaceholderText", "setAccessibleName", "setAccessibleDescription",
    "setInformativeText", "addTab", "addMenu", "showMessage", "setTitle", "setLabelText", "setWhatsThis", "setHeaderLabels",
    "QLabel", "QPushButton", "QCheckBox", "QRadioButton", "QAction", "QGroupBox",
}  # fmt: skip
NAMES = {"Roomlight"}


def untranslated(source: str) -> list[str]:
    """Words given to a widget that did not go through tr(); symbols and units are the same everywhere."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name not in SAID:
            continue
        for argument in node.args:
            words = [argument, *(argument.elts if isinstance(argument, ast.List | ast.Tuple) else ())]
            for word in words:
                text = word.value if isinstance(word, ast.Constant) else None
                if isinstance(text, str) and re.search(r"[^\W\d_]{3}", text) and text not in NAMES:
                    found.append(f"line {node.lineno}: {name}({text!r})")
    return found


@pytest.mark.parametrize("path", sorted((ROOT / "app" / "views").glob("*.py")), ids=lambda path: path.stem)
def test_every_word_on_the_screen_can_be_translated(path: Path) -> None:
    assert untranslated(path.read_text()) == []


def test_the_search_finds_words_that_cannot() -> None:
    assert untranslated('QLabel("Hello"); a.setText(self.tr("x")); b.addTab(w, "Log"); c.setText("")') == [
        "line 1: QLabel('Hello')",
        "line 1: addTab('Log')",
    ]
