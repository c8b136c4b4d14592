"""What is chosen on a page as a picture at its side, and a line under it."""

from pathlib import Path

from PySide6.QtCore import QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QVBoxLayout, QWidget

from app.views import theme

WIDTH, ROOM_PX = 260, 1000  # its own; of a page that has room for it


class SidePicture(QWidget):
    """Takes no room while there is nothing to show."""

    def __init__(self, name: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.picture = _Picture()
        self.said = QLabel()
        self.said.setObjectName("dim")
        self.said.setWordWrap(True)
        self.said.setAccessibleName(name)
        self.setFixedWidth(WIDTH)
        self._full = self._narrow = False  # there is something to show; there is no room for it
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 12, 16, 8)
        column.addWidget(self.picture, 100)
        column.addWidget(self.said)
        column.addStretch(1)
        self.hide()

    def clear(self) -> None:
        self._full = False
        self.hide()

    def fit(self, page_px: int) -> None:
        """What stands beside it comes first where the page is narrow."""
        self._narrow = page_px < ROOM_PX
        self.setVisible(self._full and not self._narrow)

    def show_file(self, file: Path, said: str) -> None:
        self.picture.show_image(QImage(str(file)))
        self.said.setText(said)
        self._full = True
        self.setVisible(not self._narrow)


class _Picture(QWidget):
    """As large as there is room for, at the top."""

    def __init__(self) -> None:
        super().__init__()
        self._image = QImage()
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)

    @property
    def image(self) -> QImage:
        return self._image

    def sizeHint(self) -> QSize:
        return QSize(WIDTH, WIDTH)

    def show_image(self, image: QImage) -> None:
        self._image = image
        wide = WIDTH - 16
        self.setMaximumHeight(
            round(wide * image.height() / max(image.width(), 1))
        )  # the words follow at once
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        if self._image.isNull():
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        size = QSizeF(self._image.size()).scaled(QSizeF(self.size()), Qt.AspectRatioMode.KeepAspectRatio)
        frame = QRectF((self.width() - size.width()) / 2, 0, size.width(), size.height())
        painter.fillRect(frame, theme.colour(theme.colours(self).picture))
        painter.drawImage(frame, self._image)
