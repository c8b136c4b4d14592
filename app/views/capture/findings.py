"""What the checks found while a capture goes on, newest first, each with what to do about it."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QPoint, QRect, QSize, Qt
from PySide6.QtGui import QAction, QGuiApplication, QKeySequence, QPainter
from PySide6.QtWidgets import (
    QAbstractItemView,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QWidget,
)

from app.state import trouble
from app.views import icons, theme

ICON_PX, GAP = 16, 5
SEVERITY = Qt.ItemDataRole.UserRole


@dataclass(frozen=True, slots=True)
class Told:
    """One line of the list."""

    pose: str
    text: str  # "seen; remedy"
    severity: str  # "stop", "warn" or "note"


class Findings(QListWidget):
    """Shows them; Ctrl+C copies the chosen one."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._told: tuple[Told, ...] = ()
        self.setAccessibleName(self.tr("Warnings of the checks"))
        self.setObjectName("plain")
        self.setItemDelegate(_Card(self))
        self.setVerticalScrollBarPolicy(
            Qt.ScrollBarPolicy.ScrollBarAlwaysOn
        )  # widths stay as they were measured
        self.setResizeMode(QListWidget.ResizeMode.Adjust)  # words wrap anew
        self.setVerticalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        copy = QAction(self.tr("Copy this warning"), self)
        copy.setShortcut(QKeySequence.StandardKey.Copy)
        copy.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        copy.triggered.connect(self._copy)
        self.addAction(copy)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)

    def show_findings(self, findings: Sequence[Told]) -> None:
        """All there are, oldest first; what is shown already is not shown anew."""
        findings = tuple(findings)
        if findings[: len(self._told)] != self._told:
            self.clear()
            self._told = ()
        for told in findings[len(self._told) :]:
            self.insertItem(0, self._item(told))
        self._told = findings

    def _item(self, told: Told) -> QListWidgetItem:
        parts = trouble(told.text)
        what = f"{told.pose}: {parts.what}" if told.pose else parts.what[:1].upper() + parts.what[1:]
        remedy = parts.remedy[:1].upper() + parts.remedy[1:]
        item = QListWidgetItem("\n".join(part for part in (what, remedy) if part))
        item.setData(SEVERITY, told.severity)
        urgency = {"stop": self.tr("Stop"), "warn": self.tr("Warning")}.get(told.severity, self.tr("Note"))
        item.setData(Qt.ItemDataRole.AccessibleTextRole, f"{urgency}: {what}. {remedy}")
        return item

    def _copy(self) -> None:
        item = self.currentItem()
        if item is not None:
            QGuiApplication.clipboard().setText(item.text())


class _Card(QStyledItemDelegate):
    """A sign, what was seen, and below it in the second colour what to do, every word of both."""

    def _boxes(self, option: theme.StyleOption, text: str) -> tuple[QRect, QRect, str, str]:
        what, _, remedy = text.partition("\n")
        list_ = self.parent()
        assert isinstance(list_, QListWidget)
        width = list_.viewport().width() - 2 * list_.spacing() - ICON_PX - 3 * GAP
        room, flags = QRect(0, 0, max(width, 40), 10_000), Qt.TextFlag.TextWordWrap
        above = option.fontMetrics.boundingRect(room, flags, what)
        below = option.fontMetrics.boundingRect(room, flags, remedy) if remedy else QRect()
        upper = QRect(0, 0, room.width(), above.height())
        return upper, QRect(0, above.height(), room.width(), below.height()), what, remedy

    def sizeHint(self, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex) -> QSize:
        upper, lower, _, _ = self._boxes(option, index.data())
        return QSize(upper.width() + ICON_PX + 3 * GAP, upper.height() + lower.height() + 2 * GAP)

    def paint(
        self, painter: QPainter, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        ours = theme.colours(option.widget)
        upper, lower, what, remedy = self._boxes(option, index.data())
        severity = index.data(SEVERITY)
        painter.save()
        if option.state & QStyle.StateFlag.State_Selected:
            painter.fillRect(option.rect, theme.colour(ours.accent, 0.18))
        ink = {"stop": ours.bad, "warn": ours.warn}.get(severity, ours.dim)
        sign = icons.pixmap(
            "note" if severity == "note" else "warning", ink, ICON_PX, painter.device().devicePixelRatioF()
        )
        corner = option.rect.topLeft() + QPoint(GAP, GAP)
        painter.drawPixmap(corner, sign)
        corner += QPoint(ICON_PX + GAP, 0)
        for box, text, ink in ((upper, what, ours.text), (lower, remedy, ours.dim)):
            painter.setPen(theme.colour(ink))
            painter.drawText(box.translated(corner), Qt.TextFlag.TextWordWrap, text)
        painter.restore()
