"""Saves a film of the view: asks for one picture after the other, and writes each when it is as good as it gets.

The dialog stands before the window meanwhile, so that nobody moves the eye; it can be cancelled at any picture.
"""

from collections.abc import Callable, Sequence

from PySide6.QtCore import QElapsedTimer, Qt, Signal
from PySide6.QtWidgets import QProgressBar, QProgressDialog, QPushButton, QWidget

from app.plan import told_seconds
from app.state import Trouble
from app.viewer.events import Picture
from app.viewer.film import Film
from app.viewer.orbit import Orbit
from app.viewer.protocol import Style
from app.views.background import Background


class FilmDialog(QProgressDialog):
    """One film of `looks`; `ask` has a picture drawn and returns the number of its look."""

    ended = Signal(object)  # Trouble; None: it is saved, or was cancelled
    saved = Signal()

    def __init__(
        self,
        parent: QWidget,
        film: Film,
        looks: Sequence[tuple[Orbit, Style]],
        ask: Callable[[Orbit, Style], int],
    ) -> None:
        super().__init__(parent)
        self._film, self._looks, self._ask = film, looks, ask
        self._background = Background(self, "film")
        self._since = QElapsedTimer()
        self._done, self._wanted = 0, -1
        self._over = False
        self.setWindowTitle(self.tr("Saving the video"))
        self.setWindowModality(Qt.WindowModality.WindowModal)
        self.setAutoClose(False)
        self.setAutoReset(False)
        self.setMinimumDuration(0)
        self.setMinimumWidth(340)
        bar = QProgressBar()
        bar.setTextVisible(False)  # the label says it
        self.setBar(bar)
        self.setRange(0, len(self._looks))
        cancel = QPushButton(self.tr("Cancel"))
        cancel.setAccessibleName(self.tr("Cancel"))
        self.setCancelButton(cancel)
        self.canceled.connect(self.end)

    def begin(self) -> None:
        self._since.start()
        self._next()

    def take(self, picture: Picture) -> None:
        """A picture was drawn; any but the finished one that was asked for is passed over."""
        if self._over or picture.look.number != self._wanted or not picture.last:
            return
        self._wanted = -1
        self._background.ask("film", lambda: self._film.add(picture), lambda _: self._added(), self.end)

    def end(self, trouble: Trouble | None = None) -> None:
        """Stop, and leave nothing behind."""
        if not self._over:
            self._over = True
            self._background.ask(
                "film",
                self._film.drop,
                lambda _: self._leave(trouble),
                lambda refused: self._leave(trouble or refused),
            )

    def _added(self) -> None:
        self._done += 1
        if self._done < len(self._looks):
            self._next()
        else:
            self._background.ask("film", self._film.finish, lambda _: self._finish(), self.end)

    def _next(self) -> None:
        self.setValue(self._done)
        told = self.tr("Picture {0} of {1}").format(self._done + 1, len(self._looks))
        if self._done:
            left = self._since.elapsed() / 1000 / self._done * (len(self._looks) - self._done)
            told = self.tr("{0}, {1} left").format(told, told_seconds(left))
        self.setLabelText(told)
        self._wanted = self._ask(*self._looks[self._done])

    def _finish(self) -> None:
        self._over = True
        self.saved.emit()
        self._leave(None)

    def _leave(self, trouble: Trouble | None) -> None:
        self.hide()
        self.ended.emit(trouble)
        self.deleteLater()
