"""The bar over the Process page: session, how much is left, preset, device, seed, and the two buttons."""

from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QPushButton, QWidget

from app.state import called
from app.views.editors import Number
from engine.pipeline.settings import PRESETS, Settings

DEVICES = ("auto", "cpu", "cuda")


class RunBar(QWidget):
    """Tells what was chosen; shows what it is told."""

    preset_chosen = Signal(str)
    device_chosen = Signal(str)
    seed_chosen = Signal(int)

    def __init__(self, parent: QWidget | None, start: QAction, stop: QAction) -> None:
        super().__init__(parent)
        self.name = QLabel()
        self.name.setObjectName("heading")
        self.left = QLabel()
        self.left.setObjectName("dim")
        self.preset = QComboBox()
        self.preset.addItems(list(PRESETS))
        self.preset.setAccessibleName(self.tr("Preset"))
        self.preset.setToolTip(
            self.tr("draft: a first look. standard: what the accuracy is measured with. fine: more time")
        )
        self.preset.activated.connect(lambda row: self.preset_chosen.emit(PRESETS[row]))
        self.device = QComboBox()
        self.device.addItems(list(DEVICES))
        self.device.setAccessibleName(self.tr("Device"))
        self.device.setToolTip(self.tr("CPU or GPU; changing it does not redo finished stages"))
        self.device.activated.connect(lambda row: self.device_chosen.emit(DEVICES[row]))
        self.seed = Number(whole=True)
        self.seed.setRange(0, 2**31 - 1)
        self.seed.setAccessibleName(self.tr("Seed"))
        self.seed.setToolTip(
            self.tr("Start of the random numbers; light and surface depend on it. Default: 0")
        )
        self.seed.setMaximumWidth(90)
        self.seed.valueChanged.connect(lambda value: self.seed_chosen.emit(round(value)))
        self.run = QPushButton()
        self.run.setObjectName("primary")
        self.run.setAccessibleName(start.text())
        self.cancel = QPushButton(self.tr("&Cancel"))
        self.cancel.setAccessibleName(stop.text())
        for button, action in ((self.run, start), (self.cancel, stop)):
            button.clicked.connect(action.trigger)
            button.setToolTip(f"{action.text()} ({action.shortcut().toString()})")
            action.changed.connect(lambda button=button, action=action: button.setEnabled(action.isEnabled()))
        row = QHBoxLayout(self)
        row.setContentsMargins(16, 10, 12, 8)
        row.setSpacing(8)
        row.addWidget(self.name)
        row.addWidget(self.left)
        row.addStretch()
        for text, control in (
            (self.tr("P&reset"), self.preset), (self.tr("&Device"), self.device), (self.tr("S&eed"), self.seed)
        ):  # fmt: skip
            label = QLabel(text)
            label.setBuddy(control)
            row.addSpacing(6)
            row.addWidget(label)
            row.addWidget(control)
        row.addSpacing(10)
        row.addWidget(self.cancel)
        row.addWidget(self.run)
        self.show_queued(False)

    def show_session(self, folder: Path | None) -> None:
        self.name.setText(self.tr("No session is open") if folder is None else called(folder))
        self.name.setToolTip(str(folder or ""))

    def show_settings(self, settings: Settings | None) -> None:
        for part in (self.preset, self.seed):
            part.setEnabled(settings is not None)
        if settings is not None:
            self.preset.setCurrentText(settings.preset)
            with QSignalBlocker(self.seed):
                self.seed.setValue(settings.seed)

    def show_queued(self, queued: bool) -> None:
        """Whether the button runs at once or puts the session behind others."""
        self.run.setText(self.tr("Add to &queue") if queued else self.tr("&Process"))
