"""Closing while something runs: asks, stops it in order, and ends what does not stop; sessions resume later."""

from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QMessageBox, QWidget

from app.work.queue import Board

LOOK_MS = 100
PATIENCE_MS = 20_000


class Closing(QObject):
    """One window's farewell."""

    stopping = Signal()  # the person agreed; jobs have been asked to stop
    stopped = Signal()  # nothing runs any more

    def __init__(self, window: QWidget, board: Board, patience_ms: int = PATIENCE_MS) -> None:
        super().__init__(window)
        self._window, self._board, self._patience_ms = window, board, patience_ms
        self._waited_ms = 0
        self.question: QMessageBox | None = None
        self.agreed = False

    def may_close(self) -> bool:
        """Whether nothing runs; asks the person when something does."""
        if not self._board.active:
            return True
        if not self.agreed and self.question is None:
            self._ask()
        return False

    def agree(self) -> None:
        """Stop everything, tell `stopped` when it is done."""
        self.agreed = True
        self._waited_ms = 0
        self.stopping.emit()
        self._board.cancel_all()
        self._wait()

    def _ask(self) -> None:
        names = ", ".join(job.status.name for job in self._board.active)
        box = QMessageBox(self._window)
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.setIcon(QMessageBox.Icon.Question)
        box.setWindowTitle(self.tr("Close Roomlight?"))
        box.setText(self.tr("Still running: {0}").format(names))
        box.setInformativeText(
            self.tr(
                "What is finished is kept. The rest is done when the session is processed or captured again."
            )
        )
        stop = box.addButton(self.tr("&Stop and close"), QMessageBox.ButtonRole.DestructiveRole)
        stay = box.addButton(self.tr("&Keep running"), QMessageBox.ButtonRole.RejectRole)
        for button in (stop, stay):
            button.setAccessibleName(button.text().replace("&", ""))
        box.setDefaultButton(stay)
        box.setEscapeButton(stay)
        stop.clicked.connect(self.agree)
        box.finished.connect(self._answered)
        self.question = box
        box.open()

    def _answered(self) -> None:
        self.question = None

    def _wait(self) -> None:
        if not self._board.active:
            self.stopped.emit()
            return
        self._waited_ms += LOOK_MS
        if self._waited_ms >= self._patience_ms:
            self._board.kill_all()
        QTimer.singleShot(LOOK_MS, self, self._wait)
