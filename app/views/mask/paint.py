"""Paints what lies over the photograph on the mask page: the object found, strokes, an open polygon, the brush.

Places are logical pixels of the widget; `corner` is where the picture's top left corner lies, `scale` how many of
them a pixel of the picture takes.
"""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, QSizeF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPen, QPolygonF

from app.masking import ADD, EXACT, TAKE, Place
from app.views.theme import Palette

TINT = 0.55  # opacity of the object's tint where the overlay is opaque
DARK, BRIGHT = QColor(0, 0, 0, 170), QColor(255, 255, 255, 235)


def flat(labels: np.ndarray) -> QImage:
    """An image over the memory of labels whose rows are padded to whole words; it keeps the array alive."""
    height, width = labels.shape
    memory = labels if labels.base is None else labels.base
    image = QImage(memory.data, width, height, labels.strides[0], QImage.Format.Format_Indexed8)
    image.labels = labels  # pyrefly: ignore[missing-attribute] the image does not own its memory
    return image


def coloured(image: QImage, colours: dict[int, str]) -> None:
    """Give labels their colours; all others are transparent."""
    image.setColorTable([QColor(colours[i]).rgba() if i in colours else 0 for i in range(max(colours) + 1)])


def label_colours(ours: Palette) -> dict[int, str]:
    """Exact strokes are brighter."""
    inks = {ADD: ours.good, TAKE: ours.bad}
    return inks | {label + EXACT: QColor(ink).lighter(135).name() for label, ink in inks.items()}


def overlay(
    painter: QPainter, image: QImage, opacity: float, corner: QPointF, scale: float, room: QSizeF
) -> None:
    """The part that is seen of an image of the picture's size, with hard edges."""
    columns = (
        max(int(-corner.x() / scale), 0),
        min(int((room.width() - corner.x()) / scale) + 1, image.width()),
    )
    rows = (
        max(int(-corner.y() / scale), 0),
        min(int((room.height() - corner.y()) / scale) + 1, image.height()),
    )
    if columns[0] >= columns[1] or rows[0] >= rows[1]:
        return
    source = QRectF(columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0])
    target = QRectF(corner + source.topLeft() * scale, source.size() * scale)
    painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, False)
    painter.setOpacity(opacity)
    painter.drawImage(target, image, source)
    painter.setOpacity(1)


def outline(painter: QPainter, pieces: Sequence[QLineF], corner: QPointF, scale: float, colour: str) -> None:
    """The object's border, light on a dark ground so that it shows on every picture."""
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
    painter.translate(corner)
    painter.scale(scale, scale)
    for ink, wide in ((DARK, 3.0), (QColor(colour), 1.2)):
        pen = QPen(ink, wide)
        pen.setCosmetic(True)
        painter.setPen(pen)
        painter.drawLines(pieces)
    painter.restore()


def polygon(
    painter: QPainter,
    corners: Sequence[Place],
    ahead: QPointF | None,
    corner: QPointF,
    scale: float,
    colour: str,
) -> None:
    """An open polygon, and the edges that it would get if it were closed at `ahead`."""
    places = [corner + QPointF(*at) * scale for at in corners]
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, True)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for ink, wide in ((DARK, 3.5), (QColor(colour), 1.6)):
        painter.setPen(QPen(ink, wide))
        painter.drawPolyline(QPolygonF(places))
        if ahead is not None:
            painter.setPen(QPen(ink, wide - 0.6, Qt.PenStyle.DotLine))
            painter.drawPolyline(QPolygonF([places[-1], ahead, places[0]]))
    painter.setPen(QPen(DARK, 1))
    painter.setBrush(BRIGHT)
    for at in places:
        painter.drawRect(QRectF(at - QPointF(3, 3), QSizeF(6, 6)))


def brush(painter: QPainter, at: QPointF, across: float, colour: str) -> None:
    """The ring of a brush `across` logical pixels wide, with a cross in its middle where it is small."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, True)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for ink, wide in ((DARK, 3), (QColor(colour), 1.4)):
        painter.setPen(QPen(ink, wide))
        painter.drawEllipse(at, across / 2, across / 2)
        if across < 8:
            for way in (QPointF(1, 0), QPointF(-1, 0), QPointF(0, 1), QPointF(0, -1)):
                painter.drawLine(at + way * 7, at + way * 13)
