"""The end of a run, told where one looks: a card in the window's corner, and the system's own notice while another program is in front.

Silent where the system has no place for notices.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QObject, QTimer
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QSystemTrayIcon, QToolButton

from app.state import called
from app.views.bridge import Bridge
from app.work.jobs import Job, JobState

if TYPE_CHECKING:
    from app.views.main_window import MainWindow

SHOWN_MS = 30_000
MARGIN = 16


class Notice(QFrame):
    """Says how a run ended, and leads to its results."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self.setObjectName("card")
        self.setAutoFillBackground(True)
        self._window = window
        # Not those that are seen to run: a short one may begin and end between two looks.
        self._ended = {job for job in window.shell.board.queue if job.status.ended}
        self._about, self._page = Path(), "maps"
        self._tray: QSystemTrayIcon | None = None
        self.said = QLabel()
        self.go = QPushButton()
        self.go.clicked.connect(self._go)
        self.close_button = QToolButton()
        self.close_button.setText("\u00d7")
        self.close_button.setAutoRaise(True)
        self.close_button.setAccessibleName(self.tr("Close this notice"))
        self.close_button.clicked.connect(self.hide)
        row = QHBoxLayout(self)
        row.setContentsMargins(14, 10, 8, 10)
        row.setSpacing(12)
        for part in (self.said, self.go, self.close_button):
            row.addWidget(part)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(SHOWN_MS)
        self._timer.timeout.connect(self.hide)
        window.shell.board.listen(Bridge(self).latest(self._look))
        window.installEventFilter(self)
        self.hide()

    def eventFilter(self, of: QObject, event: QEvent) -> bool:
        if event.type() is QEvent.Type.Resize:
            self._place()
        return False

    def _look(self) -> None:
        for job in self._window.shell.board.queue:
            if job.status.ended and job not in self._ended:
                self._ended.add(job)
                if job.task == "process" and job.status.state in (JobState.DONE, JobState.FAILED):
                    self._tell(job)

    def _tell(self, job: Job) -> None:
        self._about = Path(str(job.request["session"]))
        done = job.status.state is JobState.DONE
        name = called(self._about)
        told = self.tr("{0} is processed") if done else self.tr("{0} could not be processed")
        self.said.setText(told.format(name))
        self._page = "maps" if done else "process"
        self.go.setText(self.tr("See &maps") if done else self.tr("See &why"))
        self.go.setAccessibleName(self.go.text().replace("&", ""))
        shell = self._window.shell
        # The Process page of this very session says so itself.
        page = self._window.stack.currentWidget()
        if shell.state.session.value != self._about or page is not self._window.page("process"):
            self.show()
            self.raise_()
            self._place()
            self._timer.start()
        if not self._window.isActiveWindow():
            self._tell_system(self.said.text(), job.status.message)

    def _tell_system(self, title: str, message: str) -> None:
        if not (QSystemTrayIcon.isSystemTrayAvailable() and QSystemTrayIcon.supportsMessages()):
            return
        if self._tray is None:
            self._tray = QSystemTrayIcon(self._window.windowIcon(), self)
            self._tray.messageClicked.connect(self._come)
        self._tray.show()
        self._tray.showMessage(title, message or self.tr("Click to see the maps."), self._window.windowIcon())

    def _come(self) -> None:
        """Bring the window to the front, at what was told."""
        self._window.showNormal() if self._window.isMinimized() else self._window.show()
        self._window.raise_()
        self._window.activateWindow()
        self._go()

    def _go(self) -> None:
        self.hide()
        if self._tray is not None:
            self._tray.hide()
        if self._window.open_session(self._about):
            self._window.show_page(self._page)

    def _place(self) -> None:
        self.adjustSize()
        window, foot = self._window, self._window.statusBar().height()
        self.move(window.width() - self.width() - MARGIN, window.height() - foot - self.height() - MARGIN)
