"""The photograph that one paints on: zoom and pan as in the other pictures, the overlay, and what hand or keys do.

The left button paints or sets corners, the middle one (or the right) pans, the wheel zooms about the mouse. Arrow
keys move the cursor by a pixel (Shift: ten), Ctrl+arrows pan; Space paints at the cursor, or sets a corner; Enter
sets a corner too where the keys brought the cursor, and closes the polygon where it stands on the last corner or the
mouse moved it. A pen's pressure scales the brush.
"""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QEvent, QLineF, QPointF, QSizeF, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QFocusEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QTabletEvent,
)
from PySide6.QtWidgets import QWidget

from app.masking import Editor, Patch, Place
from app.views import theme
from app.views.mask import paint as mask_paint
from app.views.pictures import paint as image_paint
from app.views.pictures.pane import Pane
from app.views.pixels import image_of
from app.views.theme import colours

CLOSE_BY = 8.0  # logical pixels from a polygon's first corner that close it
PANS = (Qt.MouseButton.MiddleButton, Qt.MouseButton.RightButton)


class MaskCanvas(Pane):
    """Shows what it is given, and hands what is done to the editor."""

    painted = Signal(object)  # a Patch that is in the painting already
    pointed = Signal()

    def __init__(self, parent: QWidget | None, editor: Editor) -> None:
        super().__init__(parent)
        self.editor = editor
        self.viewport.pointed.connect(self._pointed)
        self.opacity, self.shows_outline, self.shows_overlay = 0.6, True, True
        self._levels: list[QImage] = []
        self._found: QImage | None = None
        self._border: list[QLineF] = []
        self._strokes: QImage | None = None
        self._held: QPointF | None = None  # while panning
        self._by_keys = False  # whether the keys moved the cursor last
        self.setAccessibleName(self.tr("Photograph to paint on"))
        self.setAccessibleDescription(
            self.tr("Arrow keys move the cursor, Space paints or sets a corner, Enter closes a polygon")
        )
        self.setMinimumSize(160, 120)
        self.setCursor(Qt.CursorShape.CrossCursor)

    # What is shown

    def show_picture(self, levels: Sequence[np.ndarray]) -> None:
        """A photograph as `falsecolour.halves` makes it."""
        self._levels = [image_of(level) for level in levels]
        self.update()

    def show_found(self, mask: np.ndarray | None, border: np.ndarray) -> None:
        """The object found, and its border as `outline` gives it."""
        self._found, self._border = None, []
        if mask is not None:
            self._found = mask_paint.flat(_aligned(mask))
            self._border = [QLineF(*piece) for piece in border.tolist()]
        self._colour()

    def show_painting(self) -> None:
        """The editor has another painting."""
        painting = self.editor.painting
        self._strokes = None if painting is None else mask_paint.flat(painting.labels)
        self._colour()

    def show_overlay(self, shown: bool) -> None:
        self.shows_overlay = shown
        self.update()

    def show_outline(self, shown: bool) -> None:
        self.shows_outline = shown
        self.update()

    def set_opacity(self, opacity: float) -> None:
        self.opacity = opacity
        self.update()

    def _colour(self) -> None:
        ours = colours(self)
        if self._found is not None:
            mask_paint.coloured(self._found, {1: ours.accent})
        if self._strokes is not None:
            mask_paint.coloured(self._strokes, mask_paint.label_colours(ours))
        self.update()

    # Places

    def _place(self) -> Place | None:
        """The cursor in pixels of the picture; on their middle while the keys move it."""
        pixel, cursor = self.viewport.pixel(), self.viewport.cursor
        if self._by_keys and pixel is not None:
            return pixel[0] + 0.5, pixel[1] + 0.5
        wide = self.viewport.picture.width
        return None if cursor is None else (cursor.x() * wide, cursor.y() * wide)

    def _pointed(self) -> None:
        self.update()
        self.pointed.emit()

    # Painting on the screen

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        ours = colours(self)
        painter.fillRect(self.rect(), QColor(ours.picture))
        if not self._levels:
            theme.ring(painter, self, ours)
            return
        corner, room, scale = self.from_picture(QPointF(0, 0)), QSizeF(self.size()), self.viewport.scale
        image_paint.picture(painter, self._levels, corner, self.viewport.span, self.devicePixelRatioF(), room)
        if self.shows_overlay:
            if self._found is not None:
                mask_paint.overlay(painter, self._found, self.opacity * mask_paint.TINT, corner, scale, room)
            if self._strokes is not None:
                mask_paint.overlay(painter, self._strokes, self.opacity**0.5, corner, scale, room)
            if self.shows_outline:
                mask_paint.outline(painter, self._border, corner, scale, ours.accent)
        self._paint_tool(painter, corner, scale)
        theme.ring(painter, self, ours)

    def _paint_tool(self, painter: QPainter, corner: QPointF, scale: float) -> None:
        editor, place = self.editor, self._place()
        inks = mask_paint.label_colours(colours(self))
        ink = inks.get(editor.label, mask_paint.BRIGHT.name())
        at = None if place is None else corner + QPointF(*place) * scale
        if editor.tool == "polygon":
            if editor.corners:
                mask_paint.polygon(painter, editor.corners, at, corner, scale, ink)
            if at is not None and self._by_keys:
                mask_paint.brush(painter, at, 1, ink)
        elif at is not None and self._held is None:
            mask_paint.brush(painter, at, editor.size * scale, ink)

    # The hand

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() in PANS:
            self._held = event.position()
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
        elif event.button() == Qt.MouseButton.LeftButton and self._held is None:
            self._point(event.position())
            self._down()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        at = event.position()
        if self._held is not None:
            self.viewport.pan(at - self._held)
            self._held = at
        self._point(at)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if event.button() in PANS:
            self._held = None
            self.setCursor(Qt.CursorShape.CrossCursor)
        elif event.button() == Qt.MouseButton.LeftButton:
            self._tell(self.editor.release())

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton and self.editor.tool == "polygon":
            self._tell(self.editor.close())
        else:
            self.mousePressEvent(event)

    def tabletEvent(self, event: QTabletEvent) -> None:
        if self.editor.tool == "polygon":
            event.ignore()  # comes again as a click
        elif event.type() == QEvent.Type.TabletPress and event.button() == Qt.MouseButton.LeftButton:
            self._point(event.position())
            self._down(event.pressure())
        elif event.type() == QEvent.Type.TabletMove:
            self._point(event.position(), event.pressure())
        elif event.type() == QEvent.Type.TabletRelease and self.editor.drawing:
            self._tell(self.editor.release())
        else:
            event.ignore()

    def leaveEvent(self, event: QEvent) -> None:
        if not self.editor.drawing and not self._by_keys:
            self.viewport.point(None)

    def _point(self, at: QPointF, pressure: float = 1.0) -> None:
        self._by_keys = False
        self.viewport.point(self.to_picture(at) if self._levels else None)
        place = self._place()
        if place is not None:
            self.editor.drag(place, pressure)

    def _down(self, pressure: float = 1.0) -> None:
        """Press the tool down at the cursor."""
        place, corners = self._place(), self.editor.corners
        if place is None:
            return
        if self.editor.tool == "polygon":
            way = QPointF(*place) - QPointF(*corners[0]) if len(corners) > 2 else None
            if way is not None and QLineF(QPointF(), way).length() * self.viewport.scale <= CLOSE_BY:
                self._tell(self.editor.close())
            else:
                self.editor.corner(place)
        else:
            self.editor.press(place, pressure)
        self.update()

    def _tell(self, patch: Patch | None) -> None:
        self.update()
        if patch is not None:
            self.painted.emit(patch)

    # Keys

    def keyPressEvent(self, event: QKeyEvent) -> None:
        key = event.key()
        if self.moved_by_arrows(event):
            return
        if key == Qt.Key.Key_Space:
            if not event.isAutoRepeat() and not self.editor.drawing:
                self._take_keys()
                self._down()
        elif key in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.editor.tool == "polygon":
            self._enter()
        elif key == Qt.Key.Key_Backspace and self.editor.corners:
            self.editor.drop_corner()
            self.update()
        elif key == Qt.Key.Key_Escape and self.editor.corners:
            self.editor.choose(self.editor.tool)
            self.update()
        else:
            super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Space and not event.isAutoRepeat():
            self._tell(self.editor.release())
        else:
            super().keyReleaseEvent(event)

    def _take_keys(self) -> None:
        """From here the keys lead; a cursor that is nowhere begins in the middle."""
        self._by_keys = True
        if self.viewport.pixel() is None:
            self.viewport.step(0, 0)

    def step(self, columns: int, rows: int) -> None:
        """The arrow keys move the cursor by so many pixels, and draw with the tool that is held down."""
        if not self._levels:
            return
        self._by_keys = True
        super().step(columns, rows)
        place = self._place()
        if place is not None:
            self.editor.drag(place)

    def _enter(self) -> None:
        place, corners = self._place(), self.editor.corners
        if self._by_keys and place is not None and corners[-1:] != [place]:
            self._down()
        else:
            self._tell(self.editor.close())

    # The window

    def focusOutEvent(self, event: QFocusEvent) -> None:
        # The release of a key that is held goes to whoever has the focus then.
        self._tell(self.editor.release())
        super().focusOutEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._colour()
        super().changeEvent(event)


def _aligned(mask: np.ndarray) -> np.ndarray:
    """A mask as labels 0 and 1 whose rows begin at whole words."""
    height, width = mask.shape
    labels = np.zeros((height, -(-width // 4) * 4), np.uint8)[:, :width]
    labels[...] = mask
    return labels
