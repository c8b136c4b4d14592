"""The values under the cursor, one cell a quantity: title, value with its standard error, unit; two rows."""

from collections.abc import Sequence

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtGui import QFont
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QWidget

from app.inspect.readings import Reading
from app.words import QT_TRANSLATE_NOOP

# Title (but for the first, one of `app/inspect/maps.py`), row, column, and its contents at the longest: the strip stands still while the mouse moves.
CELLS = (
    (QT_TRANSLATE_NOOP("maps", "Pixel"), 0, 0, "0000, 0000"),
    ("Normal", 1, 0, "+0.000 +0.000 +0.000 ± 0.00°"),
    ("Photograph", 0, 1, "0.0000 0.0000 0.0000"),
    ("Albedo", 1, 1, "0.000 0.000 0.000 ± 0.0000"),
    ("Re-rendered", 0, 2, "0.0000 0.0000 0.0000"),
    ("Roughness", 1, 2, "0.000 ± 0.0000 specular 0.00"),
    ("Rendering error", 0, 3, "00.0 %"),
    ("Depth", 1, 3, "0.00000 scene units"),
    ("Flags", 0, 4, ""),
)


NOTHING = "\u2013"


def told(text: str) -> str:
    """A word of the maps' vocabulary in the person's language."""
    return QCoreApplication.translate("maps", text)


class Readout(QFrame):
    """A strip of cells; empty where nothing is pointed at."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self.setAccessibleName(self.tr("Values under the cursor"))
        self._values: dict[str, QLabel] = {}
        layout = QGridLayout(self)
        layout.setContentsMargins(12, 4, 12, 4)
        layout.setHorizontalSpacing(8)
        layout.setVerticalSpacing(0)
        figures = self.font()
        figures.setPixelSize(12)
        figures.setFeature(QFont.Tag("tnum"), 1)  # a digit is as wide as any other: numbers stand still
        for title, row, column, widest in CELLS:
            name, value = QLabel(told(title)), QLabel(NOTHING)
            name.setObjectName("dim")
            small = name.font()
            small.setPixelSize(11)
            name.setFont(small)
            value.setFont(figures)
            value.setTextFormat(Qt.TextFormat.PlainText)
            value.setAccessibleName(told(title))
            value.setMinimumWidth(value.fontMetrics().horizontalAdvance(widest + "  "))
            layout.addWidget(name, row, 2 * column)
            layout.addWidget(value, row, 2 * column + 1)
            self._values[title] = value
        layout.setColumnStretch(2 * column + 1, 1)

    def show_readings(self, pixel: tuple[int, int] | None, readings: Sequence[Reading]) -> None:
        """`readings` of `app/inspect/readings.py`; cells without one show a dash."""
        found = {reading.title: reading for reading in readings}
        for title, label in self._values.items():
            if title == "Pixel":
                label.setText(NOTHING if pixel is None else f"{pixel[0]}, {pixel[1]}")
                continue
            reading = found.get(title)
            label.setText(NOTHING if reading is None else line(reading))
            if reading is not None:
                label.setToolTip(reading.unit)

    def text(self, title: str) -> str:
        """What a cell says."""
        return self._values[title].text()


def line(reading: Reading) -> str:
    """Value, error and unit; units that are sentences stay in the tooltip."""
    error = f" ± {reading.error}" if reading.error else ""
    unit = f" {told(reading.unit)}" if reading.title in ("Depth", "Rendering error") and reading.unit else ""
    return f"{reading.text}{error}{unit}"
