"""The picture of the 3D page: shows what the drawing process sent, and turns mouse and keys into a moved eye.

Drag orbits, Shift or another button pans, the wheel zooms about the mouse, a double click asks for the point under it.
Arrow keys orbit, with Shift they pan; + and - zoom. Drawn over the picture: axes, scale, the camera under the
mouse and the chosen one. It is dark in either theme: what shines is judged on dark ground.
"""

import math

import numpy as np
from jaxtyping import Float
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import (
    QColor,
    QFocusEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QNativeGestureEvent,
    QPainter,
    QPaintEvent,
    QPen,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QApplication, QSizePolicy, QWidget

from app.viewer import frusta, orbit, showing
from app.viewer.events import Picture
from app.viewer.orbit import Orbit
from app.viewer.protocol import AXES
from app.viewer.showing import Showing
from app.views import theme
from app.views.pictures import paint as image_paint
from app.views.theme import DARK

TURN = math.radians(210)  # a drag across the whole height
NOTCH = 1.18  # zoom of one step of the wheel
KEY_TURN, KEY_PAN, KEY_ZOOM = math.radians(6), 48.0, 1.15
CLICK_PX = 4  # a press that moves less is a click
TRIAD_PX, MARGIN = 30.0, 18
SCALE_PX = 130.0


class ViewCanvas(QWidget):
    """Emits what the person wants; the page decides."""

    eye_moved = Signal(object, bool)  # Orbit; whether it goes on moving
    picked = Signal(int)  # a camera was clicked; -1: the ground was
    pointed = Signal(int)  # the camera under the mouse; -1: none
    clicked = Signal(float, float)  # a click, wherever; as shares of the size
    probed = Signal(float, float)  # a double click
    resized = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.showing = Showing()
        self.picture: Picture | None = None
        self._image: QImage | None = None
        self._pyramids, self._known = showing.pyramids(self.showing)
        self._marks: Float[np.ndarray, "n 3"] = np.empty((0, 3))
        self._pressed: QPointF | None = None
        self._held: QPointF | None = None
        self._hover = -1
        self._clicked = QPointF()
        self._click = QTimer(self)  # a click is one once it is not the first half of a double click
        self._click.setSingleShot(True)
        self._click.setInterval(QApplication.doubleClickInterval())
        self._click.timeout.connect(self._tell_click)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(240, 180)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setAccessibleName(self.tr("3D view"))
        self.setAccessibleDescription(
            self.tr("Arrow keys orbit, with Shift they pan, plus and minus zoom, R resets the view")
        )

    def show_state(self, state: Showing) -> None:
        """What is on, and where the eye should be; the picture follows when it is drawn."""
        before, self.showing = self.showing, state
        if state.contents is not before.contents:
            self._hover = -1
        if state.contents is not before.contents or state.style.frusta != before.style.frusta:
            self._pyramids, self._known = showing.pyramids(state)
        self.update()

    def show_picture(self, picture: Picture | None) -> None:
        self.picture = picture
        self._image = (
            None
            if picture is None
            else QImage(
                picture.pixels, picture.width, picture.height, 4 * picture.width, QImage.Format.Format_RGB32
            )
        )
        self.update()

    def show_marks(self, points: Float[np.ndarray, "n 3"]) -> None:
        """Crosses at points, world frame, and a line between two."""
        self._marks = points
        self.update()

    def device_size(self) -> tuple[int, int]:
        """In pixels of the screen."""
        ratio = self.devicePixelRatioF()
        return max(round(self.width() * ratio), 1), max(round(self.height() * ratio), 1)

    def screenshot(self) -> QImage | None:
        """What is seen, axes and scale with it, without what only helps to choose."""
        if self._image is None:
            return None
        ratio = self.devicePixelRatioF()
        shot = QImage(*self.device_size(), QImage.Format.Format_RGB32)
        shot.setDevicePixelRatio(ratio)
        painter = QPainter(shot)
        self._paint_picture(painter)
        self._paint_guides(painter)
        painter.end()
        return shot

    # Painting

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        self._paint_picture(painter)
        if self._image is not None:
            self._paint_cameras(painter)
            self._paint_guides(painter)
            flat = orbit.project(self._seen_from, self._marks, self.width(), self.height())
            image_paint.marks(painter, [QPointF(x, y) for x, y, _ in flat if np.isfinite(x)])
        theme.ring(painter, self, DARK)

    def _paint_picture(self, painter: QPainter) -> None:
        if self._image is None:
            painter.fillRect(self.rect(), QColor(DARK.picture))
            return
        same = (self._image.width(), self._image.height()) == self.device_size()
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, not same)
        # A picture of another shape, while the window is being resized, keeps its own.
        scale = self.height() / self._image.height()
        width = self._image.width() * scale
        if abs(width - self.width()) > 2:
            painter.fillRect(self.rect(), QColor(DARK.picture))
        else:
            width = self.width()
        painter.drawImage(QRectF((self.width() - width) / 2, 0, width, self.height()), self._image)

    def _paint_cameras(self, painter: QPainter) -> None:
        """The one under the mouse, and the chosen one."""
        if "cameras" not in self.showing.style.visible:
            return
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for view, colour, width in (
            (self.showing.chosen, DARK.accent, 2.0),
            (self._hover, DARK.text, 1.6),
        ):
            if not 0 <= view < len(self._pyramids) or not self._known[view]:
                continue
            flat = orbit.project(self._seen_from, self._pyramids[view], self.width(), self.height())
            if not np.isfinite(flat).all():
                continue
            painter.setPen(QPen(QColor(colour), width))
            for a, b in frusta.EDGES:
                painter.drawLine(QPointF(*flat[a, :2]), QPointF(*flat[b, :2]))
            name = self.showing.contents.names[view] if view < len(self.showing.contents.names) else ""
            top = flat[flat[:, 1].argmin()]
            self._paint_text(painter, name, QPointF(top[0], top[1] - 8), QColor(colour))

    def _paint_guides(self, painter: QPainter) -> None:
        """Axes at the lower left, scale at the lower right."""
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = QPointF(MARGIN + TRIAD_PX + 8, self.height() - MARGIN - TRIAD_PX - 8)
        turned = orbit.axes(self._seen_from).T  # row k: the world's axis k, as the eye has it
        for k in np.argsort(-turned[:, 2]):
            end = middle + QPointF(*turned[k, :2]) * TRIAD_PX
            colour = QColor(*AXES[k])
            if turned[k, 2] > 0.15:
                colour = colour.darker(140)
            pen = QPen(colour, 2.2)
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            painter.drawLine(middle, end)
            beyond = middle + QPointF(*turned[k, :2]) * (TRIAD_PX + 10)
            self._paint_text(painter, "XYZ"[k], beyond, colour, centred=True)
        longest = min(SCALE_PX, self.width() / 4)
        length, pixels = orbit.scale_bar(self._seen_from, self.height(), longest)
        number, unit = showing.length_text(length, self.showing.contents.unit)
        right, base = self.width() - MARGIN, self.height() - MARGIN
        pen = QPen(QColor(DARK.text), 1.6)
        pen.setCapStyle(Qt.PenCapStyle.FlatCap)
        painter.setPen(pen)
        for x in (right - pixels, right):
            painter.drawLine(QPointF(x, base - 4), QPointF(x, base + 4))
        painter.drawLine(QPointF(right - pixels, base), QPointF(right, base))
        text = f"{number} {unit or self.tr('scene units')}"
        wide = painter.fontMetrics().horizontalAdvance(text)
        self._paint_text(painter, text, QPointF(right - wide, base - 9), QColor(DARK.text))

    def _paint_text(
        self, painter: QPainter, text: str, at: QPointF, colour: QColor, centred: bool = False
    ) -> None:
        """With a dark rim, to be read on anything."""
        metrics = painter.fontMetrics()
        if centred:
            at = at + QPointF(-metrics.horizontalAdvance(text) / 2, metrics.capHeight() / 2)
        shade = QColor(DARK.picture)
        shade.setAlpha(190)
        painter.setPen(shade)
        for x, y in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            painter.drawText(at + QPointF(x, y), text)
        painter.setPen(colour)
        painter.drawText(at, text)

    @property
    def _seen_from(self) -> Orbit:
        """The eye of the picture that is on the screen."""
        return self.showing.eye if self.picture is None else self.picture.look.orbit

    # Mouse and keys

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._pressed = self._held = event.position()
        self.setFocus(Qt.FocusReason.MouseFocusReason)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        at = event.position()
        if self._held is None or self._pressed is None:
            self._point_at(at)
            return
        if (at - self._pressed).manhattanLength() < CLICK_PX and self._held == self._pressed:
            return
        step, self._held = at - self._held, at
        eye = self.showing.eye
        shift = event.modifiers() & Qt.KeyboardModifier.ShiftModifier
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            eye = orbit.zoomed(eye, math.exp(-3 * step.y() / self.height()))
        elif event.buttons() & Qt.MouseButton.LeftButton and not shift:
            turn = TURN / self.height()
            eye = orbit.turned(eye, -turn * step.x(), turn * step.y())
        else:
            eye = orbit.panned(eye, step.x(), step.y(), self.height())
        self._move(eye)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        clicked = self._held is not None and self._held == self._pressed
        self._pressed = self._held = None
        if clicked and event.button() == Qt.MouseButton.LeftButton:
            self._clicked = event.position()
            self._click.start()
        elif not clicked:
            self.eye_moved.emit(self.showing.eye, False)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self._click.stop()
        self.probed.emit(event.position().x() / self.width(), event.position().y() / self.height())

    def wheelEvent(self, event: QWheelEvent) -> None:
        notches = event.angleDelta().y() / 120
        if notches:
            self._zoom(NOTCH**notches, event.position())
        event.accept()

    def event(self, event: QEvent) -> bool:
        if (
            isinstance(event, QNativeGestureEvent)
            and event.gestureType() == Qt.NativeGestureType.ZoomNativeGesture
        ):
            self._zoom(max(1 + event.value(), 0.2), event.position())
            return True
        return super().event(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._set_hover(-1)
        super().leaveEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        across, down = {
            Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, -1), Qt.Key.Key_Down: (0, 1),
        }.get(Qt.Key(event.key()), (0, 0))  # fmt: skip
        eye = self.showing.eye
        if across or down:
            if event.modifiers() & Qt.KeyboardModifier.ShiftModifier:
                self._move(orbit.panned(eye, -KEY_PAN * across, -KEY_PAN * down, self.height()))
            else:
                self._move(orbit.turned(eye, KEY_TURN * across, -KEY_TURN * down))
        elif event.key() in (Qt.Key.Key_Plus, Qt.Key.Key_Equal, Qt.Key.Key_PageUp):
            self._move(orbit.zoomed(eye, KEY_ZOOM))
        elif event.key() in (Qt.Key.Key_Minus, Qt.Key.Key_PageDown):
            self._move(orbit.zoomed(eye, 1 / KEY_ZOOM))
        else:
            super().keyPressEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.resized.emit()

    def focusInEvent(self, event: QFocusEvent) -> None:
        super().focusInEvent(event)
        self.update()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        self.update()

    def _zoom(self, factor: float, at: QPointF) -> None:
        size = (self.width(), self.height())
        self._move(orbit.zoomed(self.showing.eye, factor, (at.x(), at.y()), size))

    def _move(self, eye: Orbit) -> None:
        self.eye_moved.emit(eye, True)

    def _tell_click(self) -> None:
        self.clicked.emit(self._clicked.x() / self.width(), self._clicked.y() / self.height())
        self.picked.emit(self._camera_at(self._clicked))

    def _camera_at(self, at: QPointF) -> int:
        if "cameras" not in self.showing.style.visible or self.picture is None:
            return -1
        found = frusta.picked(
            self._seen_from, self._pyramids, self._known, at.x(), at.y(), self.width(), self.height()
        )
        return -1 if found is None else found

    def _point_at(self, at: QPointF) -> None:
        self._set_hover(self._camera_at(at))

    def _set_hover(self, view: int) -> None:
        if view != self._hover:
            self._hover = view
            self.setCursor(Qt.CursorShape.PointingHandCursor if view >= 0 else Qt.CursorShape.ArrowCursor)
            self.pointed.emit(view)
            self.update()
