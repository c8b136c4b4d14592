"""Paints what an image view shows: the picture at a fitting size, the grid and values of its pixels, cursor, swipe.

Places are logical pixels of the widget; `corner` is where the picture's top left corner lies.
"""

from collections.abc import Callable, Sequence

from PySide6.QtCore import QPointF, QRectF, QSizeF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPen

from app.views.theme import Palette

CRISP = 3.0  # device pixels per pixel from which on pixels are drawn as squares
WRITTEN = 48.0  # logical pixels of the screen per pixel from which on values stand in them


def picture(
    painter: QPainter, images: list[QImage], corner: QPointF, span: float, ratio: float, room: QSizeF
) -> None:
    """The level that is nearest to the screen's resolution, and of it only what is seen.

    Args:
        span: logical pixels that the picture's width takes.
        ratio: device pixels per logical pixel.
    """
    scale = span / images[0].width() * ratio
    level = 0
    while level + 1 < len(images) and scale * 2**level < 0.5:
        level += 1
    image = images[level]
    target = QRectF(corner, QSizeF(span, span * images[0].height() / images[0].width()))
    visible = target.intersected(QRectF(QPointF(0, 0), room))
    if visible.isEmpty():
        return
    fx, fy = image.width() / target.width(), image.height() / target.height()
    # Whole pixels of the source, else the edges of a magnified picture crawl while panning.
    left, top = int((visible.left() - target.left()) * fx), int((visible.top() - target.top()) * fy)
    right = min(int((visible.right() - target.left()) * fx) + 1, image.width())
    bottom = min(int((visible.bottom() - target.top()) * fy) + 1, image.height())
    source = QRectF(left, top, right - left, bottom - top)
    part = QRectF(
        target.left() + left / fx, target.top() + top / fy, source.width() / fx, source.height() / fy
    )
    painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, scale < CRISP)
    painter.drawImage(part, image, source)


def grid(
    painter: QPainter,
    corner: QPointF,
    scale: float,
    size: tuple[int, int],
    room: QSizeF,
    image: QImage,
    text_of: Callable[[int, int], str] | None,
) -> None:
    """Lines between the pixels that are seen, and from WRITTEN on their values.

    Args:
        scale: logical pixels per pixel.
        size: columns and rows of the picture.
    """
    x0, x1 = max(int(-corner.x() / scale), 0), min(int((room.width() - corner.x()) / scale) + 1, size[0])
    y0, y1 = max(int(-corner.y() / scale), 0), min(int((room.height() - corner.y()) / scale) + 1, size[1])
    painter.setPen(QPen(QColor(128, 128, 128, min(int(8 * scale), 110)), 0))
    for x in range(x0, x1 + 1):
        at = corner.x() + x * scale
        painter.drawLine(QPointF(at, corner.y() + y0 * scale), QPointF(at, corner.y() + y1 * scale))
    for y in range(y0, y1 + 1):
        at = corner.y() + y * scale
        painter.drawLine(QPointF(corner.x() + x0 * scale, at), QPointF(corner.x() + x1 * scale, at))
    if scale < WRITTEN or text_of is None:
        return
    font = painter.font()
    font.setPixelSize(11)
    painter.setFont(font)
    for y in range(y0, y1):
        for x in range(x0, x1):
            text = text_of(x, y)
            if text:
                box = QRectF(corner.x() + x * scale, corner.y() + y * scale, scale, scale)
                below = image.pixelColor(x, y) if x < image.width() and y < image.height() else QColor()
                painter.setPen(QColor("#000000" if below.lightness() > 128 else "#ffffff"))
                painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)


def cursor(painter: QPainter, corner: QPointF, scale: float, pixel: tuple[int, int]) -> None:
    """A frame around a pixel, never smaller than can be seen; black and white together show on every picture."""
    reach = max((9 - scale) / 2, 0)
    at = corner + QPointF(pixel[0] * scale, pixel[1] * scale)
    box = QRectF(at, QSizeF(scale, scale)).adjusted(-reach, -reach, reach, reach)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
    painter.setPen(QPen(QColor(0, 0, 0, 200), 3))
    painter.drawRect(box)
    painter.setPen(QPen(QColor(255, 255, 255, 230), 1))
    painter.drawRect(box)


def marks(painter: QPainter, places: Sequence[QPointF]) -> None:
    """A cross at each place and a line between two; black and white together show on every picture."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, True)
    for colour, wide in ((QColor(0, 0, 0, 170), 3.5), (QColor(255, 255, 255), 1.5)):
        painter.setPen(QPen(colour, wide))
        painter.drawPolyline(places)
        for at in places:
            for across in (QPointF(6, 6), QPointF(6, -6)):
                painter.drawLine(at - across, at + across)


def swipe(painter: QPainter, edge: float, room: QSizeF, ours: Palette, labels: tuple[str, str]) -> None:
    """The swipe's edge with its grip, and what lies on either side."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing, True)
    for colour, wide in ((QColor(0, 0, 0, 150), 3), (QColor(255, 255, 255, 230), 1)):
        painter.setPen(QPen(colour, wide))
        painter.drawLine(QPointF(edge, 0), QPointF(edge, room.height()))
    middle = QPointF(edge, room.height() / 2)
    painter.setBrush(QColor(ours.accent))
    painter.setPen(QPen(QColor(255, 255, 255, 230), 1.5))
    painter.drawEllipse(middle, 13, 13)
    painter.setPen(QPen(QColor(ours.on_accent), 2, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
    for side in (-1, 1):
        tip = middle + QPointF(side * 7.5, 0)
        painter.drawLine(tip, tip + QPointF(-side * 4, -4))
        painter.drawLine(tip, tip + QPointF(-side * 4, 4))
    font = painter.font()
    font.setPixelSize(12)
    painter.setFont(font)
    for text, right in zip(labels, (False, True), strict=True):
        wide = painter.fontMetrics().horizontalAdvance(text) + 16
        left = edge + 8 if right else edge - 8 - wide
        if text and left >= 0 and left + wide <= room.width():
            box = QRectF(left, 8, wide, 22)
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(QColor(0, 0, 0, 150))
            painter.drawRoundedRect(box, 4, 4)
            painter.setPen(QColor(255, 255, 255))
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)
