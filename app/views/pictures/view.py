"""A picture to zoom and pan, linked with others by a shared viewport; two pictures under a swipe.

Wheel or pinch zooms about the mouse, dragging pans, a double click is told to the owner. Arrow keys move the
cursor by a pixel (Shift: ten), Ctrl+arrows pan, + and - zoom, F fits the object, Shift+F the picture, 1 shows pixels
as they are; comma and full stop move the swipe. From GRID pixels of the screen per pixel the pixels are outlined, and
further on their values stand in them.
"""

from collections.abc import Callable, Sequence

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, QSizeF, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
)
from PySide6.QtWidgets import QApplication, QWidget

from app.views import theme
from app.views.pictures import paint as image_paint
from app.views.pictures.pane import NOTCH, Pane
from app.views.pictures.viewport import Viewport
from app.views.pixels import image_of
from app.views.theme import colours

GRID = 12.0  # logical pixels of the screen per pixel of the picture
GRIP = 8  # logical pixels around the swipe's edge that take hold of it

Levels = Sequence[np.ndarray]  # of `falsecolour`: uint8 [h w 4], each half the size of the one before


class ImageView(Pane):
    """One picture, or two with a swipe between them."""

    activated = Signal()  # double click
    clicked = Signal()  # without a drag
    swiped = Signal(float)

    def __init__(self, parent: QWidget | None = None, viewport: Viewport | None = None) -> None:
        super().__init__(parent, viewport)
        self.viewport.pointed.connect(self.update)
        self.message = ""  # in place of a picture
        self.pixel_text: Callable[[int, int], str] | None = None
        self.labels: tuple[str, str] = ("", "")  # at the left and the right of the swipe
        self._images: list[QImage] = []
        self._others: list[QImage] = []
        self._split = 0.5
        self._held: QPointF | None = None
        self._pressed = QPointF()
        self._swiping = False
        self.setMinimumSize(96, 72)

    def sizeHint(self) -> QSize:
        return QSize(320, 240)

    # What is shown

    def show_picture(self, levels: Levels | None, other: Levels | None = None, message: str = "") -> None:
        """Show a picture, or `message` where there is none; `other` lies to the right of the swipe."""
        self._images = [image_of(level) for level in levels or ()]
        self._others = [image_of(level) for level in other or ()]
        self.message = message
        self.update()

    @property
    def full(self) -> QImage | None:
        """The picture at its own size."""
        return self._images[0] if self._images else None

    @property
    def split(self) -> float:
        """Where the swipe is, as a share of the view's width."""
        return self._split

    def set_split(self, share: float) -> None:
        share = min(max(share, 0.0), 1.0)
        if share != self._split:
            self._split = share
            self.swiped.emit(share)
            self.update()

    @property
    def swipes(self) -> bool:
        return bool(self._others)

    # Painting

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        ours = colours(self)
        painter.fillRect(self.rect(), QColor(ours.picture))
        if not self._images:
            painter.setPen(QColor(ours.dim))
            box = self.rect().adjusted(12, 12, -12, -12)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, self.message)
            theme.ring(painter, self, ours)
            return
        corner, room = self.from_picture(QPointF(0, 0)), QSizeF(self.size())
        scale, size = self.viewport.scale, (self.viewport.picture.width, self.viewport.picture.height)
        edge = round(self._split * self.width()) + 0.5 if self._others else self.width()
        for images, clip in (
            (self._images, QRectF(0, 0, edge, self.height())),
            (self._others, QRectF(edge, 0, self.width() - edge, self.height())),
        ):
            if images:
                painter.save()
                painter.setClipRect(clip)
                ratio = self.devicePixelRatioF()
                image_paint.picture(painter, images, corner, self.viewport.span, ratio, room)
                painter.restore()
        if scale >= GRID:
            image_paint.grid(painter, corner, scale, size, room, self._images[0], self.pixel_text)
        pixel = self.viewport.pixel()
        if pixel is not None:
            image_paint.cursor(painter, corner, scale, pixel)
        image_paint.marks(painter, [self.from_picture(at) for at in self.viewport.marks])
        if self._others:
            image_paint.swipe(painter, edge, room, ours, self.labels)
        theme.ring(painter, self, ours)

    # Mouse, wheel, keys

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() in (Qt.MouseButton.LeftButton, Qt.MouseButton.MiddleButton):
            self._swiping = event.button() == Qt.MouseButton.LeftButton and self._on_edge(event.position())
            self._held = self._pressed = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        at = event.position()
        if self._held is not None and self._swiping:
            self.set_split(at.x() / max(self.width(), 1))
        elif self._held is not None:
            self.viewport.pan(at - self._held)
            self._held = at
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
        elif self._on_edge(at):
            self.setCursor(Qt.CursorShape.SplitHCursor)
        else:
            self.setCursor(Qt.CursorShape.CrossCursor if self._images else Qt.CursorShape.ArrowCursor)
        self.viewport.point(self.to_picture(at) if self._images else None)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        still = (event.position() - self._pressed).manhattanLength() < QApplication.startDragDistance()
        if (
            event.button() == Qt.MouseButton.LeftButton
            and self._held is not None
            and still
            and not self._swiping
        ):
            self.viewport.point(self.to_picture(event.position()) if self._images else None)
            self.clicked.emit()
        self._held, self._swiping = None, False
        self.unsetCursor()

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self._held = None
        if self._on_edge(event.position()):
            self.set_split(0.5)
        else:
            self.activated.emit()

    def leaveEvent(self, event: QEvent) -> None:
        self.viewport.point(None)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        key, held = event.key(), event.modifiers()
        if self.moved_by_arrows(event):
            return
        if key in (Qt.Key.Key_Plus, Qt.Key.Key_Equal):
            self.viewport.zoom(NOTCH, self.viewport.cursor)
        elif key == Qt.Key.Key_Minus:
            self.viewport.zoom(1 / NOTCH, self.viewport.cursor)
        elif key == Qt.Key.Key_F:
            self.viewport.fit("all" if held & Qt.KeyboardModifier.ShiftModifier else "object")
        elif key == Qt.Key.Key_1:
            self.viewport.natural(self.devicePixelRatioF())
        elif key in (Qt.Key.Key_Comma, Qt.Key.Key_Period) and self.swipes:
            self.set_split(self._split + (0.02 if key == Qt.Key.Key_Period else -0.02))
        elif key in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self.activated.emit()
        else:
            super().keyPressEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self.update()
        super().changeEvent(event)

    def _on_edge(self, at: QPointF) -> bool:
        return bool(self._others) and abs(at.x() - self._split * self.width()) <= GRIP
