"""Every page: each control has a name for a screen reader, is reached by keyboard, and speaks through tr()."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QShortcut
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
    QMenu,
    QPushButton,
    QScrollBar,
    QSlider,
    QStackedWidget,
    QTabBar,
    QVBoxLayout,
    QWidget,
)
from pytestqt.qtbot import QtBot

from app.state import Trouble
from app.views import theme
from app.views.main_window import MainWindow
from app.views.maps.page import MapsPage
from app.views.pages import PAGES
from tests.app.calls import ROOT
from tests.app.views.conftest import active, until

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


OPERATED = (QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QLineEdit)


def unreachable(root: QWidget) -> list[str]:
    """Controls that the keyboard cannot operate: no focus by Tab, and no key of their own or of their action."""
    keys = {key.toString() for action in every_action(root) for key in action.shortcuts()}
    keys |= {shortcut.key().toString() for shortcut in root.findChildren(QShortcut)}
    return [
        f"{type(widget).__name__} {widget.accessibleName()!r}"
        for widget in controls(root)
        if isinstance(widget, OPERATED)
        and not isinstance(widget, QScrollBar)  # what it shows is reached by the keys of what it scrolls
        and not widget.focusPolicy() & Qt.FocusPolicy.TabFocus
        and not (isinstance(widget, QAbstractButton) and not widget.shortcut().isEmpty())
        # Tool buttons name the key of the action they stand for.
        and not keys & set(re.findall(r"\(([^()]+)\)", widget.toolTip()))
    ]


def every_action(root: QWidget) -> list[QAction]:
    return [*root.actions(), *root.findChildren(QAction)]


def keyless(root: QWidget) -> list[str]:
    """Actions that neither a key nor a menu reaches."""
    in_menus = {id(action) for menu in root.findChildren(QMenu) for action in menu.actions()}
    in_menus |= {id(action) for widget in root.findChildren(QWidget) for action in widget.actions()
                 if widget.contextMenuPolicy() == Qt.ContextMenuPolicy.ActionsContextMenu}  # fmt: skip
    return [
        action.text()
        for action in every_action(root)
        if action.text() and not action.shortcuts() and id(action) not in in_menus and action.menu() is None
    ]


@pytest.mark.parametrize("key", [row.key for row in PAGES])
def test_every_control_of_a_page_has_a_name_and_is_reached(
    window: MainWindow, session: Path, qtbot: QtBot, key: str
) -> None:
    window.open_session(session)
    window.show_page(key)
    qtbot.wait(50)
    page = window.page(key)
    assert page.isVisible()
    assert len(list(controls(page))) >= 4
    assert nameless(page) == []
    assert unreachable(page) == []
    assert keyless(page) == []


def test_the_menus_reach_every_action_of_the_window(window: MainWindow) -> None:
    assert len(every_action(window)) > 20
    assert keyless(window) == []


def test_rail_and_status_bar_have_names(window: MainWindow) -> None:
    assert nameless(window.rail) == []
    assert nameless(window.status) == []


def test_dialogs_have_names_and_show_where_the_keyboard_is(
    window: MainWindow, qtbot: QtBot, qapp: QApplication
) -> None:
    theme.install(qapp, "dark")
    for open_dialog in (
        window.show_shortcuts, lambda: window.add_photographs(None), window.simulate, window.menus._preferences,
        lambda: window.tell(Trouble("what", "remedy", "details")),
    ):  # fmt: skip
        open_dialog()
        until(qtbot, lambda: any(dialog.isVisible() for dialog in window.findChildren(QDialog)))
        (dialog,) = (dialog for dialog in window.findChildren(QDialog) if dialog.isVisible())
        active(dialog, qtbot)
        qtbot.keyClick(dialog, Qt.Key.Key_Tab)
        assert nameless(dialog) == [], type(dialog)
        seen, faint = walked(dialog, qtbot)
        assert (len(seen) > 1, faint) == (True, []), type(dialog)
        dialog.close()


def focused() -> QWidget:
    widget = QApplication.focusWidget()
    assert widget is not None  # a key for nobody would end the process
    return widget


def walked(window: QWidget, qtbot: QtBot) -> tuple[list[QWidget], list[str]]:
    """What Tab comes to until it is where it began, in order; and which of them look the same without the keyboard."""
    start = focused()
    seen, faint = [start], []
    for _ in range(200):
        last, look = focused(), focused().grab().toImage()
        qtbot.keyClick(last, Qt.Key.Key_Tab)
        if last.grab().toImage() == look:
            faint.append(f"{type(last).__name__} {last.accessibleName()!r}")
        if focused() is start:
            return seen, faint
        seen.append(focused())
    raise AssertionError(f"Tab never comes back: {[one.accessibleName() for one in seen[-8:]]}")


def opened(page: QWidget) -> None:
    """Let everything be seen and used that there is once a session has results."""
    for part in page.findChildren(QWidget):
        part.setEnabled(True)
        if isinstance(part, QStackedWidget):
            part.setCurrentIndex(part.count() - 1)
    if isinstance(page, MapsPage):
        page.body.show()


@pytest.mark.parametrize("key", [row.key for row in PAGES])
def test_tab_comes_to_every_control_once_and_each_shows_it(
    window: MainWindow, session: Path, qtbot: QtBot, qapp: QApplication, key: str
) -> None:
    theme.install(qapp, "dark")
    window.open_session(session)
    window.show_page(key)
    qtbot.wait(50)
    opened(window.page(key))
    active(window, qtbot)
    window.rail.buttons[key].setFocus()
    until(qtbot, QApplication.focusWidget)
    seen, faint = walked(window, qtbot)
    assert len(seen) == len(set(seen))
    assert faint == []
    for widget in controls(window.page(key)):
        group = widget.group() if isinstance(widget, QAbstractButton) else None
        # Of buttons that exclude one another, arrows walk from the one that is down.
        by_arrows = isinstance(widget, QAbstractButton) and not widget.isChecked() and (
            widget.autoExclusive() or (group is not None and group.exclusive())
        )  # fmt: skip
        if widget.isVisible() and widget.isEnabled() and widget.focusPolicy() & Qt.FocusPolicy.TabFocus:
            assert (widget.focusProxy() or widget) in seen or by_arrows, widget.accessibleName()


def test_tab_walks_through_the_whole_start_page(window: MainWindow, qtbot: QtBot) -> None:
    active(window, qtbot)
    page = window.page("start")
    page.new_capture.setFocus()  # type: ignore[attr-defined]
    seen = []
    for _ in range(60):
        seen.append(focused().accessibleName())
        qtbot.keyClick(focused(), Qt.Key.Key_Tab)
    assert {"New capture", "Open session", "Import photographs", "Start"} <= set(seen)


def test_arrows_walk_along_the_rail(window: MainWindow, qtbot: QtBot) -> None:
    active(window, qtbot)
    window.rail.buttons["start"].setFocus()
    for row in PAGES[1:3]:
        qtbot.keyClick(focused(), Qt.Key.Key_Down)
        assert window.stack.currentWidget() is window.page(row.key)


def test_names_are_said_for_what_they_are(qtbot: QtBot) -> None:
    """The walk itself finds a control without a name."""
    page = QWidget()
    qtbot.addWidget(page)
    layout = QVBoxLayout(page)
    good, bad, out = QPushButton("a"), QPushButton("b"), QPushButton("c")
    good.setAccessibleName("a")
    out.setAccessibleName("c")
    out.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    dumb, slid = QPushButton("d"), QSlider()
    dumb.setAccessibleName("d")
    dumb.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    dumb.setToolTip("d (Ctrl+D)")
    slid.setAccessibleName("s")
    slid.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    for widget in (good, bad, out, dumb, slid):
        layout.addWidget(widget)
    assert len(nameless(page)) == 1
    assert unreachable(page) == ["QPushButton 'c'", "QPushButton 'd'", "QSlider 's'"]
    action = QAction("d", page)
    assert keyless(page) == ["d"]
    action.setShortcut("Ctrl+D")
    assert keyless(page) == []
    assert unreachable(page) == ["QPushButton 'c'", "QSlider 's'"]


SAID = {
    "setText", "setToolTip", "setWindowTitle", "setPlaceholderText", "setAccessibleName", "setAccessibleDescription",
    "setInformativeText", "addTab", "addMenu", "showMessage", "setTitle", "setLabelText", "setWhatsThis", "setHeaderLabels",
    "told", "QLabel", "QPushButton", "QCheckBox", "QRadioButton", "QAction", "QGroupBox",
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
