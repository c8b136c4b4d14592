"""How a page is laid out: bars above one another, and among them what takes the room that is left."""

from PySide6.QtWidgets import QBoxLayout, QSplitter, QStackedWidget, QVBoxLayout, QWidget


class Either(QStackedWidget):
    """One of several parts in the same place."""

    def __init__(self, *parts: QWidget) -> None:
        super().__init__()
        for part in parts:
            self.addWidget(part)


def lay_out(page: QWidget, *parts: QWidget | QBoxLayout, spacing: int = 0) -> None:
    """From the top; of the parts, stacks, splitters and rows of several take the room."""
    column = QVBoxLayout(page)
    column.setContentsMargins(0, 0, 0, 0)
    column.setSpacing(spacing)
    for part in parts:
        if isinstance(part, QBoxLayout):
            column.addLayout(part, 1)
        else:
            column.addWidget(part, isinstance(part, QStackedWidget | QSplitter))
