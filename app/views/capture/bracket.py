"""The exposures of each pose: offsets in EV about a shutter time, ISO and aperture that the camera offers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QComboBox, QWidget

from app.capture.wanted import parse_stops, told_shutter, told_stops
from app.state import trouble
from app.views.boxes import box_of
from app.views.capture.parts import Section, button, dim, row
from engine.errors import RoomlightError

USUAL = ((-3.0, 0.0, 3.0), (-2.0, 0.0, 2.0), (-4.0, -2.0, 0.0, 2.0, 4.0), (-6.0, -3.0, 0.0, 3.0, 6.0), (0.0,))


@dataclass(frozen=True, slots=True)
class Offered:
    """What the camera can be set to; nothing where it cannot be set from here."""

    shutters_s: Sequence[float] = ()
    isos: Sequence[int] = ()
    apertures: Sequence[float] = ()
    sets_exposure: bool = True


class BracketBox(Section):
    """Holds what was chosen; `exposure` and `stops` give it."""

    preview_wanted = Signal()
    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("", parent)
        self.setAccessibleName(self.tr("Exposure"))
        self.heading.setText(self.tr("Exposure"))
        grid = self.rows()
        self.bracket = box_of("", 12)
        self.bracket.setEditable(True)
        self.bracket.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.bracket.addItems([told_stops(stops) for stops in USUAL])
        self.bracket.setToolTip(
            self.tr(
                "Exposures of each pose in EV from the shutter time; three stops apart loses nothing between them"
            )
        )
        row(grid, self.tr("&Bracket, EV"), self.bracket, self.tr("Bracket in EV"))
        self.shutter, self.iso, self.aperture = box_of("", 10), box_of("", 10), box_of("", 10)
        row(grid, self.tr("Sh&utter"), self.shutter, self.tr("Shutter of the middle exposure"))
        row(grid, self.tr("&ISO"), self.iso)
        row(grid, self.tr("&Aperture"), self.aperture)
        self.fault = dim()
        self.body.addWidget(self.fault)
        self.preview = button(
            self.tr("&Test shot"), self.tr("One photograph with these settings, which is not kept")
        )
        self.preview.clicked.connect(self.preview_wanted)
        self.body.addWidget(self.preview)
        self.bracket.editTextChanged.connect(self._check)
        self.show_offered(Offered())
        self._check()

    @property
    def stops(self) -> tuple[float, ...] | None:
        """The bracket; None while what stands there is none."""
        try:
            return parse_stops(self.bracket.currentText())
        except RoomlightError:
            return None

    def exposure(self) -> Mapping[str, Any]:
        """shutter_s, iso, aperture; None: as the camera has it."""
        boxes = {"shutter_s": self.shutter, "iso": self.iso, "aperture": self.aperture}
        return {name: box.currentData() for name, box in boxes.items()}

    def show_offered(self, offered: Offered) -> None:
        """What this camera can be set to; a choice that it offers too stays."""
        asked = self.tr("keep camera setting")
        body = self.tr("set on the camera's body")
        first = asked if offered.sets_exposure else body
        told: tuple[tuple[QComboBox, Sequence[Any], Callable[[Any], str]], ...] = (
            (self.shutter, offered.shutters_s, told_shutter),
            (self.iso, offered.isos, str),
            (self.aperture, offered.apertures, lambda number: f"f/{number:g}"),
        )
        for box, values, words in told:
            values = values if offered.sets_exposure else ()
            items = [(first, None), *((words(value), value) for value in values)]
            if [(box.itemText(i), box.itemData(i)) for i in range(box.count())] == items:
                continue
            before = box.currentData()
            with QSignalBlocker(box):
                box.clear()
                for text, value in items:
                    box.addItem(text, value)
                box.setCurrentIndex(max(box.findData(before), 0))
            box.setEnabled(bool(values))

    def show_able(self, previews: bool) -> None:
        self.preview.setEnabled(previews)

    def _check(self) -> None:
        try:
            parse_stops(self.bracket.currentText())
        except RoomlightError as error:
            self.fault.setText(trouble(str(error)).remedy)
        else:
            self.fault.setText("")
        self.fault.setVisible(bool(self.fault.text()))
        self.changed.emit()
