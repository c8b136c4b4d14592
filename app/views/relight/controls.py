"""The controls of the relight page: where the light comes from, how it is turned, how strong its parts are."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QCoreApplication, Qt, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import (
    QCheckBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from app.inspect.falsecolour import MINUS
from app.relight.panoramas import NAMES as PANORAMAS
from app.relight.relit import Setting
from app.views.boxes import box_of
from app.views.column import Column
from app.views.pixels import image_of

WIDTH = 310
TIMES = "\u00d7"
STRENGTH_STOPS = 4  # a lamp from 1/16 to 16 times as strong; all the way down is off
STRENGTH_STEPS = 4  # per stop
EV_STEPS = 3
EV_RANGE = 6


class RelightControls(Column):
    """A column of sliders; every change is told once."""

    changed = Signal()
    view_picked = Signal(int)  # of the recovered light
    panorama_wanted = Signal()
    ready_picked = Signal(str)  # a light that ships, by name; empty: the recovered one
    in_space = Signal()  # asks for the surface in this light on the 3D page
    playing = Signal(bool)
    lamp_changed = Signal()  # the person's own: on, off, or moved

    def __init__(self, parent: QWidget | None = None) -> None:
        body = QFrame()
        super().__init__(body, WIDTH)
        self.setParent(parent)
        self.setAccessibleName(self.tr("Light and camera"))
        body.setObjectName("panel")
        self._column = QVBoxLayout(body)
        self._column.setContentsMargins(14, 12, 14, 12)
        self._column.setSpacing(5)

        self.panorama = QPushButton(self.tr("&Panorama…"))
        self.panorama.setAccessibleName(self.tr("Load a panorama"))
        self.panorama.setToolTip(
            self.tr("An equirectangular EXR, HDR, PNG or JPEG; its middle lies ahead of the camera")
        )
        self.panorama.clicked.connect(self.panorama_wanted)
        self._heading(self.tr("Light"), self.panorama)
        self.picture = QLabel()
        self.picture.setFixedSize(WIDTH - 28, (WIDTH - 28) // 2)
        self.picture.setScaledContents(True)
        self.picture.setAccessibleName(
            self.tr("The light around the object; the middle is ahead of the camera")
        )
        self.picture.setToolTip(
            self.tr("The light around the object, logarithmic; the middle is ahead of the camera")
        )
        self._column.addWidget(self.picture)
        self.view = box_of(self.tr("Recovered light of view"), 4)
        self.view.activated.connect(self.view_picked)
        self.ready = box_of(self.tr("Light"), 6)
        self.ready.addItem(self.tr("Of the room, as recovered"), "")
        for name, words in PANORAMAS.items():
            self.ready.addItem(QCoreApplication.translate("relight", words), name)
        self.ready.activated.connect(lambda row: self.ready_picked.emit(self.ready.itemData(row)))
        rows = QGridLayout()
        rows.setColumnStretch(1, 1)
        for at, (text, box) in enumerate(
            ((self.tr("Photo&graph"), self.view), (self.tr("L&ight"), self.ready))
        ):
            label = QLabel(text)
            label.setBuddy(box)
            rows.addWidget(label, at, 0)
            rows.addWidget(box, at, 1)
        self._column.addLayout(rows)
        self.source = QLabel()
        self.source.setObjectName("dim")
        self.source.setWordWrap(True)
        # Room for two lines, so that the sliders stay where they are.
        self.source.setMinimumHeight(2 * self.source.fontMetrics().lineSpacing())
        self.source.setAlignment(Qt.AlignmentFlag.AlignTop)
        self._column.addWidget(self.source)

        self._heading(self.tr("Turn"))
        grid = QGridLayout()
        grid.setHorizontalSpacing(8)
        self.yaw = self._slider(grid, 0, self.tr("&Rotate"), -180, 180, "°")
        self.pitch = self._slider(grid, 1, self.tr("Ele&vate"), -90, 90, "°")
        self.roll = self._slider(grid, 2, self.tr("Ro&ll"), -180, 180, "°")
        self._column.addLayout(grid)
        row = QHBoxLayout()
        self.play = QPushButton(self.tr("Pl&ay"))
        self.play.setCheckable(True)
        self.play.toggled.connect(self.playing)
        self.reset = QPushButton(self.tr("Re&set"))
        self.reset.clicked.connect(self.as_photographed)
        for button in (self.play, self.reset):
            button.setAccessibleName(button.text().replace("&", ""))
            row.addWidget(button)
        self._column.addLayout(row)

        self._heading(self.tr("Strength"))
        self._strengths = QGridLayout()
        self._strengths.setHorizontalSpacing(8)
        self._column.addLayout(self._strengths)
        self.room = self._strength(0, self.tr("Room"), "")
        self.lamps: list[Named] = []

        self.lamp_on = QCheckBox(self.tr("&Drag a lamp of your own on the picture"))
        self.lamp_on.setAccessibleName(self.lamp_on.text().replace("&", ""))
        self.lamp_on.setToolTip(
            self.tr("Dragging and the arrow keys then move the lamp and leave the room as it is")
        )
        self.lamp_on.toggled.connect(self._switch_lamp)
        self._column.addWidget(self.lamp_on)
        grid = QGridLayout()
        grid.setHorizontalSpacing(8)
        self.lamp_strength = self._strength(0, self.tr("&Own lamp"), "", grid)
        self.lamp_strength.setEnabled(False)
        self._column.addLayout(grid)

        self._heading(self.tr("Picture"))
        grid = QGridLayout()
        grid.setHorizontalSpacing(8)
        self.ev = self._slider(
            grid, 0, self.tr("&Exposure"), -EV_RANGE * EV_STEPS, EV_RANGE * EV_STEPS, " EV", EV_STEPS
        )
        self._column.addLayout(grid)
        self.behind = QCheckBox(self.tr("Show the light &behind the object"))
        self.behind.setChecked(True)
        self.behind.toggled.connect(lambda on: self.changed.emit())
        self.log = QCheckBox(self.tr("&Logarithmic tones"))
        self.log.toggled.connect(lambda on: self.changed.emit())
        for box in (self.behind, self.log):
            box.setAccessibleName(box.text().replace("&", ""))
            self._column.addWidget(box)
        self.space = QPushButton(self.tr("Show in &3D"))
        self.space.setAccessibleName(self.tr("Show the surface in this light on the 3D page"))
        self.space.clicked.connect(self.in_space)
        self._column.addWidget(self.space)
        self._column.addStretch(1)

    # What is set

    def setting(self) -> Setting:
        return Setting(
            float(self.yaw.value()), float(self.pitch.value()), float(self.roll.value()), strength(self.room.value()),
            tuple(strength(slider.value()) for slider in self.lamps), self.lamp,
        )  # fmt: skip

    @property
    def lamp(self) -> tuple[float, float] | None:
        """Where the person's own lamp stands; None: it is off."""
        return self._lamp if self.lamp_on.isChecked() else None

    @property
    def lamp_power(self) -> float:
        return strength(self.lamp_strength.value())

    def move_lamp(self, right: float, up: float) -> None:
        self._lamp = (right, up)
        self.lamp_changed.emit()
        self.changed.emit()

    def _switch_lamp(self, on: bool) -> None:
        self.lamp_strength.setEnabled(on)
        self.lamp_changed.emit()
        self.changed.emit()

    @property
    def exposure_ev(self) -> float:
        return self.ev.value() / EV_STEPS

    @property
    def tone(self) -> str:
        return "log" if self.log.isChecked() else "srgb"

    def turn_by(self, yaw: float, pitch: float) -> None:
        """Turn further; round and round, but not over the top."""
        self._yaw = (self._yaw + yaw + 180) % 360 - 180
        self._pitch = min(max(self._pitch + pitch, -90.0), 90.0)
        # Fractions of a degree add up while dragging; the sliders show whole ones.
        kept = self._yaw, self._pitch
        self.yaw.setValue(round(self._yaw))
        self.pitch.setValue(round(self._pitch))
        self._yaw, self._pitch = kept

    def as_photographed(self) -> None:
        """The light as it was: no turn, every strength 1."""
        self.play.setChecked(False)
        self.lamp_on.setChecked(False)
        for slider in (self.yaw, self.pitch, self.roll, self.room, *self.lamps):
            slider.setValue(0)

    # What there is

    def offer(self, views: Sequence[tuple[str, int]], chosen: int | None) -> None:
        """The views (name, number) whose light there may be."""
        self.view.blockSignals(True)
        self.view.clear()
        for name, number in views:
            self.view.addItem(name, number)
        self.view.setCurrentIndex(-1 if chosen is None else self.view.findData(chosen))
        self.view.blockSignals(False)

    def show_lamps(self, names: Sequence[str], clipped: Sequence[bool]) -> None:
        """One slider for each lamp."""
        while self._strengths.rowCount() > 1 and self.lamps:
            slider = self.lamps.pop()
            for widget in (slider, slider.label, slider.told):
                self._strengths.removeWidget(widget)
                widget.deleteLater()
        for i, (name, bare) in enumerate(zip(names, clipped, strict=True)):
            tip = (
                self.tr("Clipped in every photograph: its strength is inferred from the object")
                if bare
                else ""
            )
            self.lamps.append(self._strength(i + 1, name, tip))

    def show_light(self, pixels: np.ndarray) -> None:
        """The small panorama."""
        self.picture.setPixmap(QPixmap.fromImage(image_of(pixels)))

    # Building

    _yaw = 0.0
    _pitch = 0.0
    _lamp = (-0.5, 0.6)

    def _heading(self, text: str, beside: QWidget | None = None) -> None:
        label = QLabel(text)
        label.setObjectName("heading")
        if self._column.count():
            self._column.addSpacing(8)
        row = QHBoxLayout()
        row.addWidget(label, 1)
        if beside is not None:
            row.addWidget(beside)
        self._column.addLayout(row)

    def _slider(
        self, grid: QGridLayout, row: int, text: str, low: int, high: int, unit: str, steps: int = 1
    ) -> "Named":
        slider = Named(text, low, high)
        slider.setPageStep(15 if steps == 1 else steps)

        def tell(value: int) -> None:
            number = f"{value / steps:+.1f}" if steps > 1 else f"{value:+d}"
            slider.told.setText((number if value else "0").replace("-", MINUS) + unit)
            if slider is getattr(self, "yaw", None):
                self._yaw = float(value)
            if slider is getattr(self, "pitch", None):
                self._pitch = float(value)
            self.changed.emit()

        slider.valueChanged.connect(tell)
        slider.told.setText(f"0{unit}")
        slider.place(grid, row)
        return slider

    def _strength(self, row: int, name: str, tip: str, grid: QGridLayout | None = None) -> "Named":
        ends = STRENGTH_STOPS * STRENGTH_STEPS
        slider = Named(name, -ends, ends)
        slider.setPageStep(STRENGTH_STEPS)
        if tip:
            slider.setToolTip(tip)
            slider.label.setToolTip(tip)

        def tell(value: int) -> None:
            factor = strength(value)
            slider.told.setText(self.tr("off") if factor == 0 else f"{TIMES} {factor:.3g}")
            self.changed.emit()

        slider.valueChanged.connect(tell)
        slider.told.setText(f"{TIMES} 1")
        slider.place(grid or self._strengths, row)
        return slider


class Named(QSlider):
    """A slider with its name before and its value after it; a double click sets it to 0."""

    def __init__(self, text: str, low: int, high: int) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self.setRange(low, high)
        self.setAccessibleName(text.replace("&", ""))
        self.label = QLabel(text)
        self.label.setBuddy(self)
        self.told = QLabel()
        self.told.setMinimumWidth(self.told.fontMetrics().horizontalAdvance(f"{MINUS}0.0 EV"))
        self.told.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)

    def place(self, grid: QGridLayout, row: int) -> None:
        for column, widget in enumerate((self.label, self, self.told)):
            grid.addWidget(widget, row, column)
        grid.setColumnStretch(1, 1)
        grid.setColumnMinimumWidth(0, 68)

    def mouseDoubleClickEvent(self, event) -> None:
        self.setValue(0)


def strength(value: int) -> float:
    """The factor of a strength slider's place: stops, all the way down is off."""
    return 0.0 if value <= -STRENGTH_STOPS * STRENGTH_STEPS else 2.0 ** (value / STRENGTH_STEPS)
