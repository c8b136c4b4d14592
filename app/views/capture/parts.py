"""What the parts of the Capture page are made of: sections, rows, and buttons with names."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLabel, QPushButton, QVBoxLayout, QWidget


class Section(QWidget):
    """A heading and what belongs under it, in two columns: names and controls."""

    def __init__(self, title: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(title)
        self.heading = QLabel(title)
        self.heading.setObjectName("heading")
        self.body = QVBoxLayout()
        self.body.setSpacing(5)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(5)
        column.addWidget(self.heading)
        column.addLayout(self.body)

    def rows(self) -> QGridLayout:
        """A grid for `row`, added to the section."""
        grid = QGridLayout()
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(8)
        grid.setVerticalSpacing(4)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(0, 62)
        self.body.addLayout(grid)
        return grid


def row(grid: QGridLayout, text: str, control: QWidget, name: str = "") -> QLabel:
    """A control with its label before it; `name` for screen readers where the label alone says too little."""
    label = QLabel(text)
    label.setBuddy(control)
    control.setAccessibleName(name or text.replace("&", ""))
    number = grid.rowCount()
    grid.addWidget(label, number, 0)
    grid.addWidget(control, number, 1)
    return label


def dim(text: str = "", wraps: bool = True) -> QLabel:
    """A line in the second colour."""
    label = QLabel(text)
    label.setObjectName("dim")
    label.setTextFormat(Qt.TextFormat.PlainText)
    label.setWordWrap(wraps)
    return label


def button(text: str, tip: str = "", look: str = "") -> QPushButton:
    """A button named after what stands on it; `look` is "primary" or "stop"."""
    made = QPushButton(text)
    made.setAccessibleName(text.replace("&", ""))
    made.setToolTip(tip)
    made.setObjectName(look)
    return made
