"""A pane through which a picture is looked at: zoom, places and arrow keys, shared by views and by the mask's canvas.

Wheel and pinch zoom about the mouse; arrow keys are told apart into steps of the cursor (by a pixel, with Shift by ten)
and, with Ctrl, panning. Places are in picture widths, as `viewport` has them.
"""

from PySide6.QtCore import QEvent, QPointF, QSizeF, Qt
from PySide6.QtGui import QKeyEvent, QNativeGestureEvent, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.views.pictures.viewport import Viewport

NOTCH = 1.2  # zoom of one step of the wheel
PAN_PX, FAR_PIXELS = 40, 10
ARROWS = {
    Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, -1), Qt.Key.Key_Down: (0, 1)
}  # fmt: skip


class Pane(QWidget):
    """Abstract: what it shows and what else mouse and keys do is up to who derives from it."""

    def __init__(self, parent: QWidget | None, viewport: Viewport | None = None) -> None:
        super().__init__(parent)
        self.viewport = viewport or Viewport(self)
        self.viewport.join(self)
        self.viewport.moved.connect(self.update)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)

    # Places

    def room(self) -> QSizeF | None:
        """For the viewport: the size while shown."""
        return QSizeF(self.size()) if self.isVisible() else None

    def to_picture(self, at: QPointF) -> QPointF:
        """A place of this widget in picture widths."""
        return self.viewport.centre + (at - self._middle()) / self.viewport.span

    def from_picture(self, at: QPointF) -> QPointF:
        """A place in picture widths on this widget."""
        return self._middle() + (at - self.viewport.centre) * self.viewport.span

    def _middle(self) -> QPointF:
        return QPointF(self.width() / 2, self.height() / 2)

    # Moving about

    def step(self, columns: int, rows: int) -> None:
        """The arrow keys move the cursor by so many pixels."""
        self.viewport.step(columns, rows)

    def moved_by_arrows(self, event: QKeyEvent) -> bool:
        """Whether the key was an arrow, which then did what arrows do."""
        if event.key() not in ARROWS:
            return False
        columns, rows = ARROWS[Qt.Key(event.key())]
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            self.viewport.pan(QPointF(columns, rows) * -PAN_PX)
        else:
            by = FAR_PIXELS if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1
            self.step(by * columns, by * rows)
        return True

    def wheelEvent(self, event: QWheelEvent) -> None:
        steps = event.angleDelta().y() / 120
        if steps:
            self.viewport.zoom(NOTCH**steps, self.to_picture(event.position()))
        event.accept()

    def event(self, event: QEvent) -> bool:
        pinch = Qt.NativeGestureType.ZoomNativeGesture
        if isinstance(event, QNativeGestureEvent) and event.gestureType() == pinch:
            self.viewport.zoom(1 + event.value(), self.to_picture(event.position()))
            return True
        return super().event(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.viewport.refit()

    def showEvent(self, event: QEvent) -> None:
        self.viewport.refit()
