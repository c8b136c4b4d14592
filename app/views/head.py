"""The bar over every page but the first: the session, what the page says of it, and at the right what one mainly does there."""

from pathlib import Path

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QAction, QImage, QPixmap, QShowEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QWidget

from app import recent
from app.state import called
from app.views.background import Background
from app.views.elided import Elided
from app.views.page_actions import action_button

HEIGHT, NAME_PX = 40, 200
PICTURE = QSize(42, 28)


class Head(QFrame):
    """Shows what it is told; the buttons are the page's actions, the primary one last."""

    def __init__(self, parent: QWidget | None, primary: QAction | QPushButton) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self.setFixedHeight(HEIGHT)
        self.session: Path | None = None  # that is shown
        self._background = Background(self, "head")
        self.picture, self.name, self.state = QLabel(), QLabel(), Elided()
        self.picture.setFixedSize(PICTURE)
        self.name.setObjectName("heading")
        self.name.setTextFormat(Qt.TextFormat.PlainText)
        self.state.setObjectName("dim")
        self.state.setAccessibleName(self.tr("State"))
        self.primary = action_button(primary) if isinstance(primary, QAction) else primary
        self.primary.setObjectName("primary")
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(12, 0, 12, 0)
        self._row.setSpacing(8)
        for part in (self.picture, self.name):
            self._row.addWidget(part)
        self._row.addWidget(self.state, 1)
        self._row.addWidget(self.primary)
        self.show_session(None)

    def add(self, *controls: QWidget) -> None:
        """Controls between what is said and the primary button."""
        for control in controls:
            self._row.insertWidget(self._row.count() - 1, control)

    def show_session(self, folder: Path | None) -> None:
        """Its name and picture; none is nothing to look at."""
        self.session = folder
        self.show_name("" if folder is None else called(folder), str(folder or ""))
        self.picture.clear()
        self.picture.hide()
        self._look()

    def show_name(self, name: str, tip: str = "") -> None:
        """In place of the session's: what is not one yet has a name too."""
        self.name.setText(self.name.fontMetrics().elidedText(name, Qt.TextElideMode.ElideMiddle, NAME_PX))
        self.name.setToolTip(tip or name)
        self.name.setVisible(bool(name))

    def lead(self, leads: bool) -> None:
        """Whether the primary button is the one to press; else it looks like any other."""
        name = "primary" if leads else ""
        if self.primary.objectName() != name:
            self.primary.setObjectName(name)
            self.primary.style().polish(self.primary)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._look()  # a run may have made a better picture

    def _look(self) -> None:
        folder, size = self.session, PICTURE * self.devicePixelRatioF()
        if folder is None or not self.isVisible():
            self._background.drop("picture")
            return

        def read() -> QImage:
            path = recent.look(folder).picture
            image = QImage() if path is None else QImage(str(path))
            return (
                image
                if image.isNull()
                else image.scaled(
                    size, Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
                )
            )

        self._background.ask("picture", read, self._show_picture)

    def _show_picture(self, image: QImage) -> None:
        self.picture.setVisible(not image.isNull())
        if not image.isNull():
            image.setDevicePixelRatio(self.devicePixelRatioF())
            self.picture.setPixmap(QPixmap.fromImage(image))
