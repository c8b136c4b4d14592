"""Look at every shot beside the capture, in a thread of its own, so that looking never delays the next pose."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from app.capture.status import Finding
from engine.capture_checks.finding import Severity
from engine.errors import RoomlightError
from engine.io.session import Shot

# Called once with each shot of a session, one after the other in the order they were taken, an earlier run's
# first; returns what a person should hear about it.
Watch = Callable[[Shot], Sequence[Finding]]


class Watcher:
    """Shots in, findings out; `collect` and `drain` re-raise a bug in the watch itself."""

    def __init__(self, watch: Watch | None) -> None:
        self._watch = watch
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="watch")
        self._waiting: deque[Future[Sequence[Finding]]] = deque()

    def show(self, shot: Shot) -> None:
        """Queue a shot."""
        if self._watch is not None:
            self._waiting.append(self._pool.submit(self._look, self._watch, shot))

    @staticmethod
    def _look(watch: Watch, shot: Shot) -> Sequence[Finding]:
        try:
            return watch(shot)
        except RoomlightError as error:
            return (Finding(shot.name, f"could not be looked at: {error}", Severity.WARNING),)

    def collect(self) -> tuple[Finding, ...]:
        """What was found since the last call, without waiting."""
        found: list[Finding] = []
        while self._waiting and self._waiting[0].done():
            found += self._waiting.popleft().result()
        return tuple(found)

    def drain(self, wait: Callable[[float], None]) -> tuple[Finding, ...]:
        """Wait for everything that was shown; `wait` lets a little time pass and may raise to give up."""
        found: list[Finding] = []
        while self._waiting:
            if self._waiting[0].done():
                found += self._waiting.popleft().result()
            else:
                wait(0.05)
        return tuple(found)

    def close(self) -> None:
        """Give up what waits; the look under way is finished first."""
        self._pool.shutdown(cancel_futures=True)
