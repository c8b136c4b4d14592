"""All jobs there are: those that run at once, and a queue of which one runs after the other here, and some at once on a cluster.

Any thread may call; listeners are told, without arguments, that something changed (a job came, went, moved, began
or ended), in whatever thread changed it.
"""

import threading
from collections.abc import Callable

from app.state import join
from app.work.jobs import Job, JobState, JobStatus

CLUSTER_JOBS = 8
"""Jobs of the queue that are on a cluster at once: each costs this machine a child that watches."""


class Board:
    """Jobs by what becomes of them: running, waiting, ended."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._queue: list[Job] = []  # waiting, running and ended, in order
        self._beside: dict[Job, Callable[[], None]] = {}  # running outside of the queue; what ends listening
        self._held = False
        self._listeners: list[Callable[[], None]] = []

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Tell of every later change; returns what ends that."""
        return join(self._listeners, listener)

    @property
    def queue(self) -> tuple[Job, ...]:
        """Ended, running and waiting jobs of the queue, in the order they run."""
        with self._lock:
            return tuple(self._queue)

    @property
    def waiting(self) -> tuple[Job, ...]:
        return tuple(job for job in self.queue if job.status.state is JobState.QUEUED)

    @property
    def active(self) -> tuple[Job, ...]:
        """Everything that runs, in the queue or beside it."""
        with self._lock:
            return tuple(job for job in (*self._beside, *self._queue) if job.status.active)

    @property
    def held(self) -> bool:
        """Whether the queue starts nothing further."""
        return self._held

    def start(self, job: Job) -> None:
        """Run beside the queue, at once; one that runs already is counted from now on."""
        with self._lock:
            if job not in self._beside:
                self._beside[job] = job.listen(self._heard(job))
        job.start()
        self._tell()

    def leave(self, job: Job) -> None:
        """Count a job beside the queue no longer, though it runs on: what it was wanted for is done."""
        with self._lock:
            unheard = self._beside.pop(job, None)
        if unheard is not None:
            unheard()
            self._tell()

    def enqueue(self, job: Job) -> None:
        """Run when everything before it in the queue has ended, on a cluster when it has room."""
        with self._lock:
            self._queue.append(job)
        job.listen(self._heard(job))
        self._next()
        self._tell()

    def move(self, job: Job, to: int) -> None:
        """Let a waiting job run as number `to` (from 0) of those that wait."""
        with self._lock:
            waiting = [other for other in self.waiting if other is not job]
            if job not in self._queue or job.status.state is not JobState.QUEUED:
                return
            waiting.insert(max(0, min(to, len(waiting))), job)
            begun = [other for other in self._queue if other.status.state is not JobState.QUEUED]
            self._queue = begun + waiting
        self._tell()

    def remove(self, job: Job) -> None:
        """Take a job that does not run off the queue."""
        with self._lock:
            if job not in self._queue or job.status.active:
                return
            self._queue.remove(job)
        job.cancel()
        self._tell()

    def clear_ended(self) -> None:
        with self._lock:
            self._queue = [job for job in self._queue if not job.status.ended]
        self._tell()

    def hold(self, held: bool) -> None:
        """Hold the queue, so that nothing further starts, or let it go on."""
        self._held = held
        self._next()
        self._tell()

    def cancel_all(self) -> None:
        """End everything: what waits stays in the queue, held; what runs is asked to stop."""
        self._held = True
        for job in self.active:
            job.cancel()
        self._tell()

    def kill_all(self) -> None:
        for job in self.active:
            job.kill()

    def _heard(self, job: Job) -> Callable[[JobStatus], None]:
        last = job.status.state

        def hear(status: JobStatus) -> None:
            nonlocal last
            if status.state is last:
                return
            last = status.state
            if status.ended:
                with self._lock:
                    self._beside.pop(job, None)
                self._next()
            self._tell()

        return hear

    def _next(self) -> None:
        with self._lock:
            for job in self.waiting:
                beside = [
                    other
                    for other in self._queue
                    if other.status.active and on_cluster(other) == on_cluster(job)
                ]
                if not self._held and len(beside) < (CLUSTER_JOBS if on_cluster(job) else 1):
                    job.start()

    def _tell(self) -> None:
        for listener in tuple(self._listeners):
            listener()


def on_cluster(job: Job) -> bool:
    """Whether a cluster does it."""
    return bool(job.request.get("scheduler"))
