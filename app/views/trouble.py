"""The dialog that says what happened and what to do, and copies the details for somebody who can help."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QFontDatabase, QGuiApplication
from PySide6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QStyle,
    QVBoxLayout,
    QWidget,
)

from app.state import Trouble
from app.words import sentence

__all__ = ["Trouble", "TroubleDialog", "show_trouble"]


class TroubleDialog(QDialog):
    """One trouble; details are folded away."""

    def __init__(self, parent: QWidget | None, trouble: Trouble) -> None:
        super().__init__(parent)
        self.trouble = trouble
        self.setWindowTitle(self.tr("Something went wrong"))
        self.setMinimumWidth(460)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)

        icon = QLabel()
        sign = self.style().standardIcon(QStyle.StandardPixmap.SP_MessageBoxWarning)
        icon.setPixmap(sign.pixmap(40, 40))
        icon.setAlignment(Qt.AlignmentFlag.AlignTop)
        what = _selectable(trouble.what)
        what.setObjectName("heading")
        words = QVBoxLayout()
        words.setSpacing(8)
        words.addWidget(what)
        if trouble.remedy:
            words.addWidget(_selectable(sentence(trouble.remedy)))
        words.addStretch()
        top = QHBoxLayout()
        top.setSpacing(14)
        top.addWidget(icon)
        top.addLayout(words, 1)

        self.details = QPlainTextEdit(trouble.details)
        self.details.setReadOnly(True)
        self.details.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.details.setAccessibleName(self.tr("Details"))
        self.details.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.details.setMinimumHeight(180)
        self.details.hide()

        self.show_details = QPushButton(self.tr("Show &details"))
        self.show_details.setCheckable(True)
        self.show_details.toggled.connect(self._unfold)
        self.copy = QPushButton(self.tr("&Copy details"))
        self.copy.clicked.connect(self._copy)
        box = QDialogButtonBox()
        box.addButton(self.show_details, QDialogButtonBox.ButtonRole.ActionRole)
        box.addButton(self.copy, QDialogButtonBox.ButtonRole.ActionRole)
        self.show_details.setVisible(bool(trouble.details))  # the box shows what is added to it
        close = box.addButton(QDialogButtonBox.StandardButton.Close)
        close.setDefault(True)
        box.rejected.connect(self.reject)
        for button in box.buttons():
            button.setAccessibleName(button.text().replace("&", ""))

        layout = QVBoxLayout(self)
        layout.setContentsMargins(18, 18, 18, 14)
        layout.setSpacing(14)
        layout.addLayout(top)
        layout.addWidget(self.details, 1)
        layout.addWidget(box)
        close.setFocus()

    def _unfold(self, shown: bool) -> None:
        self.details.setVisible(shown)
        self.show_details.setText(self.tr("Hide &details") if shown else self.tr("Show &details"))
        self.adjustSize()

    def _copy(self) -> None:
        parts = (self.trouble.what, self.trouble.remedy, self.trouble.details)
        QGuiApplication.clipboard().setText("\n\n".join(part for part in parts if part))
        self.copy.setText(self.tr("Copied"))


def show_trouble(parent: QWidget | None, trouble: Trouble) -> TroubleDialog:
    """Open the dialog and return at once; it deletes itself when closed."""
    dialog = TroubleDialog(parent, trouble)
    dialog.open()
    return dialog


def _selectable(text: str) -> QLabel:
    label = QLabel(text)
    label.setTextFormat(Qt.TextFormat.PlainText)
    label.setWordWrap(True)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label
