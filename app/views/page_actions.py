"""What a person can do on a page by key: actions that work while the focus is anywhere on it, and buttons for them."""

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QPushButton, QWidget


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
        keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
        words = action.toolTip().replace("&", "")
        plain = action.text().replace("&", "")
        made.setText(action.text() if action.iconText() == plain else action.iconText())
        made.setAccessibleName(plain)
        made.setToolTip(f"{words} ({keys})" if keys else words)
        made.setEnabled(action.isEnabled())
        made.setVisible(action.isVisible())

    action.changed.connect(follow)
    follow()
    return made
