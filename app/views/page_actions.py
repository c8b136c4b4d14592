"""What a person can do on a page by key: actions that work while the focus is anywhere on it."""

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QWidget


def page_action(page: QWidget, text: str, keys: str | tuple[str, ...], call: Callable[[], object]) -> QAction:
    """An action of the page; the sheet of shortcuts finds it there."""
    action = QAction(text, page)
    action.setShortcuts([QKeySequence(one) for one in ([keys] if isinstance(keys, str) else keys) if one])
    action.setShortcutContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
    action.triggered.connect(lambda checked: call())
    page.addAction(action)
    return action
