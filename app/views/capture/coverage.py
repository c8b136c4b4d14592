"""What of the room's light the photographs have seen: a panorama that grows, its share, and what to photograph next."""

from PySide6.QtCore import QPointF, QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QVBoxLayout, QWidget

from app.views import theme
from app.views.background import Background
from app.views.capture.parts import dim
from app.views.capture.picture import read_picture

HATCH_PX = 8


class Panorama(QWidget):
    """An equirectangular picture over a hatched ground, twice as wide as high."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.image: QImage | None = None
        self.setMinimumSize(120, 60)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName(self.tr("Light seen so far, as a panorama"))
        self.setToolTip(self.tr("The light around the object as far as the photographs have seen it"))

    def sizeHint(self) -> QSize:
        return QSize(300, 150)

    def paintEvent(self, event: QPaintEvent) -> None:
        ours = theme.colours(self)
        painter = QPainter(self)
        room = QSizeF(self.size())
        size = QSizeF(2, 1).scaled(room, Qt.AspectRatioMode.KeepAspectRatio)
        frame = QRectF((room.width() - size.width()) / 2, 0, size.width(), size.height())
        painter.fillRect(frame, QColor(ours.field))
        # Drawn, not a brush's pattern: that is one of the screen's pixels, and fades where they are fine.
        painter.setClipRect(frame)
        painter.setPen(theme.pen(ours.line))
        for x in range(round(frame.left()), round(frame.right() + frame.height()), HATCH_PX):
            painter.drawLine(QPointF(x, frame.top()), QPointF(x - frame.height(), frame.bottom()))
        if self.image is not None:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(frame, self.image)


class Coverage(QWidget):
    """The panorama and what is said of it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._background = Background(self, "capture coverage")
        self._png = ""
        self.panorama = Panorama()
        self.share = QLabel()
        self.share.setTextFormat(Qt.TextFormat.PlainText)
        self.share.setWordWrap(True)
        self.next = dim()
        for label, name in (
            (self.share, self.tr("Share seen")),
            (self.next, self.tr("What to photograph next")),
        ):
            label.setAccessibleName(name)
            label.setAlignment(Qt.AlignmentFlag.AlignTop)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 0, 6, 0)
        column.setSpacing(3)
        column.addWidget(self.panorama, 1)
        column.addWidget(self.share)
        column.addWidget(self.next)
        self.show_shares(None, None, "")

    def show_shares(self, seen: float | None, unclipped: float | None, next_: str) -> None:
        """
        Args:
            seen, unclipped: shares of the sphere, 0 to 1; None: nothing was looked at yet.
            next_: a sentence, or "".
        """
        if seen is None:
            told = self.tr("Nothing of the room is seen yet")
        elif unclipped is None or unclipped >= seen - 0.005:
            told = self.tr("Room covered: {0:.0%}").format(seen)
        else:
            told = self.tr("Room covered: {0:.0%}, {1:.0%} of it unclipped").format(seen, unclipped)
        self.share.setText(told)
        self.next.setText(next_[:1].upper() + next_[1:])
        self.next.setToolTip(next_)
        self.next.setVisible(bool(next_))

    def show_file(self, png: str) -> None:
        """The panorama in a file; the one before stays until it is read. "" shows none."""
        if png == self._png:
            return
        self._png = png
        if not png:
            self._background.drop("panorama")
            self._take(None)
            return

        def arrived(image: QImage) -> None:
            if not image.isNull():
                self._take(image)

        self._background.ask("panorama", lambda: read_picture(png), arrived)

    def _take(self, image: QImage | None) -> None:
        self.panorama.image = image
        self.panorama.update()
