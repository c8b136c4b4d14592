"""From any thread into the window's: calls arrive there in order, in its event loop, and never block the caller."""

import threading
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, Qt, Signal, Slot


class Bridge(QObject):
    """Wraps a method of a widget so that reader threads may call it; ends with its parent."""

    _arrived = Signal(object)

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._open = True
        self._arrived.connect(self._run, Qt.ConnectionType.QueuedConnection)
        # Runs while the parent is being taken down, when its children still are whole.
        parent.destroyed.connect(self._shut)

    def queued(self, call: Callable[..., None]) -> Callable[..., None]:
        """`call`, made in the window's thread with the same arguments, each time."""

        def send(*args: Any) -> None:
            self._send(lambda: call(*args))

        return send

    def latest(self, call: Callable[..., None]) -> Callable[..., None]:
        """As `queued`, but only the newest of the calls that are waiting is made: for progress and other states."""
        lock = threading.Lock()
        newest: list[tuple[Any, ...]] = []

        def take() -> None:
            with lock:
                args = newest.pop()
                newest.clear()
            call(*args)

        def send(*args: Any) -> None:
            with lock:
                waiting = bool(newest)
                newest.append(args)
            if not waiting:
                self._send(take)

        return send

    def close(self) -> None:
        """Let nothing more arrive."""
        self._open = False

    def _send(self, call: Callable[[], None]) -> None:
        if not self._open:
            return
        try:
            self._arrived.emit(call)
        except RuntimeError:
            # The window went between the question and the call; there is nobody to tell.
            self._open = False

    @Slot(object)
    def _run(self, call: Callable[[], None]) -> None:
        if self._open:
            call()

    def _shut(self) -> None:
        self._open = False
