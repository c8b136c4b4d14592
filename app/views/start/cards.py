"""A recent session as a card: its picture, its name, its state."""

from pathlib import Path

from PySide6.QtCore import QCoreApplication, QModelIndex, QPersistentModelIndex, QRect, QSize, Qt
from PySide6.QtGui import QFontMetrics, QImage, QPainter, QPainterPath
from PySide6.QtWidgets import QListWidget, QStyle, QStyledItemDelegate

from app.parameters import STAGES
from app.recent import Glance
from app.views import icons, theme
from app.views.process.stages import title

PICTURE = QSize(208, 136)
CELL = QSize(224, 192)
GLANCE, PHOTO = Qt.ItemDataRole.UserRole, Qt.ItemDataRole.UserRole + 1


def told_state(glance: Glance) -> str:
    """A session's state in a few words."""
    translate = QCoreApplication.translate
    if not glance.there:
        return translate("StartPage", "not there now")
    if glance.capture_unfinished:
        return translate("StartPage", "capture: {0} of {1} poses").format(glance.views, glance.planned)
    views = (
        translate("StartPage", "1 view")
        if glance.views == 1
        else translate("StartPage", "{0} views").format(glance.views)
    )
    if not glance.finished:
        return translate("StartPage", "{0}, not processed").format(views)
    if "export" in glance.finished:
        return translate("StartPage", "{0}, processed").format(views)
    done, left = glance.finished[-1], len(STAGES) - len(glance.finished)
    return translate("StartPage", "{0}, {1} done, {2} stages left").format(views, title(done), left)


def picture(path: Path | None) -> QImage | None:
    """The file, cut to the card; may run in any thread."""
    image = QImage(str(path)) if path is not None else QImage()
    if image.isNull():
        return None
    size = PICTURE * 2
    scaled = image.scaled(
        size, Qt.AspectRatioMode.KeepAspectRatioByExpanding, Qt.TransformationMode.SmoothTransformation
    )
    corner = QRect(0, 0, size.width(), size.height())
    corner.moveCenter(scaled.rect().center())
    return scaled.copy(corner)


class SessionCard(QStyledItemDelegate):
    """Picture, name, state."""

    def sizeHint(self, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return CELL

    def paint(
        self, painter: QPainter, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        glance, photo = index.data(GLANCE), index.data(PHOTO)
        widget = self.parent()
        assert isinstance(widget, QListWidget)
        ours = theme.colours(widget)
        painter.save()
        painter.setRenderHints(QPainter.RenderHint.Antialiasing | QPainter.RenderHint.SmoothPixmapTransform)
        card = option.rect.adjusted(1, 1, -1, -1)
        outline = QPainterPath()
        outline.addRoundedRect(card, 6, 6)
        painter.fillPath(outline, theme.colour(ours.panel))
        frame = QRect(card.left() + 7, card.top() + 7, PICTURE.width(), PICTURE.height())
        inner = QPainterPath()
        inner.addRoundedRect(frame, 4, 4)
        painter.fillPath(inner, theme.colour(ours.picture))
        painter.setClipPath(inner)
        if photo is not None:
            painter.drawPixmap(frame, photo)
        else:
            sign = icons.pixmap("maps", ours.disabled, 40, widget.devicePixelRatioF())
            painter.drawPixmap(frame.center().x() - 20, frame.center().y() - 20, sign)
        if not glance.there:
            painter.fillRect(frame, theme.colour(ours.picture, 0.6))
        painter.setClipping(False)
        self._words(painter, frame, glance, ours, option)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        hovered = bool(option.state & QStyle.StateFlag.State_MouseOver)
        painter.setPen(
            theme.pen(ours.accent if chosen else ours.dim if hovered else ours.line, 2 if chosen else 1)
        )
        painter.drawPath(outline)
        painter.restore()

    def _words(
        self, painter: QPainter, frame: QRect, glance: Glance, ours: theme.Palette,
        option: theme.StyleOption,
    ) -> None:  # fmt: skip
        font = option.font
        font.setBold(True)
        painter.setFont(font)
        metrics = QFontMetrics(font)
        line = QRect(frame.left() + 2, frame.bottom() + 8, frame.width() - 4, metrics.height())
        painter.setPen(theme.colour(ours.text))
        name = metrics.elidedText(glance.name, Qt.TextElideMode.ElideMiddle, line.width())
        painter.drawText(line, Qt.AlignmentFlag.AlignLeft, name)
        font.setBold(False)
        painter.setFont(font)
        metrics = QFontMetrics(font)
        line.translate(0, metrics.height() + 2)
        unfinished = glance.capture_unfinished or not glance.there
        painter.setPen(theme.colour(ours.warn if unfinished else ours.dim))
        state = metrics.elidedText(told_state(glance), Qt.TextElideMode.ElideRight, line.width())
        painter.drawText(line, Qt.AlignmentFlag.AlignLeft, state)
