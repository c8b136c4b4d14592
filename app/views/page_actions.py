"""What a person can do on a page by key: actions that work while the focus is anywhere on it, and buttons for them."""

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QAbstractButton, QPushButton, QWidget

from app.views.shortcuts import FOLLOWS


def page_action(page: QWidget, text: str, keys: str | tuple[str, ...], call: Callable[[], object]) -> QAction:
    """An action of the page; the sheet of shortcuts finds it there."""
    action = QAction(text, page)
    action.setShortcuts([QKeySequence(one) for one in ([keys] if isinstance(keys, str) else keys) if one])
    action.setShortcutContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
    action.triggered.connect(lambda checked: call())
    page.addAction(action)
    return action


def action_button(action: QAction, look: str = "") -> QPushButton:
    """A button for an action: its words (those for an icon, where it has some), enabled and seen as it is."""
    made = QPushButton()
    made.setObjectName(look)
    made.clicked.connect(action.trigger)

    def follow() -> None:
        plain = action.text().replace("&", "")
        made.setText(action.text() if action.iconText() == plain else action.iconText())
        made.setAccessibleName(plain)
        made.setEnabled(action.isEnabled())
        made.setVisible(action.isVisible())

    action.changed.connect(follow)
    follow()
    tell_keys(made, action)
    return made


def tell_keys(button: QAbstractButton, action: QAction) -> None:
    """Let the button's tooltip say what the action says, and its keys."""

    def follow() -> None:
        button.setToolTip(keyed(action.toolTip().replace("&", ""), action))

    button.setProperty(FOLLOWS, True)
    action.changed.connect(follow)
    follow()


def keyed(words: str, action: QAction) -> str:
    """Words that end with the action's key."""
    keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
    return f"{words} ({keys})" if keys else words
