"""How the light of the newest photograph is spread: its three channels over stops, and where the sensor is full.

Counts over log2 radiance of the bracket's middle exposure; heights are square roots, so that small bright lamps show.
"""

import math
from collections.abc import Mapping, Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.views import theme

HEIGHT = 76


class Histogram(QWidget):
    """Shows counts; none: an empty frame."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._counts: Mapping[str, Sequence[int]] = {}
        self._white: float | None = None
        self.setFixedHeight(HEIGHT)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setAccessibleName(self.tr("Histogram"))
        self.setToolTip(
            self.tr(
                "Red, green and blue over stops of radiance, dark left. Line: here the middle exposure is full"
            )
        )

    def sizeHint(self) -> QSize:
        return QSize(260, HEIGHT)

    def show_counts(self, counts: Mapping[str, Sequence[int]], white: float | None) -> None:
        """
        Args:
            counts: of "r", "g" and "b", pixels in each bin.
            white: the bin where the sensor is full; None: not known.
        """
        if counts != self._counts or white != self._white:
            self._counts, self._white = counts, white
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        ours = theme.colours(self)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        frame = QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5)
        painter.setPen(theme.pen(ours.line))
        painter.setBrush(QColor(ours.field))
        painter.drawRoundedRect(frame, 3, 3)
        room = frame.adjusted(3, 4, -3, -2)
        most = max((count for channel in self._counts.values() for count in channel), default=0)
        if not most:
            painter.setPen(QColor(ours.disabled))
            painter.drawText(frame, Qt.AlignmentFlag.AlignCenter, self.tr("no photograph yet"))
            return
        for channel, ink in (("r", ours.bad), ("g", ours.good), ("b", ours.accent)):
            counts = self._counts.get(channel, ())
            if len(counts) < 2:
                continue
            step = room.width() / (len(counts) - 1)
            line = [
                QPointF(room.left() + i * step, room.bottom() - math.sqrt(count / most) * room.height())
                for i, count in enumerate(counts)
            ]
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(theme.colour(ink, 0.28))
            painter.drawPolygon(QPolygonF([room.bottomLeft(), *line, room.bottomRight()]))
            painter.setPen(theme.pen(ink, 1.2))
            painter.drawPolyline(QPolygonF(line))
        bins = max(len(channel) for channel in self._counts.values())
        if self._white is not None and 0 <= self._white < bins:
            x = room.left() + self._white / max(bins - 1, 1) * room.width()
            painter.setPen(theme.pen(ours.text, 1.0))
            painter.drawLine(QPointF(x, frame.top()), QPointF(x, frame.bottom()))
