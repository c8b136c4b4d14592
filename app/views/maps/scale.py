"""The row that measures: two points of the object, their distance as shown, and their true distance, which fixes the scale."""

from PySide6.QtCore import QPointF, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QToolButton, QWidget

from app.inspect.maps import Maps
from app.state import trouble
from app.views.editors import Number
from app.views.elided import Elided
from app.views.pictures.viewport import Viewport
from app.views.readout import told
from app.words import sentence
from engine.errors import RoomlightError
from engine.io.scale_edit import Point, ScaleBar
from engine.scale_bar import factor

LONGEST_MM = 1e5


class ScaleRow(QFrame):
    """Follows the marks of a viewport while it is shown, and says what scale is wanted."""

    wanted = Signal(object)  # a ScaleBar; None: no scale
    closed = Signal()

    def __init__(self, parent: QWidget, viewport: Viewport) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self._viewport = viewport
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
        self.set.clicked.connect(self._want)
        self.remove = QPushButton(self.tr("Re&move scale"))
        self.remove.setAccessibleName(self.tr("Remove scale"))
        self.remove.clicked.connect(lambda: self.wanted.emit(None))
        self.close_button = QToolButton()
        self.close_button.setText("\u00d7")
        self.close_button.setAutoRaise(True)
        self.close_button.setAccessibleName(self.tr("Close"))
        self.close_button.clicked.connect(self.closed)
        row = QHBoxLayout(self)
        row.setContentsMargins(12, 4, 8, 4)
        row.setSpacing(8)
        row.addWidget(self.said, 1)
        for widget in (label, self.length, self.set, self.remove, self.close_button):
            row.addWidget(widget)
        self.hide()

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
        self._viewport.mark(())

    def mark(self) -> None:
        """Mark the pixel under the cursor; a third point begins anew."""
        at, pixel = self._viewport.cursor, self._viewport.pixel()
        if not self.isVisible() or at is None or pixel is None:
            return
        before = self._viewport.marks if len(self._viewport.marks) < 2 else ()
        self._viewport.mark((*before, at))
        self._show()

    def _restore(self) -> None:
        bar = None if self._maps is None else self._maps.scale_bar
        self.remove.setVisible(bar is not None)
        if bar is not None:
            self._viewport.mark(tuple(QPointF(x, y) / bar.size[0] for x, y in bar.points))
            self.length.setValue(1000 * bar.length_m)
        self._show()

    def _show(self) -> None:
        said, able = self._said()
        self.said.setText(said)
        self.set.setEnabled(able)

    def _said(self) -> tuple[str, bool]:
        """What to do next, how long it is or what refuses it; whether it may be set."""
        marks, shown = self._viewport.marks, self._maps
        if len(marks) < 2 or shown is None or shown.camera is None:
            first, second = self.tr("Click one point of the object (M)"), self.tr("Click another point (M)")
            return (second if marks else first), False
        try:
            length = shown.unit_factor / factor(self._bar(1.0), shown.surface, shown.camera)
        except RoomlightError as error:
            return sentence(trouble(str(error)).what), False
        apart = self.tr("{0} {1} apart").format(f"{length:.4g}", told(shown.unit))
        return apart, self.length.value() > 0

    def _want(self) -> None:
        self.wanted.emit(self._bar(self.length.value() / 1000))

    def _bar(self, length_m: float) -> ScaleBar:
        width, height = self._viewport.picture.width, self._viewport.picture.height
        a, b = (_pixel(mark, width) for mark in self._viewport.marks)
        return ScaleBar((a, b), (width, height), length_m)


def _pixel(mark: QPointF, width: int) -> Point:
    return mark.x() * width, mark.y() * width
