"""Quick questions to the engine, asked of a child that stays: the window loads none of the engine's rooms itself.

The child is started by the first question and again by the next one after it died. Answers arrive in a reader
thread.
"""

import itertools
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from app.state import Trouble, trouble
from app.work.jobs import Event, Job, JobState, JobStatus


@dataclass(frozen=True, slots=True)
class Answer:
    """What came back: content, or the trouble with it."""

    content: Mapping[str, Any] | None
    trouble: Trouble | None = None


Then = Callable[[Answer], None]


class Enquiries:
    """Asks; every question is answered once, if only by the child's end."""

    def __init__(
        self, make: Callable[[], Job] = lambda: Job("answers", "answers", {}, patience_s=2.0)
    ) -> None:
        self._make = make
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._open: dict[int, Then] = {}
        self._job: Job | None = None
        self._closed = False

    def ask(self, question: str, then: Then, **facts: Any) -> int:
        """Ask; returns the question's number. `then` is called in another thread, or here if nobody can answer."""
        number = next(self._numbers)
        with self._lock:
            if self._closed:
                return number
            self._open[number] = then
            if self._job is None or self._job.status.ended:
                self._job = self._make()
                self._job.listen_events(self._hear)
                self._job.listen(self._heard_of(self._job))
                fresh = self._job
            else:
                fresh = None
            job = self._job
        if fresh is not None:
            fresh.start()
        job.send("ask", id=number, question=question, **facts)
        if job.status.ended:
            self._give_up(job.status)
        return number

    def close(self) -> None:
        """Answer nothing more, and let the child go."""
        with self._lock:
            self._closed = True
            self._open.clear()
            job = self._job
        if job is not None:
            job.cancel()

    def _hear(self, event: Event) -> None:
        if event["event"] != "data" or event.get("kind") != "answer":
            return
        with self._lock:
            then = self._open.pop(int(event["id"]), None)
        if then is None:
            return
        if "fault" in event:
            then(Answer(None, trouble(str(event["fault"]), str(event.get("details", "")))))
        else:
            then(Answer(event["answer"]))

    def _heard_of(self, job: Job) -> Callable[[JobStatus], None]:
        def hear(status: JobStatus) -> None:
            if status.ended and job is self._job:
                self._give_up(status)

        return hear

    def _give_up(self, status: JobStatus) -> None:
        with self._lock:
            waiting, self._open = list(self._open.values()), {}
        told = (
            trouble(status.message, status.details)
            if status.state is JobState.FAILED
            else Trouble("the child that answers questions has ended", "ask again")
        )
        for then in waiting:
            then(Answer(None, told))
