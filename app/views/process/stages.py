"""The stages as a column: state, reason to run, progress and time left of each; one of them is chosen."""

from PySide6.QtCore import QCoreApplication, QModelIndex, QPersistentModelIndex, QRect, QSize, Qt, Signal
from PySide6.QtGui import QFontMetrics, QPainter, QPainterPath
from PySide6.QtWidgets import (
    QFrame,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QWidget,
)

from app.parameters import STAGES
from app.plan import told_reason, told_seconds
from app.processing import Card, CardState
from app.views import icons, theme

CARD = Qt.ItemDataRole.UserRole
HEIGHT = 72


class StageColumn(QListWidget):
    """One card a stage; `chosen` tells the stage's name."""

    chosen = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(self.tr("Stages"))
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setSpacing(3)
        self.setVerticalScrollMode(QListWidget.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.viewport().setAutoFillBackground(False)
        self.setItemDelegate(_Painter(self))
        self.currentItemChanged.connect(self._tell)

    def show_cards(self, cards: tuple[Card, ...]) -> None:
        """Show these; what was chosen stays chosen."""
        if [card.name for card in cards] != [self.card(row).name for row in range(self.count())]:
            self.clear()
            for card in cards:
                item = QListWidgetItem()
                item.setSizeHint(QSize(100, HEIGHT))
                item.setData(CARD, card)
                self.addItem(item)
        for row, card in enumerate(cards):
            item = self.item(row)
            item.setData(CARD, card)
            item.setData(Qt.ItemDataRole.AccessibleTextRole, f"{title(card.name)}: {told(card)}")
            item.setToolTip(tooltip(card))
        if self.currentRow() < 0 and cards:
            first = next((row for row, card in enumerate(cards) if card.state is not CardState.DONE), 0)
            self.setCurrentRow(first)

    def card(self, row: int) -> Card:
        return self.item(row).data(CARD)

    def choose(self, name: str) -> None:
        for row in range(self.count()):
            if self.card(row).name == name:
                self.setCurrentRow(row)

    def _tell(self, item: QListWidgetItem | None) -> None:
        if item is not None:
            self.chosen.emit(item.data(CARD).name)


def title(stage: str) -> str:
    """The stage in words."""
    return QCoreApplication.translate("parameters", STAGES.get(stage, (stage, ""))[0])


def about(stage: str) -> str:
    """What it does."""
    return QCoreApplication.translate("parameters", STAGES.get(stage, ("", ""))[1])


def told(card: Card) -> str:
    """A card's state in a line."""
    translate = QCoreApplication.translate
    if card.state is CardState.FAILED:
        return translate("StageColumn", "Failed: {0}").format(card.message)
    if card.state is CardState.CANCELLING:
        return translate("StageColumn", "Stopping…")
    if card.state is CardState.RUNNING:
        left = (
            translate("StageColumn", "{0} left").format(told_seconds(card.eta_s))
            if card.eta_s is not None
            else ""
        )
        return "   ".join(part for part in (f"{100 * card.fraction:.0f} %", left, card.note) if part)
    if card.state is CardState.DONE:
        if card.given:
            return translate("StageColumn", "Done, as given")
        took = translate("StageColumn", "Done in {0}").format(told_seconds(card.took_s or 0.0))
        return took if card.took_s is not None else translate("StageColumn", "Done")
    if card.reasons == ("never ran",):
        if card.given:
            return translate("StageColumn", "Uses what you gave")
        return translate("StageColumn", "Has not run yet")
    reasons = ", ".join(told_reason(reason, card.name) for reason in card.reasons)
    return translate("StageColumn", "Will run: {0}").format(reasons)


def tooltip(card: Card) -> str:
    return f"{card.name}: {about(card.name)}\n{told(card)}"


class _Painter(QStyledItemDelegate):
    """Paints a card."""

    def sizeHint(self, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(100, HEIGHT)

    def paint(
        self, painter: QPainter, option: theme.StyleOption, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        card: Card = index.data(CARD)
        column = self.parent()
        assert isinstance(column, StageColumn)
        ours = theme.colours(column)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        frame = option.rect.adjusted(1, 1, -1, -1)
        outline = QPainterPath()
        outline.addRoundedRect(frame, 6, 6)
        painter.fillPath(outline, theme.colour(ours.panel))
        focused = chosen and column.hasFocus()
        painter.setPen(
            theme.pen(ours.focus, 2) if focused else theme.pen(ours.accent if chosen else ours.line)
        )
        painter.drawPath(outline)
        sign, colour = {
            CardState.DONE: ("done", ours.good),
            CardState.STALE: ("stale", ours.warn if card.reasons != ("never ran",) else ours.dim),
            CardState.RUNNING: ("running", ours.accent),
            CardState.CANCELLING: ("running", ours.warn),
            CardState.FAILED: ("failed", ours.bad),
        }[card.state]
        painter.drawPixmap(
            frame.left() + 10, frame.top() + 10, icons.pixmap(sign, colour, 20, column.devicePixelRatioF())
        )
        self._words(painter, frame, card, ours, option)
        if card.state in (CardState.RUNNING, CardState.CANCELLING):
            self._bar(painter, frame, card, ours)
        painter.restore()

    def _words(
        self, painter: QPainter, frame: QRect, card: Card, ours: theme.Palette, option: theme.StyleOption
    ) -> None:
        font = option.font
        font.setBold(True)
        painter.setFont(font)
        line = QRect(frame.left() + 40, frame.top() + 9, frame.width() - 50, QFontMetrics(font).height())
        painter.setPen(theme.colour(ours.text))
        painter.drawText(line, Qt.AlignmentFlag.AlignLeft, title(card.name))
        font.setBold(False)
        painter.setFont(font)
        metrics = QFontMetrics(font)
        if card.state is CardState.DONE:
            colour = ours.dim
        else:
            colour = {CardState.FAILED: ours.bad, CardState.STALE: ours.dim}.get(card.state, ours.text)
            if card.state is CardState.STALE and card.reasons != ("never ran",):
                colour = ours.warn
        painter.setPen(theme.colour(colour))
        lines = 1 if card.state in (CardState.RUNNING, CardState.CANCELLING) else 2
        room = QRect(line.left(), line.bottom() + 4, line.width(), lines * metrics.lineSpacing() + 2)
        painter.drawText(
            room, Qt.AlignmentFlag.AlignLeft | Qt.TextFlag.TextWordWrap,
            _fitted(told(card), metrics, room.width(), lines),
        )  # fmt: skip

    def _bar(self, painter: QPainter, frame: QRect, card: Card, ours: theme.Palette) -> None:
        track = QRect(frame.left() + 40, frame.bottom() - 14, frame.width() - 52, 5)
        for width, colour in (
            (track.width(), ours.field),
            (round(track.width() * card.fraction), ours.accent),
        ):
            bar = QPainterPath()
            bar.addRoundedRect(QRect(track.left(), track.top(), width, track.height()), 2.5, 2.5)
            painter.fillPath(bar, theme.colour(colour))


def _fitted(text: str, metrics: QFontMetrics, width: int, lines: int) -> str:
    """The text, cut so that it wraps to so many lines at most."""
    flags = int(Qt.TextFlag.TextWordWrap)
    most = lines * metrics.lineSpacing() + 2
    if metrics.boundingRect(QRect(0, 0, width, 10000), flags, text).height() <= most:
        return text
    short = text
    while short and metrics.boundingRect(QRect(0, 0, width, 10000), flags, short + "…").height() > most:
        short = short[:-1]
    return short.rstrip(" ,") + "…"
