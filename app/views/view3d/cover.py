"""What lies over the 3D picture: why there is none, how far it is, what went wrong and what to do; the photograph."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PySide6.QtCore import QRect, Qt, Signal, SignalInstance
from PySide6.QtGui import QGuiApplication, QPixmap
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from app.state import Trouble, trouble
from app.viewer.events import Status
from app.viewer.photograph import photograph
from app.views.background import Background
from app.views.icons import icon
from app.views.pixels import image_of
from app.views.theme import DARK, colours
from app.words import sentence

PHOTOGRAPH_PX = 230


class Cover(QFrame):
    """A card in the middle: a heading, some words, and, where a person can do something, buttons."""

    retry = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("card")
        self.what, self.remedy = QLabel(), QLabel()
        self.what.setObjectName("heading")
        self.remedy.setObjectName("dim")
        for label in (self.what, self.remedy):
            label.setWordWrap(True)
            label.setTextFormat(Qt.TextFormat.PlainText)
            label.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.remedy.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.busy = QProgressBar()
        self.busy.setRange(0, 0)
        self.busy.setTextVisible(False)
        self.busy.setFixedWidth(160)
        self.busy.setAccessibleName(self.tr("Working"))
        self.again = QPushButton(self.tr("&Try again"))
        self.again.setObjectName("primary")
        self.again.setAccessibleName(self.tr("Try again"))
        self.again.clicked.connect(self.retry)
        self.copy = QPushButton(self.tr("&Copy details"))
        self.copy.setAccessibleName(self.tr("Copy details"))
        self.copy.clicked.connect(self._copy)
        buttons = QHBoxLayout()
        buttons.setSpacing(8)
        buttons.addStretch()
        buttons.addWidget(self.again)
        buttons.addWidget(self.copy)
        buttons.addStretch()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(24, 18, 24, 18)
        layout.setSpacing(10)
        layout.addWidget(self.what)
        layout.addWidget(self.remedy)
        layout.addWidget(self.busy, 0, Qt.AlignmentFlag.AlignCenter)
        layout.addLayout(buttons)
        self._trouble = Trouble("")
        self.hide()

    def show_status(self, status: Status, picture: bool) -> None:
        """What there is to say: nothing, while a picture is there and all is well."""
        if status.state == "refused":
            self._show(trouble(status.message, status.details), stuck=True)
        elif status.stuck:
            self._show(Trouble(status.message, status.remedy, status.details), stuck=True)
        elif picture:
            self.hide()
        elif status.state == "loading":
            self._show(Trouble(self.tr("Reading the session")), busy=True)
        else:
            self._show(Trouble(self.tr("Starting the 3D view")), busy=True)

    def place(self) -> None:
        """In the middle of the parent."""
        room = _room(self)
        self.setFixedWidth(min(440, max(room.width() - 40, 200)))
        self.adjustSize()
        self.move((room.width() - self.width()) // 2, max((room.height() - self.height()) // 2, 0))

    def _show(self, told: Trouble, busy: bool = False, stuck: bool = False) -> None:
        self._trouble = told
        self.what.setText(sentence(told.what))
        self.remedy.setText(sentence(told.remedy))
        self.remedy.setVisible(bool(told.remedy))
        self.busy.setVisible(busy)
        self.again.setVisible(stuck)
        self.copy.setVisible(stuck)
        self.copy.setText(self.tr("&Copy details"))
        self.setAccessibleName(told.what)
        self.setAccessibleDescription(told.remedy)
        self.place()
        self.show()
        self.raise_()

    def _copy(self) -> None:
        parts = (self._trouble.what, self._trouble.remedy, self._trouble.details)
        QGuiApplication.clipboard().setText("\n\n".join(part for part in parts if part))
        self.copy.setText(self.tr("Copied"))


class Banner(QLabel):
    """A line at the top for what is worth knowing and needs no answer."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setContentsMargins(12, 5, 12, 5)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.hide()

    def say_restart(self, why: str) -> None:
        self.say(self.tr("The 3D view {0}. It is being started again.").format(why), warns=True)

    def say_missing(self, stages: Sequence[str]) -> None:
        """What the session does not have yet."""
        words = {"poses": self.tr("cameras"), "light": self.tr("light"), "surface": self.tr("surface")}
        missing = ", ".join(words[stage] for stage in stages if stage in words)
        told = self.tr("Not computed yet: {0}. Process the session to see it.").format(missing)
        self.say(told if missing else "")

    def say(self, text: str, warns: bool = False) -> None:
        self.setVisible(bool(text))
        self.setText(text)
        ink = DARK.warn if warns else DARK.dim
        self.setStyleSheet(
            f"background: {DARK.panel}; color: {ink}; border: 1px solid {DARK.line}; border-radius: 4px;"
        )
        self.place()

    def place(self) -> None:
        self.adjustSize()
        room = _room(self).width()
        self.move(max((room - self.width()) // 2, 8), 10)


class Photograph(QFrame):
    """The photograph of the chosen camera, in the upper right corner."""

    closed = Signal()
    in_maps = Signal()  # asks for the same photograph on the Maps page

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("card")
        self._background = Background(self, "photograph")
        self.name, self.picture = QLabel(), QLabel()
        self.name.setTextFormat(Qt.TextFormat.PlainText)
        self.picture.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.picture.setWordWrap(True)
        self.picture.setMinimumSize(120, 80)
        self.larger = self._button("maps", self.tr("Show this view in Maps"), "M", self.in_maps)
        self.shut = self._button("remove", self.tr("Close the photograph"), "Esc", self.closed)
        top = QHBoxLayout()
        top.addWidget(self.name, 1)
        top.addWidget(self.larger)
        top.addWidget(self.shut)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 3, 6, 6)
        layout.setSpacing(3)
        layout.addLayout(top)
        layout.addWidget(self.picture)
        self.hide()

    def _button(self, sign: str, text: str, keys: str, told: SignalInstance) -> QToolButton:
        button = QToolButton()
        button.setAutoRaise(True)
        button.setIcon(icon(sign, colours(self).dim, 14))
        button.setAccessibleName(text)
        button.setToolTip(f"{text} ({keys})")
        button.clicked.connect(told)
        return button

    def open(self, folder: Path, view: int, name: str) -> None:
        """Read a view's photograph, away from the window's thread, and show it."""
        self.name.setText(name)
        self.setAccessibleName(self.tr("Photograph {0}").format(name))
        self.show()
        self.place()
        self._background.ask("photograph", lambda: photograph(folder, view), self._show, self._tell)

    def _show(self, pixels: np.ndarray) -> None:
        ratio = self.devicePixelRatioF()
        side = round(min(PHOTOGRAPH_PX, max(_room(self).width() // 3, 120)) * ratio)
        scaled = QPixmap.fromImage(image_of(pixels)).scaled(
            side, side, Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
        )
        scaled.setDevicePixelRatio(ratio)
        self.picture.setPixmap(scaled)
        self.place()

    def _tell(self, fault: Trouble) -> None:
        self.picture.setText(fault.what)
        self.place()

    def place(self) -> None:
        self.adjustSize()
        self.move(_room(self).width() - self.width() - 12, 12)


def _room(widget: QWidget) -> QRect:
    """The rectangle of its parent."""
    parent = widget.parentWidget()
    return parent.rect() if parent is not None else widget.rect()
