"""Where the new session will lie: a free name is offered, until a person writes another."""

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLineEdit, QWidget

from app.views.capture.parts import Section, button


class PlaceBox(Section):
    """One folder."""

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("", parent)
        self.setAccessibleName(self.tr("Session"))
        self.heading.setText(self.tr("Session"))
        self.named = False  # by the person
        self._next: str | None = None  # what stood here before the capture under way
        self.folder = QLineEdit()
        self.folder.setAccessibleName(self.tr("Folder of the new session"))
        self.folder.setToolTip(self.tr("Folder of the new session; it must not be there yet"))
        self.browse = button("…")
        self.browse.setFixedWidth(40)
        self.browse.setAccessibleName(self.tr("Browse for the new session"))
        line = QHBoxLayout()
        line.setSpacing(6)
        line.addWidget(self.folder, 1)
        line.addWidget(self.browse)
        self.body.addLayout(line)
        self.folder.textEdited.connect(self._name)
        self.folder.textChanged.connect(self.changed)
        self.browse.clicked.connect(self._ask)

    @property
    def path(self) -> Path | None:
        """None while nothing is written, or no whole path."""
        said = self.folder.text().strip()
        path = Path(said).expanduser()
        return path if said and path.is_absolute() else None

    def offer(self, path: Path) -> None:
        """A free name; what a person wrote stays."""
        if not self.named:
            self.folder.setText(str(path))
            self.folder.setCursorPosition(len(self.folder.text()))

    def show_under_way(self, session: Path | None) -> None:
        """The session that is being captured, in place of the next one's name; None: the next one's again."""
        if session is not None and self._next is None:
            self._next = self.folder.text()
        if session is not None:
            self.folder.setText(str(session))
        elif self._next is not None:
            self.folder.setText(self._next)
            self._next = None

    def _name(self) -> None:
        self.named = bool(self.folder.text().strip())

    def _ask(self) -> None:
        said, _ = QFileDialog.getSaveFileName(self, self.tr("New session"), self.folder.text())
        if said:
            self.named = True
            self.folder.setText(said)
