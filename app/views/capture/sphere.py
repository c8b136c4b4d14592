"""The poses of a capture on a sphere: each dot is where the camera looks, seen from outside.

Pan goes round, tilt up and down, degrees as the rig counts them; pan 0, tilt 0 is in the middle at first. Drag or
arrow keys turn the sphere, Home turns it back.
"""

import math
from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QBrush, QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.capture.dots import Dot
from app.views import theme

KEY_STEP_DEG = 10.0
FIRST_LOOK = (0.0, 20.0)  # degrees: turned about the vertical, looked at from above
MARGIN = 9
GRID_DEG = 30
FAR_OPACITY = 0.6


class Sphere(QWidget):
    """Shows dots; turns itself, tells nothing."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.dots: tuple[Dot, ...] = ()
        self.message = ""  # in place of dots
        self.turn_deg, self.rise_deg = FIRST_LOOK
        self._here: tuple[float, float] | None = None
        self._held: QPointF | None = None
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(120, 120)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName(self.tr("Poses on a sphere"))
        self.setToolTip(
            self.tr(
                "Where the camera looks in each pose. Filled: taken; ring: under way; cross: missing; outline: to come."
                " Drag or arrow keys turn it, Home turns it back"
            )
        )

    def sizeHint(self) -> QSize:
        return QSize(190, 190)

    def show_dots(self, dots: Sequence[Dot], message: str = "") -> None:
        """Show poses; `message` where there are none."""
        dots = tuple(dots)
        if dots == self.dots and message == self.message:
            return
        self.dots, self.message = dots, message
        count = {state: sum(dot.state == state for dot in dots) for state in ("done", "missing")}
        told = self.tr("{0} poses, {1} taken, {2} missing").format(len(dots), count["done"], count["missing"])
        self.setAccessibleDescription(told if dots else message)
        self.update()

    def show_here(self, pan_deg: float | None, tilt_deg: float | None) -> None:
        """Where the rig stands now; None where nobody knows."""
        here = None if pan_deg is None else (pan_deg, tilt_deg or 0.0)
        if here != self._here:
            self._here = here
            self.update()

    def turn_by(self, turn_deg: float, rise_deg: float) -> None:
        """Round and round, but not over the top."""
        self.turn_deg = (self.turn_deg + turn_deg + 180.0) % 360.0 - 180.0
        self.rise_deg = min(max(self.rise_deg + rise_deg, -90.0), 90.0)
        self.update()

    def place(self, pan_deg: float, tilt_deg: float) -> tuple[QPointF, bool]:
        """Where a direction is seen, and whether on the near side."""
        (spot,), (near,) = self._seen(np.array([pan_deg]), np.array([tilt_deg]))
        return QPointF(*spot), bool(near)

    # Painting

    def _seen(self, pan_deg: np.ndarray, tilt_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions in this widget's pixels [n 2], and which are on the near side [n]."""
        pan, tilt = np.radians(pan_deg - self.turn_deg), np.radians(tilt_deg)
        right, up, near = np.cos(tilt) * np.sin(pan), np.sin(tilt), np.cos(tilt) * np.cos(pan)
        cos, sin = math.cos(math.radians(self.rise_deg)), math.sin(math.radians(self.rise_deg))
        up, near = up * cos - near * sin, up * sin + near * cos
        middle, radius = self._circle()
        return np.stack([middle.x() + radius * right, middle.y() - radius * up], -1), near >= 0

    def _circle(self) -> tuple[QPointF, float]:
        radius = max(min(self.width(), self.height()) / 2 - MARGIN, 1.0)
        return QPointF(self.width() / 2, self.height() / 2), radius

    def paintEvent(self, event: QPaintEvent) -> None:
        ours = theme.colours(self)
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle, radius = self._circle()
        painter.setPen(theme.pen(ours.line))
        painter.setBrush(QColor(ours.field))
        painter.drawEllipse(middle, radius, radius)
        self._grid(painter, ours)
        for dot in sorted(self.dots, key=lambda dot: dot.state == "current"):
            spot, near = self.place(dot.pan_deg, dot.tilt_deg)
            self._dot(painter, ours, dot, spot, near)
        if self._here is not None:
            self._cross(painter, ours, *self.place(*self._here))
        if not self.dots and self.message:
            painter.setPen(QColor(ours.dim))
            box = QRectF(self.rect()).adjusted(18, 18, -18, -18)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, self.message)
        theme.ring(painter, self, ours)

    def _grid(self, painter: QPainter, ours: theme.Palette) -> None:
        round_ = np.arange(0.0, 361.0, 6.0)
        upright = np.arange(-90.0, 91.0, 6.0)
        lines = [(round_, np.full_like(round_, tilt)) for tilt in range(-60, 61, GRID_DEG)]
        lines += [(np.full_like(upright, pan), upright) for pan in range(0, 360, GRID_DEG)]
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for pan, tilt in lines:
            spots, near = self._seen(pan, tilt)
            for side, opacity in ((True, 0.9), (False, 0.25)):
                painter.setPen(theme.colour(ours.line, opacity))
                for run in _runs(near == side):
                    painter.drawPolyline(QPolygonF([QPointF(*spot) for spot in spots[run]]))

    def _dot(self, painter: QPainter, ours: theme.Palette, dot: Dot, spot: QPointF, near: bool) -> None:
        radius = 4.0 if near else 3.2
        ink = {"done": ours.good, "current": ours.accent, "missing": ours.bad, "todo": ours.dim}[dot.state]
        colour = theme.colour(ink)
        painter.setPen(theme.pen(ink, 1.3))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setOpacity(1.0 if near else FAR_OPACITY)
        if dot.state == "done":
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QBrush(colour))
            painter.drawEllipse(spot, radius, radius)
        elif dot.state == "current":
            painter.setPen(theme.pen(ink, 2.2))
            painter.drawEllipse(spot, radius + 3, radius + 3)
            painter.setBrush(QBrush(colour))
            painter.drawEllipse(spot, radius - 1.5, radius - 1.5)
        elif dot.state == "missing":
            painter.setPen(theme.pen(ink, 1.8))
            reach = QPointF(radius, radius)
            painter.drawLine(spot - reach, spot + reach)
            reach = QPointF(radius, -radius)
            painter.drawLine(spot - reach, spot + reach)
        else:
            painter.drawEllipse(spot, radius - 0.5, radius - 0.5)
        painter.setOpacity(1.0)

    def _cross(self, painter: QPainter, ours: theme.Palette, spot: QPointF, near: bool) -> None:
        painter.setOpacity(1.0 if near else 0.5)
        painter.setPen(theme.pen(ours.text, 1.2))
        # Around a dot, not over it.
        for reach in (QPointF(11, 0), QPointF(0, 11)):
            painter.drawLine(spot - reach, spot - reach / 2)
            painter.drawLine(spot + reach / 2, spot + reach)
        painter.setOpacity(1.0)

    # Turning

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._held = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._held is not None:
            moved, self._held = event.position() - self._held, event.position()
            radius = self._circle()[1]
            self.turn_by(-math.degrees(moved.x() / radius), math.degrees(moved.y() / radius))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._held = None

    def keyPressEvent(self, event: QKeyEvent) -> None:
        ways = {
            Qt.Key.Key_Left: (1, 0), Qt.Key.Key_Right: (-1, 0), Qt.Key.Key_Up: (0, 1), Qt.Key.Key_Down: (0, -1)
        }  # fmt: skip
        if event.key() in ways:
            turn, rise = ways[Qt.Key(event.key())]
            self.turn_by(KEY_STEP_DEG * turn, KEY_STEP_DEG * rise)
        elif event.key() == Qt.Key.Key_Home:
            self.turn_deg, self.rise_deg = FIRST_LOOK
            self.update()
        else:
            super().keyPressEvent(event)


def _runs(chosen: np.ndarray) -> list[slice]:
    """Stretches of at least two places in a row that are chosen."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    return [slice(begin, end) for begin, end in zip(edges[::2], edges[1::2], strict=True) if end - begin > 1]
