"""In place of what a page shows while there is nothing: why, what to do about it, and buttons that do."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from app.state import Trouble
from app.views import icons, theme
from app.views.pages import Shell
from app.words import sentence

ICON_PX = 48


class Empty(QWidget):
    """The page's icon, a line, what to do, and buttons; the first of them is the one to press."""

    def __init__(self, sign: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._sign = sign
        self._shell: Shell | None = None
        self.icon, self.what, self.remedy = QLabel(), QLabel(), QLabel()
        self.what.setObjectName("heading")
        self.remedy.setObjectName("dim")
        self.buttons: list[QPushButton] = []
        self._row = QHBoxLayout()
        self._row.setSpacing(8)
        self._row.setAlignment(Qt.AlignmentFlag.AlignCenter)
        column = QVBoxLayout(self)
        column.setSpacing(8)
        column.addStretch(2)
        for label in (self.icon, self.what, self.remedy):
            label.setAlignment(Qt.AlignmentFlag.AlignCenter)
            label.setWordWrap(label is not self.icon)
            column.addWidget(label)
        column.addSpacing(8)
        column.addLayout(self._row)
        column.addStretch(3)
        self._dress()

    def use(self, shell: Shell) -> None:
        self._shell = shell

    def say(self, why: Trouble, *leads: tuple[str, Callable[[], object]]) -> None:
        """
        Args:
            leads: what stands on each button, and what it does.
        """
        self.what.setText(sentence(why.what))
        self.remedy.setText(sentence(why.remedy))
        self.remedy.setVisible(bool(why.remedy))
        texts = [text for text, _ in leads]
        if texts == [button.text() for button in self.buttons]:
            return  # what is said again must not take the button from under the mouse
        for old in self.buttons:
            self._row.removeWidget(old)
            old.hide()
            old.deleteLater()
        self.buttons = []
        for text, call in leads:
            button = QPushButton(text)
            button.setObjectName("" if self.buttons else "primary")
            button.setAccessibleName(text.replace("&", ""))
            button.clicked.connect(lambda checked=False, call=call: call())
            self._row.addWidget(button)
            self.buttons.append(button)

    def say_reading(self) -> None:
        """Until it is known what there is."""
        self.say(Trouble(self.tr("Reading the session…")))

    def say_nothing_yet(self, session: Path | None, why: Trouble | None = None) -> None:
        """That no session is open, or that this one has no results yet; None: because it is not processed."""
        leads: list[tuple[str, Callable[[], object]]] = []
        if session is None:
            why = Trouble(self.tr("No session is open"), self.tr("open one, or look around in the demo"))
        elif why is None:
            why = Trouble(
                self.tr("This session has no finished surface yet"),
                self.tr("process it; results appear here when they are there"),
            )
        if self._shell is not None:
            wishes = self._shell.wishes
            if session is None:
                leads = [
                    (self.tr("&Open session…"), wishes.ask_session.emit),
                    (self.tr("Open &demo"), wishes.open_demo.emit),
                ]
            else:
                leads = [(self.tr("Go to P&rocess"), lambda: wishes.show_page.emit("process"))]
        self.say(why, *leads)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() is QEvent.Type.PaletteChange and hasattr(self, "icon"):
            self._dress()

    def _dress(self) -> None:
        ours = theme.colours(self)
        self.icon.setPixmap(icons.pixmap(self._sign, ours.disabled, ICON_PX, self.devicePixelRatioF()))
