"""The relit object, as large as there is room for; dragging turns the room's light, or moves a lamp that stands before it."""

import math

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, QSizeF, Qt, Signal
from PySide6.QtGui import QColor, QImage, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.views import theme
from app.views.pixels import image_of
from app.views.theme import colours

DEGREES_PER_PIXEL = 0.4
KEY_DEGREES = 5.0
KEY_REACH = 0.08  # of the half sphere that the lamp moves on
MARK_PX = 9.0
LARGEST = 6.0  # times the preview's size


class RelightCanvas(QWidget):
    """A picture, or nothing."""

    turned = Signal(float, float)  # by yaw, pitch, degrees
    lamp_moved = Signal(float, float)  # to (right, up) on its half sphere, 1 at the rim
    exposed = Signal(int)  # by notches of the wheel

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._image: QImage | None = None
        self._corner = ""
        self._held: QPointF | None = None
        self._lamp: tuple[float, float] | None = None
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setCursor(Qt.CursorShape.OpenHandCursor)
        self.setMinimumSize(240, 200)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName(self.tr("Relit object; drag or use the arrow keys to turn the light"))

    def sizeHint(self) -> QSize:
        return QSize(640, 520)

    def show_pixels(self, pixels: np.ndarray | None) -> None:
        """A picture of `falsecolour`; None: nothing."""
        self._image = None if pixels is None else image_of(pixels)
        self.update()

    def show_lamp(self, lamp: tuple[float, float] | None) -> None:
        """Mark a lamp, which dragging and the arrow keys then move; None: they turn the room's light."""
        self._lamp = lamp
        self.update()

    def say(self, corner: str) -> None:
        """A small line in the corner."""
        if corner != self._corner:
            self._corner = corner
            self.update()

    @property
    def image(self) -> QImage | None:
        return self._image

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        ours = colours(self)
        painter.fillRect(self.rect(), QColor(ours.picture))
        painter.setPen(QColor(ours.dim))
        if self._image is None:
            theme.ring(painter, self, ours)
            return
        size = QSizeF(self._image.size())
        room = QSizeF(self.width() - 16, self.height() - 16)
        fit = min(room.width() / size.width(), room.height() / size.height(), LARGEST)
        shown = QRectF(0, 0, size.width() * fit, size.height() * fit)
        shown.moveCenter(QRectF(self.rect()).center())
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(shown, self._image)
        if self._lamp is not None:
            self._mark(painter, self._lamp)
        font = painter.font()
        font.setPixelSize(11)
        painter.setFont(font)
        painter.drawText(
            self.rect().adjusted(10, 6, -10, -6), Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignBottom,
            self._corner,
        )  # fmt: skip
        theme.ring(painter, self, ours)

    def _mark(self, painter: QPainter, lamp: tuple[float, float]) -> None:
        """A small sun where the lamp stands."""
        at = QRectF(self.rect()).center() + QPointF(lamp[0], -lamp[1]) * self._reach()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(QColor(0, 0, 0, 160), 1.5))
        painter.setBrush(QColor(255, 214, 92))
        painter.drawEllipse(at, MARK_PX, MARK_PX)

    def _reach(self) -> float:
        """Pixels from the middle to the rim of the half sphere that the lamp moves on."""
        return 0.5 * min(self.width(), self.height()) - 2 * MARK_PX

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._held = event.position()
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
            if self._lamp is not None:
                self._move_lamp(event.position())

    def _move_lamp(self, to: QPointF) -> None:
        way = (to - QRectF(self.rect()).center()) / self._reach()
        by = 1 / max(1.0, math.hypot(way.x(), way.y()))
        self.lamp_moved.emit(way.x() * by, -way.y() * by)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._held is not None and self._lamp is not None:
            self._move_lamp(event.position())
        elif self._held is not None:
            by = event.position() - self._held
            self._held = event.position()
            self.turned.emit(by.x() * DEGREES_PER_PIXEL, -by.y() * DEGREES_PER_PIXEL)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._held = None
        self.setCursor(Qt.CursorShape.OpenHandCursor)

    def wheelEvent(self, event: QWheelEvent) -> None:
        notches = round(event.angleDelta().y() / 120)
        if notches:
            self.exposed.emit(notches)
        event.accept()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        ways = {
            Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, 1), Qt.Key.Key_Down: (0, -1)
        }  # fmt: skip
        way = ways.get(Qt.Key(event.key()))
        if way is None:
            super().keyPressEvent(event)
        elif self._lamp is not None:
            right, up = (old + KEY_REACH * by for old, by in zip(self._lamp, way, strict=True))
            by = 1 / max(1.0, math.hypot(right, up))
            self.lamp_moved.emit(right * by, up * by)
        else:
            self.turned.emit(way[0] * KEY_DEGREES, way[1] * KEY_DEGREES)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self.update()
        super().changeEvent(event)
