"""Lists to choose from that stay narrow in a bar and show whole names when they are opened."""

from PySide6.QtWidgets import QComboBox


def box_of(name: str, letters: int) -> QComboBox:
    """A list as wide as so many letters, whatever it holds; `name` is told to screen readers."""
    box = QComboBox()
    box.setAccessibleName(name)
    box.setMinimumContentsLength(letters)
    box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    box.currentTextChanged.connect(box.setToolTip)
    return box


def widened(box: QComboBox) -> None:
    """Let the opened list be as wide as its longest name; after it was filled."""
    box.view().setMinimumWidth(box.view().sizeHintForColumn(0) + 24)
