"""Where a drop would land, and what would become of it: a frame over the window while something is dragged across."""

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from app.state import Place, called
from app.views import theme

INSET, WIDTH, ROUND = 8, 3, 8


class DropMark(QWidget):
    """Lies over the window; nothing can be clicked on it."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.words = ""
        self.hide()

    def show_place(self, place: Place) -> None:
        """Say what dropping this would do."""
        if place.kind == "session":
            self.words = self.tr("Open {0}").format(called(place.folder))
        else:
            self.words = self.tr("Import the photographs in {0}").format(place.folder.name)
        parent = self.parentWidget()
        if parent is not None:
            self.setGeometry(parent.rect())
        self.raise_()
        self.show()
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        ours = theme.colours(self)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), theme.colour(ours.window, 0.8))
        painter.setPen(QPen(theme.colour(ours.accent), WIDTH, Qt.PenStyle.DashLine))
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(INSET, INSET, -INSET, -INSET), ROUND, ROUND)
        font = painter.font()
        font.setPointSizeF(14)
        painter.setFont(font)
        words = QRectF(painter.boundingRect(self.rect(), Qt.AlignmentFlag.AlignCenter, self.words))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.colour(ours.panel))
        painter.drawRoundedRect(words.adjusted(-24, -14, 24, 14), ROUND, ROUND)
        painter.setPen(theme.colour(ours.text))
        painter.drawText(words, Qt.AlignmentFlag.AlignCenter, self.words)
