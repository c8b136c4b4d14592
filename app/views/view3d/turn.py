"""Takes the eye of the 3D view from one place to another, by a short way that a person can follow."""

from PySide6.QtCore import QElapsedTimer, QObject, QTimer, Signal

from app.viewer import orbit
from app.viewer.orbit import Orbit

FRAME_MS = 15


class Turn(QObject):
    """One way at a time; a new one begins where the last was."""

    passed = Signal(object)  # Orbit, on the way
    arrived = Signal(object)  # Orbit, at its end

    def __init__(self, parent: QObject, milliseconds: int) -> None:
        super().__init__(parent)
        self.milliseconds = milliseconds  # 0: at once
        self._way: tuple[Orbit, Orbit] | None = None
        self._since = QElapsedTimer()
        self._timer = QTimer(self)
        self._timer.setInterval(FRAME_MS)
        self._timer.timeout.connect(self._step)

    def go(self, start: Orbit, goal: Orbit) -> None:
        if self.milliseconds <= 0:
            self.stop()
            self.arrived.emit(goal)
            return
        self._way = start, goal
        self._since.start()
        self._timer.start()

    def stop(self) -> None:
        """Stay where the eye is."""
        self._timer.stop()
        self._way = None

    def _step(self) -> None:
        if self._way is None:
            return
        start, goal = self._way
        share = min(self._since.elapsed() / self.milliseconds, 1.0)
        if share >= 1:
            self.stop()
            self.arrived.emit(goal)
        else:
            self.passed.emit(orbit.between(start, goal, share * share * (3 - 2 * share)))
