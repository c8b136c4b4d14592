"""Something a page lets a child work out on demand: a button to start it, its progress, a button to stop it.

The child works on when the page is left; the board counts it, so that the status bar shows it and closing asks.
"""

from collections.abc import Callable, Mapping
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QProgressBar, QPushButton, QWidget

from app.state import Trouble, trouble
from app.views.bridge import Bridge
from app.work.jobs import Job, JobState, JobStatus
from app.work.queue import Board

PATIENCE_S = 3.0  # a child that is stopped has nothing to tidy up

MakeJob = Callable[[str, str, Mapping[str, Any]], Job]


def job(name: str, task: str, request: Mapping[str, Any]) -> Job:
    return Job(name, task, request, patience_s=PATIENCE_S)


class Errand(QWidget):
    """At most one child at a time."""

    wanted = Signal()  # the start button
    heard = Signal(object)  # an event of kind "data"
    noted = Signal(str)  # what the child is at
    done = Signal(str, object)  # task, result
    failed = Signal(Trouble)
    changed = Signal()  # begun or ended

    def __init__(self, parent: QWidget | None = None, make_job: MakeJob = job) -> None:
        super().__init__(parent)
        self.board: Board | None = None  # where it counts; None: nowhere
        self._make_job = make_job
        self._bridge = Bridge(self)
        self._job: Job | None = None
        self._offered = False
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedWidth(140)
        self.bar.setAccessibleName(self.tr("Progress"))
        self.start = QPushButton()
        self.start.setAccessibleName(self.tr("Start"))
        self.start.clicked.connect(self.wanted)
        self._by = self.start
        self.cancel = QPushButton(self.tr("S&top"))
        self.cancel.setAccessibleName(self.tr("Stop"))
        self.cancel.clicked.connect(self.stop)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        for widget in (self.bar, self.start, self.cancel):
            row.addWidget(widget)
        self._show()

    @property
    def busy(self) -> bool:
        return self._job is not None

    def offer(self, text: str) -> None:
        """Show the start button with these words; none hides it."""
        self._offered = bool(text)
        self.start.setText(text)
        self.start.setAccessibleName(text.replace("&", "") or self.tr("Start"))
        self._show()

    def begin(self, name: str, task: str, request: Mapping[str, Any], by: QPushButton | None = None) -> None:
        """Start a child; an earlier one is stopped.

        Args:
            by: the button that was pressed, which is not to be pressed meanwhile; the keyboard waits on the stop button.
        """
        self.stop()
        self._by = by or self.start
        fresh = self._make_job(name, task, request)
        self._job = fresh
        fresh.listen_events(self._bridge.queued(lambda event: self._hear(fresh, event)))
        fresh.listen(self._bridge.latest(lambda status: self._follow(fresh, status)))
        self.bar.setValue(0)
        focused = self._by.hasFocus()
        self._show()
        if focused:
            self.cancel.setFocus()
        self.changed.emit()
        if self.board is None:
            fresh.start()
        else:
            self.board.start(fresh)

    def send(self, command: str, **facts: Any) -> None:
        if self._job is not None:
            self._job.send(command, **facts)

    def stop(self) -> None:
        """End the child; nothing more is heard of it."""
        ended, self._job = self._job, None
        if ended is not None:
            ended.cancel()
            self._over()

    def _hear(self, of: Job, event: Mapping[str, Any]) -> None:
        if of is self._job and event["event"] == "data":
            self.heard.emit(event)

    def _follow(self, of: Job, status: JobStatus) -> None:
        if of is not self._job:
            return
        self.bar.setValue(round(1000 * status.fraction))
        self.bar.setToolTip(status.note)
        self.noted.emit(status.note)
        if not status.ended:
            return
        self._job = None
        self._over()
        if status.state is JobState.FAILED:
            self.failed.emit(trouble(status.message, status.details))
        elif status.state is JobState.DONE:
            self.done.emit(of.task, dict(status.result))

    def _over(self) -> None:
        focused = self.cancel.hasFocus()
        self.changed.emit()
        if focused:
            self._by.show()
            self._by.setFocus()
        self._show()

    def _show(self) -> None:
        self.bar.setVisible(self.busy)
        self.cancel.setVisible(self.busy)
        self.start.setVisible(self._offered and not self.busy)
