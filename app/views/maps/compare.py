"""Two runs side by side, their signed difference, and its numbers."""

import math

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QImage
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QFrame,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QSplitter,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from app.inspect import falsecolour
from app.inspect.comparing import Comparison, compare
from app.inspect.falsecolour import MINUS
from app.inspect.maps import LAYERS, Maps
from app.inspect.runs import changes
from app.plan import told_reason
from app.state import Trouble
from app.views.background import Background
from app.views.boxes import box_of, widened
from app.views.elided import Elided
from app.views.legend import Legend
from app.views.maps.panel import MapPanel, Showing
from app.views.pictures.view import ImageView
from app.views.pictures.viewport import Viewport
from app.views.readout import NOTHING, told
from app.words import QT_TRANSLATE_NOOP

QUANTITIES = ("normal", "albedo", "roughness", "depth", "residual", "stderr_normal")
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
COLUMNS = (
    QT_TRANSLATE_NOOP("maps", "median"), QT_TRANSLATE_NOOP("maps", "mean"), QT_TRANSLATE_NOOP("maps", "95 % below"),
    QT_TRANSLATE_NOOP("maps", "mean, signed"), QT_TRANSLATE_NOOP("maps", "expected"),
)  # fmt: skip


class MapsCompare(QWidget):
    """A, B, and B less A."""

    other_session = Signal()  # asks for a folder
    picked = Signal(int)  # number of the run to compare with, in the order they were offered

    def __init__(self, parent: QWidget | None, viewport: Viewport, background: Background) -> None:
        super().__init__(parent)
        self._background = background
        self._viewport = viewport
        self._a: Showing | None = None
        self._b: Maps | None = None
        self._comparison: Comparison | None = None

        self.with_run = box_of(self.tr("Compare with"), 28)
        self.with_run.activated.connect(self._pick)
        self.quantity = QComboBox()
        self.quantity.setAccessibleName(self.tr("Quantity"))
        for key in QUANTITIES:
            self.quantity.addItem(told(LAYERS[key].title), key)
        self.quantity.currentIndexChanged.connect(self._draw)
        self.changed = Elided()
        self.changed.setObjectName("dim")
        head = QHBoxLayout()
        head.setContentsMargins(10, 4, 10, 4)
        head.setSpacing(8)
        for text, widget in (
            (self.tr("Compare &with"), self.with_run),
            (self.tr("&Quantity"), self.quantity),
        ):
            label = QLabel(text)
            label.setBuddy(widget)
            head.addWidget(label)
            head.addWidget(widget)
        head.addWidget(self.changed, 1)

        self.first = MapPanel(self, viewport, background, QUANTITIES, "normal")
        self.second = MapPanel(self, viewport, background, QUANTITIES, "normal")
        for panel, name in ((self.first, "A"), (self.second, "B")):
            panel.picker.hide()
            panel.caption.setText(name)
            panel.head.setContentsMargins(8, 4, 8, 4)
            panel.head.setAlignment(panel.caption, Qt.AlignmentFlag.AlignLeft)
        self.difference = ImageView(self, viewport)
        self.difference.setAccessibleName(self.tr("Difference"))
        self.legend = Legend(self)
        pane = QFrame()
        pane.setObjectName("panel")
        self.title = QLabel(f"B {MINUS} A")
        self.title.setObjectName("dim")
        column = QVBoxLayout(pane)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        for widget, margins in (
            (self.title, (8, 4, 8, 4)),
            (self.difference, None),
            (self.legend, (8, 1, 8, 2)),
        ):
            row = QHBoxLayout()
            row.setContentsMargins(*(margins or (0, 0, 0, 0)))
            row.addWidget(widget)
            column.addLayout(row, 1 if widget is self.difference else 0)
        pictures = QSplitter(Qt.Orientation.Horizontal)
        pictures.setChildrenCollapsible(False)
        for widget in (self.first, self.second, pane):
            pictures.addWidget(widget)
        pictures.setSizes([1000, 1000, 1000])

        self.table = QTableWidget(len(QUANTITIES), len(COLUMNS) + 1)
        self.table.setAccessibleName(self.tr("Numbers of the difference"))
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.table.setShowGrid(False)
        self.table.setObjectName("plain")
        self.table.setTabKeyNavigation(False)  # Tab leads on
        self.table.verticalHeader().setDefaultSectionSize(22)
        header = self.table.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        for column in range(len(COLUMNS) + 1):
            item = QTableWidgetItem(f"B {MINUS} A" if column == 0 else told(COLUMNS[column - 1]))
            item.setTextAlignment(RIGHT if column else LEFT)
            self.table.setHorizontalHeaderItem(column, item)
            if column:
                self.table.setColumnWidth(column, 112)
        self.table.horizontalHeaderItem(len(COLUMNS)).setToolTip(  # pyrefly: ignore[missing-attribute]
            self.tr(
                "Share of the pixels whose difference lies within the 95 % band of both runs' standard errors together"
            )
        )
        header.setFixedHeight(24)
        self.table.setFixedHeight(22 * len(QUANTITIES) + 26)
        self.table.currentCellChanged.connect(lambda row, *_: self.quantity.setCurrentIndex(row))
        self.said = Elided()
        self.said.setObjectName("dim")
        self.said.setContentsMargins(10, 2, 10, 4)

        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(head)
        layout.addWidget(pictures, 1)
        layout.addWidget(self.table)
        layout.addWidget(self.said)

    def offer(self, names: list[str], chosen: int | None) -> None:
        """The runs to compare with, of this session and others."""
        self.with_run.blockSignals(True)
        self.with_run.clear()
        for name in names:
            self.with_run.addItem(name)
        self.with_run.addItem(self.tr("Another session…"))
        self.with_run.setCurrentIndex(-1 if chosen is None else chosen)
        self.with_run.setPlaceholderText(self.tr("choose a run"))
        self.with_run.blockSignals(False)
        widened(self.with_run)

    def show_run(self, showing: Showing | None) -> None:
        """A."""
        fresh = (None if showing is None else showing.maps) is not (None if self._a is None else self._a.maps)
        self._a = showing
        self._show_panels()
        if fresh:
            self._compare()

    def show_other(self, other: Maps | None) -> None:
        """B."""
        self._b = other
        self._show_panels()
        self._compare()

    @property
    def comparison(self) -> Comparison | None:
        return self._comparison

    def image(self) -> tuple[str, QImage | None]:
        """The difference, as it can be saved."""
        return f"difference_{self.quantity.currentData()}", self.difference.full

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self._show_panels()
        self._compare()

    def _pick(self, index: int) -> None:
        if index == self.with_run.count() - 1:
            self.other_session.emit()
        else:
            self.picked.emit(index)

    def _show_panels(self) -> None:
        key = self.quantity.currentData()
        a, b = self._a, self._b
        for panel in (self.first, self.second):
            if panel.layer != key:
                panel.set_layer(key)
        self.first.show_run(a)
        self.second.show_run(None if a is None or b is None else _as(a, b))
        if b is None:
            self.second.view.show_picture(None, message=self.tr("Choose what to compare with"))

    def _compare(self) -> None:
        a, b = self._a, self._b
        self._comparison = None
        if a is None or b is None or not self.isVisible():
            self._fill(None)
            return
        self._background.ask("compare", lambda: compare(a.maps, b), self._compared, self._failed)

    def _compared(self, found: Comparison) -> None:
        self._comparison = found
        self._fill(found)

    def _failed(self, fault: Trouble) -> None:
        self._fill(None)
        self.difference.show_picture(None, message=f"{fault.what}\n{fault.remedy}")

    def _fill(self, found: Comparison | None) -> None:
        """The numbers, and what differs."""
        for row, key in enumerate(QUANTITIES):
            summary = None if found is None else found.of(key).summary()
            title = (
                told(LAYERS[key].title) if summary is None else f"{told(summary.title)}, {told(summary.unit)}"
            )
            numbers = [NOTHING] * len(COLUMNS)
            if summary is not None:
                values = (summary.median, summary.mean, summary.most, summary.bias)
                numbers = [_number(value, signed=i == 3) for i, value in enumerate(values)]
                numbers.append(NOTHING if math.isnan(summary.expected) else f"{100 * summary.expected:.0f} %")
            for column, text in enumerate([title, *numbers]):
                item = QTableWidgetItem(text)
                if column:
                    item.setTextAlignment(RIGHT)
                self.table.setItem(row, column, item)
        self.table.setCurrentCell(self.quantity.currentIndex(), 0)
        a, b = self._a, self._b
        if found is None or a is None or b is None:
            self.said.setText(
                self.tr("Choose another run of this session, or another session, to compare with.")
            )
            self.changed.clear()
        else:
            asked = [told_reason(change) for change in changes(a.maps.run, b.run)]
            self.changed.setText(" · ".join(asked) if asked else self.tr("asked for the same"))
            factor = (
                ""
                if math.isnan(found.depth_factor)
                else self.tr(" · depth of A scaled by {factor:.4f} to match").format(
                    factor=found.depth_factor
                )
            )
            self.said.setText(
                self.tr("{both} pixels in both, {share:.1f} % of all").format(
                    both=f"{found.both:,}".replace(",", "\u202f"), share=100 * found.iou
                )
                + factor
            )
        self._draw()

    def _draw(self) -> None:
        key = self.quantity.currentData()
        self.table.setCurrentCell(self.quantity.currentIndex(), 0)
        self._show_panels()
        found = self._comparison
        if found is None:
            self.difference.show_picture(None)
            self.legend.show_scale(None)
            return
        difference = found.of(key)

        def drawn():
            scale = difference.scale()
            known = np.isfinite(difference.values)
            return falsecolour.halves(falsecolour.scalar(difference.values, known, scale)), scale

        def show(made) -> None:
            self.difference.show_picture(made[0])
            self.legend.show_scale(made[1])

        self.title.setText(
            told(QT_TRANSLATE_NOOP("maps", "Angle between A and B")) if key == "normal" else f"B {MINUS} A"
        )
        self._background.ask("difference", drawn, show)


def _as(showing: Showing, other: Maps) -> Showing:
    """The same way of looking at another run."""
    return Showing(
        other, min(showing.view, max(len(other.names) - 1, 0)), showing.normal_frame, showing.exposure_ev,
        showing.tone, showing.mark_clipped,
    )  # fmt: skip


def _number(value: float, signed: bool) -> str:
    if math.isnan(value):
        return NOTHING
    return (f"{value:+.3g}" if signed else f"{value:.3g}").replace("-", MINUS)
