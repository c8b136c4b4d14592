"""The bar at the window's foot: what was last said, the job under way, devices, and room on the disk."""

import os
import shutil
import threading
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QStatusBar, QToolButton, QWidget

from app.exports import told_bytes
from app.plan import told_seconds
from app.state import State
from app.views import icons, theme
from app.views.bridge import Bridge
from app.views.process.stages import title
from app.work.queue import Board

DISK_EVERY_S = 5.0
LITTLE_BYTES = 2_000_000_000
SAY_MS = 8000


class StatusBar(QStatusBar):
    """Watches the board, the devices and the disk of the open session."""

    show_job = Signal()  # somebody wants to see the job

    def __init__(self, parent: QWidget | None, state: State, board: Board) -> None:
        super().__init__(parent)
        self._state, self._board = state, board
        self.setSizeGripEnabled(False)
        self.job = QToolButton()
        self.job.setAutoRaise(True)
        self.job.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextOnly)
        self.job.setAccessibleName(self.tr("Job under way"))
        self.job.setToolTip(self.tr("Show it"))
        self.job.clicked.connect(self.show_job)
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedWidth(120)
        self.bar.setAccessibleName(self.tr("Progress of the job under way"))
        self.devices = QLabel()
        self.devices.setAccessibleName(self.tr("Devices"))
        self.disk = QLabel()
        self.disk.setAccessibleName(self.tr("Free space on the disk of the open session"))
        self._disk_sign = QLabel()
        self._chip_sign = QLabel()
        for part in (
            self.job,
            self.bar,
            _beside(self._chip_sign, self.devices),
            _beside(self._disk_sign, self.disk),
        ):
            self.addPermanentWidget(part)
        self._bridge = Bridge(self)
        self._free: int | None = None
        self._gone = threading.Event()
        self._look = threading.Event()
        self._folder = Path.home()
        board.listen(self._bridge.latest(self._watch_job))
        state.devices.listen(lambda devices: self._show_devices())
        state.session.listen(self._session)
        self._followed: object = None
        self._watch_job()
        self._show_devices()
        self._dress()
        threading.Thread(target=self._watch_disk, name="disk", daemon=True).start()
        self.destroyed.connect(self._gone.set)

    def say(self, text: str) -> None:
        """A line for some seconds."""
        self.showMessage(text, SAY_MS)

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and hasattr(self, "_disk_sign"):
            self._dress()

    def _dress(self) -> None:
        ours = theme.colours(self)
        self._chip_sign.setPixmap(icons.pixmap("chip", ours.dim, 16, self.devicePixelRatioF()))
        self._show_devices()
        self._show_disk()

    def _show_devices(self) -> None:
        ours = theme.colours(self)
        parts = [self.tr("{0} cores").format(os.cpu_count() or 1)]
        shown = [f'<span style="color:{ours.dim}">{parts[0]}</span>']
        for device in self._state.devices.value:
            parts.append(device.told)
            shown.append(f'<span style="color:{ours.dim if device.well else ours.bad}">{device.told}</span>')
        self.devices.setText("&nbsp;&nbsp;".join(shown))
        self.devices.setToolTip(
            "\n".join(device.details or device.told for device in self._state.devices.value)
        )
        self.devices.setAccessibleDescription(", ".join(parts))

    def _session(self, folder: Path | None) -> None:
        self._folder = folder or Path.home()
        self._look.set()

    def _watch_disk(self) -> None:
        """In a thread of its own: a network drive may take its time."""
        tell = self._bridge.latest(self._take_disk)
        while not self._gone.is_set():
            try:
                tell(shutil.disk_usage(self._folder).free)
            except OSError:
                tell(None)
            self._look.wait(DISK_EVERY_S)
            self._look.clear()

    def _take_disk(self, free: int | None) -> None:
        if free != self._free:
            self._free = free
            self._show_disk()

    def _show_disk(self) -> None:
        ours = theme.colours(self)
        little = self._free is not None and self._free < LITTLE_BYTES
        colour = ours.bad if little else ours.dim
        text = self.tr("disk?") if self._free is None else self.tr("{0} free").format(told_bytes(self._free))
        self.disk.setText(f'<span style="color:{colour}">{text}</span>')
        self.disk.setToolTip(str(self._folder))
        self.disk.setAccessibleDescription(text)
        self._disk_sign.setPixmap(icons.pixmap("disk", colour, 16, self.devicePixelRatioF()))

    def _watch_job(self) -> None:
        job = next(iter(self._board.active), None)
        if job is not None and job is not self._followed:
            self._followed = job
            job.listen(self._bridge.latest(lambda status: self._show_job()))
        self._show_job()

    def _show_job(self) -> None:
        active, waiting = self._board.active, self._board.waiting
        self.job.setVisible(bool(active))
        self.bar.setVisible(bool(active))
        if not active:
            self._followed = None
            return
        status = active[0].status
        # What does one thing only is named once.
        alone = status.stage.casefold() in (active[0].task, status.name.casefold())
        parts = [status.name, "" if alone else title(status.stage)]
        if status.eta_s is not None and status.fraction < 1:
            parts.append(self.tr("{0} left").format(told_seconds(status.eta_s)))
        more = len(active) - 1 + len(waiting)
        if more:
            parts.append(self.tr("+{0} more").format(more))
        self.job.setText("  ".join(part for part in parts if part))
        self.bar.setValue(round(1000 * status.fraction))


def _beside(sign: QLabel, text: QLabel) -> QWidget:
    both = QWidget()
    row = QHBoxLayout(both)
    row.setContentsMargins(8, 2, 8, 2)
    row.setSpacing(5)
    row.addWidget(sign)
    row.addWidget(text)
    return both
