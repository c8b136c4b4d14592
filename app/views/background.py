"""Reading and drawing off the window's thread: questions with a key, of which only the newest is answered.

One thread a page: its pictures come one after the other, and the window's thread keeps the other core. Faults the
house foresees go to `failed`; any other is raised again in the window's thread, where crashes are told.
"""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from PySide6.QtCore import QObject

from app.state import Trouble, trouble
from app.views.bridge import Bridge
from engine.errors import RoomlightError

Answer = TypeVar("Answer")


class Background:
    """A thread that works for a page and ends with it."""

    def __init__(self, parent: QObject, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._bridge = Bridge(parent)
        self._newest: dict[str, Future[Any]] = {}
        pool = self._pool
        parent.destroyed.connect(lambda: pool.shutdown(wait=False, cancel_futures=True))

    @property
    def busy(self) -> bool:
        """Whether a question waits for its answer."""
        return bool(self._newest)

    def ask(
        self,
        key: str,
        work: Callable[[], Answer],
        done: Callable[[Answer], None],
        failed: Callable[[Trouble], None] = lambda fault: None,
    ) -> None:
        """Do `work` in the thread, then `done` with its answer in the window's, unless `key` was asked again."""
        self.drop(key)
        future = self._pool.submit(work)
        self._newest[key] = future

        def arrive() -> None:
            if self._newest.get(key) is not future:
                return
            del self._newest[key]
            error = future.exception()
            if error is None:
                done(future.result())
            elif isinstance(error, RoomlightError | OSError):
                failed(trouble(str(error)))
            else:
                raise error

        future.add_done_callback(lambda ended: None if ended.cancelled() else self._bridge.queued(arrive)())

    def drop(self, key: str) -> None:
        """Nobody wants this answer any more."""
        older = self._newest.pop(key, None)
        if older is not None:
            older.cancel()
