"""The bar over the Process page: session, how much is left, preset, seed, and the two buttons."""

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QComboBox, QLabel, QVBoxLayout, QWidget

from app.views.editors import Number
from app.views.head import Head
from app.views.page_actions import action_button
from engine.pipeline.settings import PRESETS, Settings


class RunBar(QWidget):
    """Tells what was chosen; shows what it is told."""

    preset_chosen = Signal(str)
    seed_chosen = Signal(int)

    def __init__(self, parent: QWidget | None, start: QAction, stop: QAction) -> None:
        super().__init__(parent)
        self.head = Head(self, start)
        self.left, self.run, self.cancel = self.head.state, self.head.primary, action_button(stop)
        self.preset = QComboBox()
        self.preset.addItems(list(PRESETS))
        self.preset.setAccessibleName(self.tr("Preset"))
        self.preset.setToolTip(
            self.tr(
                "draft: about half of standard's time. standard: the published accuracies. fine: what three solves agree on, three times as long"
            )
        )
        self.preset.activated.connect(lambda row: self.preset_chosen.emit(PRESETS[row]))
        self.seed = Number(whole=True)
        self.seed.setRange(0, 2**31 - 1)
        self.seed.setAccessibleName(self.tr("Seed"))
        self.seed.setToolTip(
            self.tr("Start of the random numbers; light and surface depend on it. Default: 0")
        )
        self.seed.setMaximumWidth(90)
        self.seed.valueChanged.connect(lambda value: self.seed_chosen.emit(round(value)))
        for text, control in ((self.tr("P&reset"), self.preset), (self.tr("S&eed"), self.seed)):
            label = QLabel(text)
            label.setBuddy(control)
            self.head.add(label, control)
        self.head.add(self.cancel)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self.head)
        self._start = start
        self.show_queued(False)

    def show_settings(self, settings: Settings | None) -> None:
        for part in (self.preset, self.seed):
            part.setEnabled(settings is not None)
        if settings is not None:
            self.preset.setCurrentText(settings.preset)
            with QSignalBlocker(self.seed):
                self.seed.setValue(settings.seed)

    def show_queued(self, queued: bool) -> None:
        """Whether the button runs at once or puts the session behind others."""
        self._start.setIconText(self.tr("Add to &queue") if queued else self._start.text().replace("&", ""))
