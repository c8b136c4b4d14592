"""Saves strokes soon after each of them, and puts those in their place that had to wait for another process."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from app.mask_files import Keeper
from app.masking import Painting
from app.state import Trouble, trouble
from app.views.background import Background
from engine.errors import RoomlightError

SAVE_AFTER_MS = 300  # strokes that follow one another at once are written once
TRY_AGAIN_MS = 2000  # while another process works on the session


class Saving(QObject):
    """The strokes of the session that is shown, in the page's thread."""

    changed = Signal()  # `saved`, `placed` or `waits`
    arrived = Signal()  # all strokes are in their place
    refused = Signal(str)  # they wait, and why
    failed = Signal(Trouble)

    def __init__(self, parent: QObject, background: Background) -> None:
        super().__init__(parent)
        self._background, self._keeper = background, Keeper()
        self._session: Path | None = None
        self._painting: Painting | None = None
        self._newest = self._written = 0  # numbers of edits
        self.waits = ""  # why strokes that are on disk are not in their place yet
        self.save_timer = self._timer(SAVE_AFTER_MS, self.save)
        self.settle_timer = self._timer(TRY_AGAIN_MS, self.settle)

    @property
    def saved(self) -> bool:
        """Whether every edit is on disk."""
        return self._written == self._newest

    @property
    def placed(self) -> bool:
        """Whether every edit is where a run finds it."""
        return self.saved and not self.waits

    def show(self, session: Path | None, painting: Painting | None) -> None:
        """Turn to a painting; what was edited of the last one is written."""
        self.save()
        for timer in (self.save_timer, self.settle_timer):
            timer.stop()
        self._session, self._painting, self.waits = session, painting, ""
        self._written = self._newest

    def edited(self) -> None:
        self._newest += 1
        self.save_timer.start()
        self.changed.emit()

    def save(self) -> None:
        """Write the strokes as they are now."""
        session, painting, number = self._session, self._painting, self._newest
        if session is None or painting is None or self.saved:
            return
        self.save_timer.stop()
        labels = painting.labels.copy()
        self._ask(f"save {session}", session, number, lambda: self._keeper.keep(session, labels, number))

    def settle(self) -> None:
        """Try whether strokes that wait may take their place now."""
        session = self._session
        if session is not None:
            self._ask("settle", session, self._written, lambda: self._keeper.settle(session))

    def hasten(self) -> None:
        """Do what is left, at once; `arrived` or `refused` follows."""
        if not self.saved:
            self.save()
        else:
            self.settle()

    def finish(self) -> None:
        """Write what is not on disk before returning: the window goes."""
        if self._session is None or self._painting is None or self.saved:
            return
        try:
            self._keeper.keep(self._session, self._painting.labels, self._newest)
            self._written = self._newest
        except (RoomlightError, OSError) as error:
            self.failed.emit(trouble(str(error)))

    def _ask(self, key: str, session: Path, number: int, work: Callable[[], str]) -> None:
        self._background.ask(key, work, lambda waits: self._kept(session, number, waits), self.failed.emit)

    def _kept(self, session: Path, number: int, waits: str) -> None:
        if session != self._session:
            return
        self._written, self.waits = max(self._written, number), waits
        if waits:
            self.settle_timer.start()
            self.refused.emit(waits)
        elif self.saved:
            self.arrived.emit()
        self.changed.emit()

    def _timer(self, interval_ms: int, call: Callable[[], None]) -> QTimer:
        timer = QTimer(self)
        timer.setSingleShot(True)
        timer.setInterval(interval_ms)
        timer.timeout.connect(call)
        return timer
