"""A strip over the picture for what wants an answer, or is worth more than a line: what happened, what to do, buttons."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from app.views import theme
from app.views.capture.parts import button, dim

Tone = Literal["bad", "warn", "accent", "good"]


@dataclass(frozen=True, slots=True)
class Choice:
    """A button of the banner."""

    text: str
    do: Callable[[], None]
    primary: bool = False
    tip: str = ""


@dataclass(frozen=True, slots=True)
class Notice:
    """What a banner says; two that say the same are the same, whatever their buttons do."""

    what: str
    remedy: str = ""
    tone: Tone = "accent"


class Banner(QFrame):
    """Hidden while there is nothing to say."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("banner")
        self.notice: Notice | None = None
        self.what = QLabel()
        self.what.setTextFormat(Qt.TextFormat.PlainText)
        self.what.setWordWrap(True)
        font = self.what.font()
        font.setBold(True)
        self.what.setFont(font)
        self.remedy = dim()
        for label in (self.what, self.remedy):
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        words = QVBoxLayout()
        words.setSpacing(2)
        words.addWidget(self.what)
        words.addWidget(self.remedy)
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(14, 8, 12, 8)
        self._row.setSpacing(8)
        self._row.addLayout(words, 1)
        self.buttons: list[QPushButton] = []
        self.hide()

    def show_notice(self, notice: Notice | None, choices: Sequence[Choice] = ()) -> None:
        """Say it; what is said already stays as it is, so that a button is not lost under the mouse."""
        if notice == self.notice and [choice.text for choice in choices] == [b.text() for b in self.buttons]:
            return
        self.notice = notice
        for old in self.buttons:
            self._row.removeWidget(old)
            old.deleteLater()
        self.buttons = []
        self.setVisible(notice is not None)
        if notice is None:
            return
        self.what.setText(notice.what)
        self.remedy.setText(notice.remedy)
        self.remedy.setVisible(bool(notice.remedy))
        self.setAccessibleName(notice.what)
        self.setAccessibleDescription(notice.remedy)
        for choice in choices:
            made = button(choice.text, choice.tip, "primary" if choice.primary else "")
            made.clicked.connect(lambda checked=False, do=choice.do: do())
            self.buttons.append(made)
            self._row.addWidget(made, 0, Qt.AlignmentFlag.AlignVCenter)
        self._dress()

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and self.notice is not None:
            self._dress()

    def _dress(self) -> None:
        assert self.notice is not None
        ours = theme.colours(self)
        ink = {"bad": ours.bad, "warn": ours.warn, "accent": ours.accent, "good": ours.good}[self.notice.tone]
        sheet = f"QFrame#banner {{ background: {ours.panel}; border: none; border-left: 4px solid {ink}; border-bottom: 1px solid {ours.line}; }}"
        if self.styleSheet() != sheet:
            self.setStyleSheet(sheet)
