"""The row that measures: two points of the object, their distance as shown, and their true distance, which fixes the scale.

Marks are points of the upright picture in its widths, whichever view they were set in; the scale is written in a thread.
"""

from pathlib import Path

from PySide6.QtCore import QPointF, Signal
from PySide6.QtGui import QAction, QUndoStack
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QToolButton, QWidget

from app.inspect.maps import Maps
from app.state import Trouble, trouble
from app.views.background import Background
from app.views.editors import Number
from app.views.elided import Elided
from app.views.page_actions import keyed
from app.views.readout import told
from app.views.value_edit import ValueEdit
from app.words import sentence
from engine.errors import RoomlightError
from engine.io import scale_edit
from engine.io import session as sessions
from engine.io.scale_edit import Point, ScaleBar
from engine.scale_bar import factor

LONGEST_MM = 1e5


class ScaleRow(QFrame):
    """Takes marks while it is shown, and gives the session the scale they fix, which the page can undo."""

    marked = Signal()  # its marks are others now
    written = Signal(str)  # the session has another scale, and what follows from that
    failed = Signal(Trouble)

    def __init__(self, parent: QWidget, undo: QUndoStack, background: Background, by_key: QAction) -> None:
        """
        Args:
            by_key: marks a point without the mouse.
        """
        super().__init__(parent)
        self.setObjectName("panel")
        self.marks: tuple[QPointF, ...] = ()
        self._undo, self._background, self._by_key = undo, background, by_key
        self._session: Path | None = None
        self._maps: Maps | None = None
        self.said = Elided()
        self.length = Number(whole=False)
        self.length.setRange(0.0, LONGEST_MM)
        self.length.setSuffix(" mm")
        self.length.setMinimumWidth(120)
        self.length.setAccessibleName(self.tr("True distance"))
        self.length.valueChanged.connect(lambda value: self._show())
        label = QLabel(self.tr("&True distance"))
        label.setObjectName("dim")
        label.setBuddy(self.length)
        self.set = QPushButton(self.tr("Se&t scale"))
        self.set.setObjectName("primary")
        self.set.setAccessibleName(self.tr("Set scale"))
        self.set.clicked.connect(lambda: self._want(self._bar(self.length.value() / 1000)))
        self.remove = QPushButton(self.tr("Re&move scale"))
        self.remove.setAccessibleName(self.tr("Remove scale"))
        self.remove.clicked.connect(lambda: self._want(None))
        self.close_button = QToolButton()
        self.close_button.setText("\u00d7")
        self.close_button.setAutoRaise(True)
        self.close_button.setAccessibleName(self.tr("Close"))
        self.close_button.clicked.connect(self.leave)
        row = QHBoxLayout(self)
        row.setContentsMargins(12, 4, 8, 4)
        row.setSpacing(8)
        row.addWidget(self.said, 1)
        for widget in (label, self.length, self.set, self.remove, self.close_button):
            row.addWidget(widget)
        self.hide()

    def show_session(self, session: Path | None) -> None:
        if session != self._session:
            self._session = session
            self.leave()

    def show_run(self, maps: Maps | None) -> None:
        """Measure in this run; the marks that a scale was given by are shown again."""
        self._maps = maps
        if self.isVisible():
            self._restore()

    def open(self) -> None:
        self.show()
        self._restore()

    def leave(self) -> None:
        self.hide()
        self._mark(())

    def mark(self, at: QPointF) -> None:
        """Mark this point of the picture; a third begins anew."""
        if self.isVisible():
            self._mark((*(self.marks if len(self.marks) < 2 else ()), at))

    def _mark(self, marks: tuple[QPointF, ...]) -> None:
        self.marks = marks
        self._show()
        self.marked.emit()

    def _restore(self) -> None:
        bar = None if self._maps is None else self._maps.scale_bar
        self.remove.setVisible(bar is not None)
        if bar is not None:
            self.length.setValue(1000 * bar.length_m)
            self.marks = tuple(QPointF(x, y) / bar.size[0] for x, y in bar.points)
        self._mark(self.marks)

    def _show(self) -> None:
        said, able = self._said()
        self.said.setText(said)
        self.set.setEnabled(able)

    def _said(self) -> tuple[str, bool]:
        """What to do next, how long it is or what refuses it; whether it may be set."""
        marks, shown = self.marks, self._maps
        if len(marks) < 2 or shown is None or shown.camera is None:
            asked = self.tr("Click another point") if marks else self.tr("Click one point of the object")
            return keyed(asked, self._by_key), False
        try:
            length = shown.unit_factor / factor(self._bar(1.0), shown.surface, shown.camera)
        except RoomlightError as error:
            return sentence(trouble(str(error)).what), False
        apart = self.tr("{0} {1} apart").format(f"{length:.4g}", told(shown.unit))
        return apart, self.length.value() > 0

    def _bar(self, length_m: float) -> ScaleBar:
        assert self._maps is not None
        height, width = self._maps.surface.mask.shape
        a, b = (_pixel(mark, width) for mark in self.marks)
        return ScaleBar((a, b), (width, height), length_m)

    def _want(self, bar: ScaleBar | None) -> None:
        if self._maps is not None and bar != self._maps.scale_bar:
            self._undo.push(ValueEdit(self.tr("the scale"), self._maps.scale_bar, bar, self._write))

    def _write(self, bar: ScaleBar | None) -> None:
        folder = self._session
        if folder is not None:
            self._background.ask(
                "scale", lambda: scale_edit.write(sessions.open_session(folder), bar), self._written, self._fail
            )  # fmt: skip

    def _written(self, done: None) -> None:
        self.written.emit(self.tr("The scale has changed: process once more to write the files anew"))

    def _fail(self, fault: Trouble) -> None:
        self._undo.clear()
        self.failed.emit(fault)


def _pixel(mark: QPointF, width: int) -> Point:
    return mark.x() * width, mark.y() * width
