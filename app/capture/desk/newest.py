"""A thread that does the newest of what it is given, kind by kind: who gives never waits, and nothing piles up."""

import threading
from collections.abc import Callable


class Newest:
    """Calls wait one of a kind; a newer one takes the place of one that was not begun."""

    def __init__(self, name: str, pause_s: float = 0.0) -> None:
        """
        Args:
            pause_s: after each call, so that there are at most so many.
        """
        self._pause_s = pause_s
        self._changed = threading.Condition()
        self._waiting: dict[str, Callable[[], None]] = {}
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, kind: str, call: Callable[[], None]) -> None:
        """Nothing after `close`."""
        with self._changed:
            if not self._closing:
                self._waiting[kind] = call
                self._changed.notify_all()

    def close(self) -> None:
        """Do what waits, without pauses, and end; not to be called by a call."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while (call := self._next()) is not None:
            call()
            with self._changed:
                self._changed.wait_for(lambda: self._closing, timeout=self._pause_s)

    def _next(self) -> Callable[[], None] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closing)
            if not self._waiting:
                return None
            kind = next(iter(self._waiting))
            return self._waiting.pop(kind)
