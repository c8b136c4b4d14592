"""Children that stand in for workers: Python told on the command line, quick to start and bad on demand."""

import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

from app.work.jobs import Job, JobState, JobStatus

PROLOGUE = """
import json, os, signal, sys, time
def emit(event, **facts):
    sys.stdout.write(json.dumps({"event": event, **facts}) + "\\n"); sys.stdout.flush()
def hear():
    line = sys.stdin.readline()
    return json.loads(line) if line else None
request = json.loads(sys.argv[1])
"""


def job(
    script: str,
    name: str = "lion",
    task: str = "process",
    request: Mapping[str, Any] | None = None,
    **options: Any,
) -> Job:
    """A job whose child runs `script` after the prologue above."""
    asked = request if request is not None else {}

    def command(task: str, request: Mapping[str, Any]) -> list[str]:
        import json

        return [sys.executable, "-S", "-c", PROLOGUE + script, json.dumps(dict(request))]

    return Job(name, task, asked, command=command, **options)


# Runs until it is told to stop, like a stage that looks at its cancel now and then.
WILLING = """
emit("stage", name="hdr", number=1, count=1)
while True:
    said = hear()
    if said is None or said["command"] == "cancel":
        emit("cancelled"); break
"""

QUICK = 'emit("done", result={"ran": []})'


class Heard:
    """Every status of a job, and a way to wait for one."""

    def __init__(self, job: Job) -> None:
        self.statuses: list[JobStatus] = []
        self._changed = threading.Condition()
        job.listen(self._hear)

    def _hear(self, status: JobStatus) -> None:
        with self._changed:
            self.statuses.append(status)
            self._changed.notify_all()

    @property
    def states(self) -> list[JobState]:
        """The states, each change once."""
        seen: list[JobState] = []
        for status in self.statuses:
            if not seen or seen[-1] is not status.state:
                seen.append(status.state)
        return seen

    def wait(self, what: Callable[[JobStatus], bool], timeout_s: float = 30) -> JobStatus:
        with self._changed:
            assert self._changed.wait_for(lambda: any(map(what, self.statuses)), timeout_s), self.statuses[
                -3:
            ]
            return next(status for status in self.statuses if what(status))
