"""Where several pictures of one scene are looked at: shared, so that they zoom, pan and point together.

Positions and lengths are in picture widths (x / width, y / width): pictures of one scene in different sizes stay
linked. `span` is how many logical pixels of the screen a picture's width takes.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

from PySide6.QtCore import QObject, QPointF, QRectF, QSizeF, Signal

Fit = Literal["object", "all"]

CLOSEST = 96.0  # logical pixels of the screen per pixel of the picture
MARGIN = 0.04  # around what is fitted, of its size


class Looker(Protocol):
    """A view that is linked: how large it is, while it is shown."""

    def room(self) -> QSizeF | None: ...


@dataclass(slots=True)
class Picture:
    """The size that zoom limits and fits are about."""

    width: int = 1
    height: int = 1
    object: QRectF | None = None  # in picture widths


class Viewport(QObject):
    """Zoom, position and the pixel pointed at, of all views that share it."""

    moved = Signal()
    pointed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.span = 100.0
        self.centre = QPointF(0.5, 0.5)
        self.cursor: QPointF | None = None
        self.marks: tuple[QPointF, ...] = ()
        self.fitted: Fit | None = "object"
        self.picture = Picture()
        self._lookers: list[Looker] = []

    def join(self, looker: Looker) -> None:
        self._lookers.append(looker)

    def leave(self, looker: Looker) -> None:
        if looker in self._lookers:
            self._lookers.remove(looker)

    def show(self, width: int, height: int, object_box: tuple[int, int, int, int] | None) -> None:
        """A new picture's size and the object's box (left, top, right, bottom; pixels); keeps the place if alike."""
        rect = _rect(width, object_box)
        changed = (width, height) != (self.picture.width, self.picture.height) or rect != self.picture.object
        self.picture = Picture(width, height, rect)
        if changed:
            self.cursor, self.marks = None, ()
            self.fit("object")

    def aim(self, object_box: tuple[int, int, int, int] | None) -> None:
        """The same picture's object is elsewhere; what is shown stays."""
        self.picture.object = _rect(self.picture.width, object_box)

    @property
    def scale(self) -> float:
        """Logical pixels of the screen per pixel of the picture."""
        return self.span / self.picture.width

    def fit(self, what: Fit) -> None:
        """Show the whole object, or the whole picture, in every view; and again when views change their size."""
        self.fitted = what
        rooms = [
            room for looker in self._lookers if (room := looker.room()) is not None and not room.isEmpty()
        ]
        if not rooms:
            return
        whole = QRectF(0, 0, 1, self.picture.height / self.picture.width)
        rect = self.picture.object if what == "object" and self.picture.object is not None else whole
        width = min(room.width() for room in rooms)
        height = min(room.height() for room in rooms)
        wide = max(rect.width(), 1e-9) * (1 + 2 * MARGIN)
        high = max(rect.height(), 1e-9) * (1 + 2 * MARGIN)
        self.span = min(width / wide, height / high, CLOSEST * self.picture.width)
        self.centre = rect.center()
        self.moved.emit()

    def refit(self) -> None:
        """After a view changed its size."""
        if self.fitted is not None:
            self.fit(self.fitted)

    def zoom(self, factor: float, about: QPointF | None = None) -> None:
        """Change the scale, keeping the point `about` (picture widths) where it is on the screen."""
        low, high = 16.0, CLOSEST * self.picture.width
        span = min(max(self.span * factor, low), high)
        about = about or self.centre
        self.centre = about + (self.centre - about) * (self.span / span)
        self.span, self.fitted = span, None
        self._keep()
        self.moved.emit()

    def natural(self, device_ratio: float) -> None:
        """One pixel of the picture on one pixel of the screen."""
        self.zoom(self.picture.width / device_ratio / self.span, self.cursor)

    def pan(self, by: QPointF) -> None:
        """Move what is shown by logical pixels of the screen."""
        self.centre = self.centre - by / self.span
        self.fitted = None
        self._keep()
        self.moved.emit()

    def point(self, at: QPointF | None) -> None:
        """The place that is read out; None: nowhere."""
        if at != self.cursor:
            self.cursor = at
            self.pointed.emit()

    def mark(self, at: tuple[QPointF, ...]) -> None:
        """Mark these places; a line joins two."""
        self.marks = at
        self.moved.emit()

    def pixel(self) -> tuple[int, int] | None:
        """Column and row under the cursor; None outside the picture."""
        if self.cursor is None:
            return None
        x, y = int(self.cursor.x() * self.picture.width // 1), int(self.cursor.y() * self.picture.width // 1)
        return (x, y) if 0 <= x < self.picture.width and 0 <= y < self.picture.height else None

    def step(self, columns: int, rows: int) -> None:
        """Move the cursor by whole pixels, from the middle if it is nowhere; what it leaves is followed."""
        width, height = self.picture.width, self.picture.height
        at = self.pixel() or (int(self.centre.x() * width), int(self.centre.y() * width))
        x = min(max(at[0] + columns, 0), width - 1)
        y = min(max(at[1] + rows, 0), height - 1)
        self.point(QPointF((x + 0.5) / width, (y + 0.5) / width))
        rooms = [room for looker in self._lookers if (room := looker.room()) is not None]
        if rooms and self.cursor is not None:
            away = (self.cursor - self.centre) * self.span
            reach = QPointF(min(r.width() for r in rooms) / 2 - 12, min(r.height() for r in rooms) / 2 - 12)
            beyond = QPointF(
                away.x() - min(max(away.x(), -reach.x()), reach.x()),
                away.y() - min(max(away.y(), -reach.y()), reach.y()),
            )
            if not beyond.isNull():
                self.pan(-beyond)

    def _keep(self) -> None:
        """The middle of the view stays on the picture."""
        high = self.picture.height / self.picture.width
        self.centre = QPointF(min(max(self.centre.x(), 0.0), 1.0), min(max(self.centre.y(), 0.0), high))


def _rect(width: int, box: tuple[int, int, int, int] | None) -> QRectF | None:
    """A box of pixels (left, top, right, bottom) in picture widths."""
    if box is None:
        return None
    left, top, right, bottom = (value / width for value in box)
    return QRectF(left, top, right - left, bottom - top)
