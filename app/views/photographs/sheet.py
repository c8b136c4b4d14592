"""The contact sheet: every photograph small, with what matters of it, and a mark on those that are left out."""

from PySide6.QtCore import (
    QCoreApplication,
    QModelIndex,
    QPersistentModelIndex,
    QRect,
    QSize,
    QSizeF,
    Qt,
    Signal,
)
from PySide6.QtGui import QImage, QMouseEvent, QPainter, QPainterPath, QPixmap
from PySide6.QtWidgets import (
    QAbstractItemView,
    QFrame,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QWidget,
)

from app.photographs import Look, Photograph, told_blur
from app.views import icons, theme

PICTURE = QSize(118, 84)
CELL = QSize(130, 132)
MARK_PX = 20
PHOTOGRAPH, LOOK, PIXMAP, OUT = (Qt.ItemDataRole.UserRole + number for number in range(4))


def shrunk(image: QImage) -> QImage:
    """A picture at the size of the sheet, for a screen of twice the pixels; may run in any thread."""
    ratio, smooth = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
    return image if image.isNull() else image.scaled(PICTURE * 2, ratio, smooth)


def told_look(look: Look) -> str:
    """Sharpness and clipping in a few words."""
    translate = QCoreApplication.translate
    told = f"{100 * look.clipped:.1f}"
    clipped = translate("ContactSheet", "{0} % clipped").format(told) if float(told) else ""
    return "  ".join(part for part in (told_blur(look), clipped) if part)


class ContactSheet(QListWidget):
    """Small pictures; `marked` tells a photograph whose mark was clicked."""

    marked = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(self.tr("Photographs"))
        self.setViewMode(QListWidget.ViewMode.IconMode)
        self.setResizeMode(QListWidget.ResizeMode.Adjust)
        self.setMovement(QListWidget.Movement.Static)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setUniformItemSizes(True)
        self.setVerticalScrollMode(QListWidget.ScrollMode.ScrollPerPixel)
        self.setItemDelegate(_Painter(self))
        self.viewport().setAutoFillBackground(False)
        self.setMouseTracking(True)

    def fill(self, photographs: tuple[Photograph, ...]) -> None:
        """Show these in this order; what was seen of them, and what was chosen, stays."""
        before = [self.item(row) for row in range(self.count())]
        seen = {item.data(PHOTOGRAPH).kept: (item.data(LOOK), item.data(PIXMAP)) for item in before}
        current = self.currentItem()
        name = "" if current is None else current.data(PHOTOGRAPH).name
        self.clear()
        for photograph in photographs:
            item = QListWidgetItem()
            item.setSizeHint(CELL)
            item.setData(PHOTOGRAPH, photograph)
            look, pixmap = seen.get(photograph.kept, (None, None))
            item.setData(LOOK, look)
            item.setData(PIXMAP, pixmap)
            item.setData(OUT, False)
            self.addItem(item)
        row = next((row for row, shown in enumerate(photographs) if shown.name == name), 0)
        self.setCurrentRow(row if photographs else -1)

    def photograph(self, row: int) -> Photograph:
        return self.item(row).data(PHOTOGRAPH)

    def chosen(self) -> tuple[Photograph, ...]:
        """The photographs that are selected."""
        return tuple(item.data(PHOTOGRAPH) for item in self.selectedItems())

    def item_of(self, photograph: Photograph) -> QListWidgetItem | None:
        for row in range(self.count()):
            if self.photograph(row) == photograph:
                return self.item(row)
        return None

    def show_left_out(self, names: frozenset[str]) -> None:
        for row in range(self.count()):
            self.item(row).setData(OUT, self.photograph(row).name in names)
            self._describe(self.item(row))

    def show_look(self, photograph: Photograph, look: Look, image: QImage) -> None:
        item = self.item_of(photograph)
        if item is not None:
            item.setData(LOOK, look)
            item.setData(PIXMAP, QPixmap.fromImage(image))
            self._describe(item)

    def _describe(self, item: QListWidgetItem) -> None:
        photograph: Photograph = item.data(PHOTOGRAPH)
        look = item.data(LOOK)
        told = [photograph.name, "" if look is None else told_look(look)]
        told += [self.tr("no pose")] if photograph.placed is False and not item.data(OUT) else []
        told += [self.tr("left out")] if item.data(OUT) else []
        item.setData(Qt.ItemDataRole.AccessibleTextRole, ", ".join(part for part in told if part))
        item.setToolTip("\n".join(part for part in told if part))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        item = self.itemAt(event.position().toPoint())
        if item is not None and mark(self.visualItemRect(item)).contains(event.position().toPoint()):
            self.marked.emit(item.data(PHOTOGRAPH).name)
            return
        super().mousePressEvent(event)


def mark(cell: QRect) -> QRect:
    """Where the mark lies that a click turns."""
    return QRect(cell.right() - MARK_PX - 8, cell.top() + 8, MARK_PX, MARK_PX)


class _Painter(QStyledItemDelegate):
    """Paints a cell."""

    def sizeHint(self, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return CELL

    def paint(
        self, painter: QPainter, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        sheet = self.parent()
        assert isinstance(sheet, ContactSheet)
        ours, out = theme.colours(sheet), bool(index.data(OUT))
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        hovered = bool(option.state & QStyle.StateFlag.State_MouseOver)
        painter.save()
        painter.setRenderHints(QPainter.RenderHint.Antialiasing | QPainter.RenderHint.SmoothPixmapTransform)
        card = option.rect.adjusted(2, 2, -2, -2)
        outline = QPainterPath()
        outline.addRoundedRect(card, 5, 5)
        painter.fillPath(outline, theme.colour(ours.panel if not chosen else ours.field))
        frame = QRect(card.left() + 4, card.top() + 4, PICTURE.width(), PICTURE.height())
        painter.fillRect(frame, theme.colour(ours.picture))
        pixmap: QPixmap | None = index.data(PIXMAP)
        if pixmap is not None:
            size = QSizeF(pixmap.size()).scaled(QSizeF(PICTURE), Qt.AspectRatioMode.KeepAspectRatio).toSize()
            target = QRect(frame.topLeft(), size)
            target.moveCenter(frame.center())
            painter.setOpacity(0.3 if out else 1.0)
            painter.drawPixmap(target, pixmap)
            painter.setOpacity(1.0)
        if out or hovered:
            self._mark(painter, mark(option.rect), ours, out, sheet.devicePixelRatioF())
        self._words(painter, frame, index, ours, option)
        focused = sheet.hasFocus() and sheet.currentIndex() == index
        painter.setPen(theme.pen(ours.accent, 2) if chosen else theme.pen(ours.line))
        painter.setPen(theme.pen(ours.focus, 2) if focused else painter.pen())
        painter.drawPath(outline)
        painter.restore()

    def _mark(self, painter: QPainter, place: QRect, ours: theme.Palette, out: bool, ratio: float) -> None:
        ground = QPainterPath()
        ground.addRoundedRect(place, 4, 4)
        painter.fillPath(ground, theme.colour(ours.panel, 0.9))
        sign = icons.pixmap("failed" if out else "done", ours.bad if out else ours.good, 14, ratio)
        painter.drawPixmap(place.left() + 3, place.top() + 3, sign)

    def _words(
        self,
        painter: QPainter,
        frame: QRect,
        index: QModelIndex | QPersistentModelIndex,
        ours: theme.Palette,
        option: theme.StyleOption,
    ) -> None:
        photograph: Photograph = index.data(PHOTOGRAPH)
        look: Look | None = index.data(LOOK)
        translate, metrics = QCoreApplication.translate, option.fontMetrics
        line = QRect(frame.left(), frame.bottom() + 3, frame.width(), metrics.height())
        if index.data(OUT):
            second, colour = translate("ContactSheet", "left out"), ours.bad
        elif photograph.placed is False:
            second, colour = translate("ContactSheet", "no pose"), ours.warn
        else:
            second, colour = "" if look is None else told_look(look), ours.dim
        for text, shade in ((f"{photograph.number}  {photograph.name}", ours.text), (second, colour)):
            painter.setPen(theme.colour(ours.dim if index.data(OUT) and shade == ours.text else shade))
            painter.drawText(
                line,
                Qt.AlignmentFlag.AlignLeft,
                metrics.elidedText(text, Qt.TextElideMode.ElideRight, line.width()),
            )
            line.translate(0, metrics.height())
