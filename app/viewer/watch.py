"""When a silent child counts as hung, and how often it may be started again. No threads, no processes, no clock of its own."""

from dataclasses import dataclass

READY, LOADED, FRAME, PONG = "ready", "loaded", "frame", "pong"
_SLOW = (READY, LOADED)  # while one of these is awaited, the child has no time for the rest


@dataclass(frozen=True, slots=True)
class Patience:
    """How long an answer may take, seconds."""

    ready: float = (
        60.0  # libraries from a slow disk, shaders, kernels to compile; every sign of life counts anew
    )
    loaded: float = 60.0
    frame: float = 8.0  # a picture in full on two busy cores takes less than one
    pong: float = 8.0
    restarts: int = 3
    within: float = 60.0


class Watch:
    """What the child still owes an answer to. Times are those of the caller's clock, seconds."""

    def __init__(self, patience: Patience) -> None:
        self._patience = patience
        self._owed: dict[str, float] = {}  # deadlines

    def asked(self, what: str, now: float) -> None:
        self._owed[what] = now + getattr(self._patience, what)

    def heard(self, what: str, now: float) -> None:
        """The answer came; whatever waited behind something slow has its full time from now."""
        was_slow = what in _SLOW and self._owed.pop(what, None) is not None
        self._owed.pop(what, None)
        if was_slow:
            for other in self._owed:
                self.asked(other, now)

    def lives(self, now: float) -> None:
        """It says that it is busy with something slow: whatever it owes may take as long as getting ready may."""
        for what, deadline in self._owed.items():
            self._owed[what] = max(deadline, now + self._patience.ready)

    def owes(self, what: str) -> bool:
        return what in self._owed

    def overdue(self, now: float) -> str | None:
        """What has not come in time; None while all is well."""
        slow = [what for what in _SLOW if what in self._owed]
        return next((what for what in slow or self._owed if now >= self._owed[what]), None)

    def left(self, now: float) -> float | None:
        """Seconds until something will be overdue; None when nothing is owed."""
        slow = [self._owed[what] for what in _SLOW if what in self._owed]
        deadlines = slow or list(self._owed.values())
        return max(min(deadlines) - now, 0.0) if deadlines else None


class Restarts:
    """So many within so long, then no more until a person says so."""

    def __init__(self, patience: Patience) -> None:
        self._patience = patience
        self._times: list[float] = []

    def allowed(self, now: float) -> bool:
        """Whether one more may happen; counts it if so."""
        self._times = [time for time in self._times if now - time < self._patience.within]
        if len(self._times) >= self._patience.restarts:
            return False
        self._times.append(now)
        return True

    def forgive(self) -> None:
        self._times = []
