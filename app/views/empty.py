"""In place of what a page shows while there is nothing: why, what to do about it, and perhaps a button that does."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QPushButton, QVBoxLayout, QWidget


class Empty(QWidget):
    """Two lines in the middle, the second one dim, and a button under them."""

    def __init__(self, parent: QWidget | None = None, button: QPushButton | None = None) -> None:
        super().__init__(parent)
        self.what, self.remedy = QLabel(), QLabel()
        self.what.setObjectName("heading")
        self.remedy.setObjectName("dim")
        column = QVBoxLayout(self)
        if button is not None:
            column.setSpacing(8)
        column.addStretch(2)
        for label in (self.what, self.remedy):
            label.setAlignment(Qt.AlignmentFlag.AlignCenter)
            label.setWordWrap(True)
            column.addWidget(label)
        if button is not None:
            column.addSpacing(8)
            column.addWidget(button, 0, Qt.AlignmentFlag.AlignCenter)
        column.addStretch(3)
