"""What the colours of a map mean: a bar with numbers and unit, the disc of normals, the colours of flags."""

import numpy as np
from PySide6.QtCore import QEvent, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.inspect import falsecolour
from app.inspect.falsecolour import MINUS, Scale
from app.views.pixels import image_of
from app.views.theme import colours

HEIGHT = 22
BAR = 9
DISC = 18


class Legend(QWidget):
    """One line under a picture."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._scale: Scale | None = None
        self._note = ""
        self._kind = ""
        self._image: QImage | None = None
        self.setFixedHeight(HEIGHT)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.setAccessibleName(self.tr("Legend"))

    def sizeHint(self) -> QSize:
        return QSize(160, HEIGHT)

    def show_scale(
        self, scale: Scale | None, note: str = "", kind: str = "", normal_frame: str = "opengl"
    ) -> None:
        """A bar for `scale`; else `note`, with the disc where `kind` is "normal" and a key where it is "flags"."""
        self._scale, self._note, self._kind = scale, note, kind
        self._image = None
        if scale is not None:
            self._image = image_of(falsecolour.bar(scale.colours))
            self._note = f"{number(scale.low)} … {number(scale.high)} {scale.unit}"
        elif kind == "normal":
            self._image = _normal_disc(normal_frame)
        elif kind == "flags":
            self._note = ", ".join(name for _, name, _ in falsecolour.FLAGS)
        self.setAccessibleDescription(self._note)
        self.setToolTip(self._note)
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        font = painter.font()
        font.setPixelSize(11)
        painter.setFont(font)
        ours = colours(self)
        if self._scale is not None:
            self._paint_bar(painter, self._scale)
        elif self._kind == "flags":
            self._paint_flags(painter)
        else:
            left = 0
            if self._image is not None:
                painter.drawImage(QRectF(0, (HEIGHT - DISC) / 2, DISC, DISC), self._image)
                left = DISC + 6
            painter.setPen(QColor(ours.dim))
            text = painter.fontMetrics().elidedText(
                self._note, Qt.TextElideMode.ElideRight, self.width() - left
            )
            painter.drawText(left, 0, self.width() - left, HEIGHT, Qt.AlignmentFlag.AlignVCenter, text)

    def _paint_bar(self, painter: QPainter, scale: Scale) -> None:
        ours = colours(self)
        metrics = painter.fontMetrics()
        low, high = number(scale.low), number(scale.high)
        if scale.colours == "signed":
            high = f"+{high}"
        wide = metrics.horizontalAdvance
        unit = scale.unit
        room = self.width() - wide(low) - wide(high) - 18
        unit = metrics.elidedText(unit, Qt.TextElideMode.ElideRight, max(room - 64, 0))
        bar = max(room - wide(unit), 24)
        painter.setPen(QColor(ours.text))
        painter.drawText(0, 0, wide(low) + 1, HEIGHT, Qt.AlignmentFlag.AlignVCenter, low)
        left = wide(low) + 6
        assert self._image is not None
        painter.drawImage(QRectF(left, (HEIGHT - BAR) / 2, bar, BAR), self._image)
        if scale.colours == "signed":
            painter.fillRect(
                QRectF(left + bar / 2 - 0.5, (HEIGHT - BAR) / 2 - 2, 1, BAR + 4), QColor(ours.text)
            )
        left += bar + 6
        painter.drawText(int(left), 0, wide(high) + 1, HEIGHT, Qt.AlignmentFlag.AlignVCenter, high)
        left += wide(high) + 6
        painter.setPen(QColor(ours.dim))
        painter.drawText(int(left), 0, wide(unit) + 2, HEIGHT, Qt.AlignmentFlag.AlignVCenter, unit)

    def _paint_flags(self, painter: QPainter) -> None:
        ours = colours(self)
        left = 0
        chips = [(name, f"#{colour}") for _, name, colour in falsecolour.FLAGS]
        chips.append((self.tr("several"), f"#{falsecolour.SEVERAL}"))
        room = self.width() / len(chips) - 18
        for name, colour in chips:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(colour))
            painter.drawRoundedRect(QRectF(left, HEIGHT / 2 - 5, 10, 10), 2, 2)
            painter.setPen(QColor(ours.dim))
            text = painter.fontMetrics().elidedText(name, Qt.TextElideMode.ElideRight, int(max(room, 20)))
            wide = painter.fontMetrics().horizontalAdvance(text)
            painter.drawText(int(left + 14), 0, wide + 2, HEIGHT, Qt.AlignmentFlag.AlignVCenter, text)
            left += 14 + wide + 10

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self.update()
        super().changeEvent(event)


def number(value: float) -> str:
    """A scale's end, with a true minus."""
    return f"{value:.3g}".replace("-", MINUS)


def _normal_disc(frame: str) -> QImage:
    """A ball seen by the camera, coloured as its normals."""
    side = 4 * DISC
    at = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(at, at)
    inside = x * x + y * y < 1
    normal = np.stack([x, y, -np.sqrt(np.maximum(1 - x * x - y * y, 0))], -1).astype(np.float32)
    return image_of(falsecolour.normals(normal, inside, frame))
