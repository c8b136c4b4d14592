"""The queue of runs: what waits, in which order, what runs, what ended; sessions are added, moved, removed, held."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QPushButton,
    QToolButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from app.plan import told_seconds
from app.views import icons, theme
from app.views.bridge import Bridge
from app.views.process.stages import title
from app.work.jobs import Job, JobState, JobStatus
from app.work.queue import Board

JOB = Qt.ItemDataRole.UserRole


class QueuePanel(QWidget):
    """Shows the board's queue; sessions to add are told with `added`."""

    added = Signal(Path)
    chosen = Signal(Path)  # a session in the queue was activated
    scheduler_given = Signal(str)  # for what is queued from now on

    def __init__(self, parent: QWidget | None, board: Board, last_folder: Callable[[], str]) -> None:
        super().__init__(parent)
        self._board, self._last_folder = board, last_folder
        self._bridge = Bridge(self)
        self._followed: set[int] = set()
        self._lines: dict[Job, QTreeWidgetItem] = {}
        self.list = QTreeWidget()
        self.list.setAccessibleName(self.tr("Queue"))
        self.list.setRootIsDecorated(False)
        self.list.setObjectName("plain")
        self.list.setHeaderLabels([self.tr("Session"), self.tr("State"), self.tr("Folder")])
        header = self.list.header()
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        header.resizeSection(1, 300)
        self.list.itemActivated.connect(lambda item, column: self.chosen.emit(_session(item.data(0, JOB))))
        self.list.currentItemChanged.connect(lambda now, before: self._enable())
        self.add = QPushButton(self.tr("&Add session…"))
        self.add.setToolTip(self.tr("Queue another session; it runs with its own settings"))
        self.add.clicked.connect(self._add)
        self.hold = QPushButton(self.tr("Pause &queue"))
        self.hold.setCheckable(True)
        self.hold.setToolTip(self.tr("Start nothing further; what runs goes on"))
        self.hold.toggled.connect(board.hold)
        self.clear = QPushButton(self.tr("C&lear ended"))
        self.clear.clicked.connect(board.clear_ended)
        self.scheduler = QLineEdit()
        self.scheduler.setAccessibleName(self.tr("Cluster"))
        self.scheduler.setPlaceholderText(self.tr("this computer"))
        self.scheduler.setToolTip(
            self.tr(
                "Scheduler of a dask.distributed cluster, such as tcp://head:8786, that processes what is queued from now on;"
                " its workers see the sessions under the same paths. Empty: this computer"
            )
        )
        self.scheduler.editingFinished.connect(
            lambda: self.scheduler_given.emit(self.scheduler.text().strip())
        )
        self.up = self._tool("up", self.tr("Move up"), "Alt+Up", lambda: self._move(-1))
        self.down = self._tool("down", self.tr("Move down"), "Alt+Down", lambda: self._move(1))
        self.remove = self._tool("remove", self.tr("Remove, or cancel"), "Del", self._remove)
        for button in (self.add, self.hold, self.clear):
            button.setAccessibleName(button.text().replace("&", "").rstrip("…"))
        row = QHBoxLayout()
        for part in (self.add, self.hold, self.clear):
            row.addWidget(part)
        cluster = QLabel(self.tr("Clus&ter"))
        cluster.setBuddy(self.scheduler)
        row.addSpacing(6)
        row.addWidget(cluster)
        row.addWidget(self.scheduler, 1)
        row.addStretch()
        for part in (self.up, self.down, self.remove):
            row.addWidget(part)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 6, 8, 6)
        layout.addWidget(self.list, 1)
        layout.addLayout(row)
        board.listen(self._bridge.latest(self.refresh))
        self._dress()
        self.refresh()

    def refresh(self) -> None:
        """Show the queue as it is."""
        jobs = self._board.queue
        current = self.current()
        if list(self._lines) != list(jobs):
            self.list.clear()
            self._lines = {}
            for job in jobs:
                item = QTreeWidgetItem([job.status.name, "", str(_session(job))])
                item.setData(0, JOB, job)
                item.setToolTip(2, str(_session(job)))
                self._lines[job] = item
            self.list.addTopLevelItems(list(self._lines.values()))
            if current in self._lines:
                self.list.setCurrentItem(self._lines[current])
        for job in jobs:
            self._show(job)
            if id(job) not in self._followed:
                self._followed.add(id(job))
                show = self._bridge.latest(lambda status, job=job: self._show(job))
                job.listen(show)
        self.hold.setChecked(self._board.held)
        self._enable()

    def current(self) -> Job | None:
        item = self.list.currentItem()
        return item.data(0, JOB) if item is not None else None

    def _show(self, job: Job) -> None:
        ours, item = theme.colours(self), self._lines.get(job)
        if item is not None:
            text = self.told(job.status)
            item.setText(1, text)
            colour = {JobState.FAILED: ours.bad, JobState.DONE: ours.good, JobState.RUNNING: ours.accent}
            item.setForeground(1, theme.colour(colour.get(job.status.state, ours.text)))
            item.setToolTip(1, text)

    def told(self, status: JobStatus) -> str:
        """A job's state in a line."""
        if status.state is JobState.QUEUED:
            return self.tr("waiting")
        if status.state is JobState.RUNNING:
            if not status.stage:
                return status.place or self.tr("starting…")
            left = (
                self.tr(", {0} left").format(told_seconds(status.eta_s)) if status.eta_s is not None else ""
            )
            running = self.tr("{0}, stage {1} of {2}: {3:.0f} %{4}").format(
                title(status.stage), status.stage_number, status.stages, 100 * status.fraction, left
            )
            return f"{status.place}: {running}" if status.place else running
        if status.state is JobState.CANCELLING:
            return self.tr("stopping…")
        if status.state is JobState.DONE:
            return self.tr("done")
        if status.state is JobState.CANCELLED:
            return self.tr("stopped")
        return self.tr("failed: {0}").format(status.message)

    def _enable(self) -> None:
        job = self.current()
        waiting = job is not None and job.status.state is JobState.QUEUED
        order = self._board.waiting
        self.up.setEnabled(waiting and job is not order[0])
        self.down.setEnabled(waiting and job is not order[-1])
        self.remove.setEnabled(job is not None)
        self.clear.setEnabled(any(job.status.ended for job in self._board.queue))

    def _move(self, by: int) -> None:
        job = self.current()
        if job is not None and job in self._board.waiting:
            self._board.move(job, self._board.waiting.index(job) + by)

    def _remove(self) -> None:
        job = self.current()
        if job is None:
            return
        if job.status.active:
            job.cancel()
        else:
            self._board.remove(job)

    def _add(self) -> None:
        said = QFileDialog.getExistingDirectory(
            self, self.tr("Add a session to the queue"), self._last_folder()
        )
        if said:
            self.added.emit(Path(said))

    def _tool(self, name: str, text: str, keys: str, do: Callable[[], None]) -> QToolButton:
        action = QAction(text, self.list)
        action.setShortcut(keys)
        action.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        action.triggered.connect(do)
        self.list.addAction(action)
        button = QToolButton()
        button.setAutoRaise(True)
        button.setProperty("icon_name", name)
        button.setAccessibleName(text)
        button.setToolTip(f"{text} ({keys})")
        button.clicked.connect(do)
        return button

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and hasattr(self, "remove"):
            self._dress()
            self.refresh()

    def _dress(self) -> None:
        ours = theme.colours(self)
        for button in (self.up, self.down, self.remove):
            button.setIcon(icons.icon(button.property("icon_name"), ours.text, 18))


def _session(job: Job) -> Path:
    return Path(str(job.request.get("session", "")))
