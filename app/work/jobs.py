"""Long work in a child process, seen from the window's side: start it, watch it, cancel it.

The child is `python -m app.work.worker TASK REQUEST` (`REQUEST` is JSON). It speaks JSON lines: events on its stdout
(`stage`, `progress`, `stage_done`, `place`, `log`, `data`, and last of all `done`, `failed` or `cancelled`), commands on
its stdin (`cancel`, and what the task knows). It ends when its stdin closes, so nothing outlives the window.
Listeners are called in reader threads; `app/views/bridge.py` brings them to the window's.
"""

import enum
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from app.state import join

Event = Mapping[str, Any]

PATIENCE_S = 15.0  # after a cancel; stages are finished by one rename, so ending one at any moment is safe
EXIT_S = 5.0  # for a child that said its last word
TAIL_LINES = 200  # of stderr, kept for the details of a failure
ETA_AFTER_S = 1.0
ETA_FROM = 0.02


class JobState(enum.Enum):
    """Where a job stands."""

    QUEUED = "queued"
    RUNNING = "running"
    CANCELLING = "cancelling"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class JobStatus:
    """One moment of a job."""

    name: str
    state: JobState = JobState.QUEUED
    stage: str = ""
    stage_number: int = 0  # of the stages that run in this job, from 1
    stages: int = 0
    fraction: float = 0.0  # of the stage, 0 to 1
    note: str = ""
    place: str = ""  # where on a cluster it is, or what it waits for; "" on this machine
    eta_s: float | None = None  # of the stage, at its present pace; None: not known yet
    message: str = ""  # of a failure: one line, "cause; remedy"
    details: str = ""  # of a failure: traceback, or the tail of stderr
    result: Mapping[str, Any] = field(default_factory=dict)  # what the task gave back
    code: int | None = None  # the child's exit code, minus a signal's number where one killed it

    @property
    def active(self) -> bool:
        return self.state in (JobState.RUNNING, JobState.CANCELLING)

    @property
    def ended(self) -> bool:
        return self.state in (JobState.DONE, JobState.FAILED, JobState.CANCELLED)


def child_command(task: str, request: Mapping[str, Any]) -> list[str]:
    """What starts a worker; -P keeps a file `app.py` of the working directory out of it."""
    return [sys.executable, "-P", "-u", "-m", "app.work.worker", task, json.dumps(dict(request))]


class Job:
    """One run of one task. Every method may be called from any thread and returns at once, `wait` excepted."""

    def __init__(
        self,
        name: str,
        task: str,
        request: Mapping[str, Any],
        patience_s: float | None = PATIENCE_S,
        clock: Callable[[], float] = time.monotonic,
        command: Callable[[str, Mapping[str, Any]], Sequence[str]] = child_command,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """
        Args:
            name: what a person calls this run.
            patience_s: how long a cancelled child may take to end; None: as long as it wants.
            environment: variables of the child; None: those of this process.
        """
        self.task, self.request = task, dict(request)
        self._status = JobStatus(name)
        self._patience_s, self._clock, self._command = patience_s, clock, command
        self._environment = environment
        self._lock = threading.RLock()
        self._news: deque[JobStatus] = deque()
        self._telling = False
        self._listeners: list[Callable[[JobStatus], None]] = []
        self._event_listeners: list[Callable[[Event], None]] = []
        self._child: subprocess.Popen[bytes] | None = None
        self._ended = threading.Event()
        self._tail: deque[str] = deque(maxlen=TAIL_LINES)
        self._stage_start = 0.0  # of a task that tells no stages: when its child began
        self._killer: threading.Timer | None = None

    @property
    def status(self) -> JobStatus:
        return self._status

    def listen(self, listener: Callable[[JobStatus], None]) -> Callable[[], None]:
        """Tell `listener` of every later status; returns what ends that."""
        return join(self._listeners, listener)

    def listen_events(self, listener: Callable[[Event], None]) -> Callable[[], None]:
        """Tell `listener` of every event of the child as it came, before the status that follows from it."""
        return join(self._event_listeners, listener)

    def start(self) -> None:
        """Start the child; does nothing for a job that was started or cancelled before."""
        with self._lock:
            if self._status.state is not JobState.QUEUED or self._child is not None:
                return
            root = str(Path(__file__).resolve().parents[2])
            variables = os.environ if self._environment is None else self._environment
            path = os.pathsep.join([root, *filter(None, [variables.get("PYTHONPATH")])])
            try:
                self._child = subprocess.Popen(
                    self._command(self.task, self.request),
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    env={**variables, "PYTHONPATH": path},
                    # Ctrl-C in the terminal is for the window, which then ends its children in order.
                    start_new_session=True,
                )
            except OSError as error:
                self._end(
                    JobState.FAILED,
                    f"the worker could not be started ({error}); free some memory and try again",
                )
            else:
                assert self._child.stdin is not None
                os.set_blocking(self._child.stdin.fileno(), False)
                self._stage_start = self._clock()
                self._change(state=JobState.RUNNING)
                threading.Thread(target=self._read, name=f"job {self.status.name}", daemon=True).start()
        self._tell()

    def send(self, command: str, **facts: Any) -> None:
        """Give the child a command; nothing where it has ended."""
        with self._lock:
            if self._child is None or self._child.stdin is None or self._status.ended:
                return
            line = json.dumps({"command": command, **facts}).encode() + b"\n"
            try:
                written = os.write(self._child.stdin.fileno(), line)
            except BlockingIOError:
                written = 0
            except (OSError, ValueError):
                return  # it is ending; the reader will say how
            if written < len(line):
                # The pipe holds 64 kB: a child that read none of it hangs.
                self.kill()

    def cancel(self) -> None:
        """Ask the job to end; a child that does not within its patience is killed."""
        with self._lock:
            if self._status.state is JobState.QUEUED:
                self._end(JobState.CANCELLED)
            elif self._status.state is JobState.RUNNING:
                self._change(state=JobState.CANCELLING)
                self.send("cancel")
                if self._patience_s is not None:
                    self._killer = threading.Timer(self._patience_s, self.kill)
                    self._killer.daemon = True
                    self._killer.start()
        self._tell()

    def kill(self) -> None:
        """End the child now."""
        with self._lock:
            if self._child is not None and self._child.poll() is None:
                self._child.kill()

    def wait(self, timeout_s: float | None = None) -> JobStatus:
        """Block until the job ended (or the time is over); never in the window's thread."""
        self._ended.wait(timeout_s)
        return self._status

    def _read(self) -> None:
        child = self._child
        assert child is not None
        assert child.stdout is not None
        errors = threading.Thread(target=self._read_errors, daemon=True)
        errors.start()
        last: Event | None = None
        for line in child.stdout:
            event = _event(line)
            if event is None:
                self._tail.append(line.decode(errors="replace").rstrip())
                continue
            for listener in tuple(self._event_listeners):
                listener(event)
            if event["event"] in ("done", "failed", "cancelled"):
                last = event
            else:
                self._take(event)
        try:
            code = child.wait(EXIT_S)
        except subprocess.TimeoutExpired:
            child.kill()
            code = child.wait()
        errors.join(EXIT_S)
        self._conclude(last, code)
        for pipe in (child.stdin, child.stdout, child.stderr):
            if pipe is not None:
                pipe.close()

    def _read_errors(self) -> None:
        assert self._child is not None
        assert self._child.stderr is not None
        for line in self._child.stderr:
            text = line.decode(errors="replace").rstrip()
            self._tail.append(text)
            for listener in tuple(self._event_listeners):
                listener({"event": "log", "text": text, "stderr": True})

    def _take(self, event: Event) -> None:
        with self._lock:
            if event["event"] == "stage":
                self._stage_start = self._clock()
                self._change(
                    stage=str(event["name"]), stage_number=event.get("number", 0), stages=event.get("count", 0),
                    fraction=0.0, note="", eta_s=None,
                )  # fmt: skip
            elif event["event"] == "progress":
                fraction, passed = float(event["fraction"]), self._clock() - self._stage_start
                known = fraction >= ETA_FROM and passed >= ETA_AFTER_S
                eta_s = passed * (1 - fraction) / fraction if known else None
                eta_s = event.get("left_s", eta_s)  # a task that knows it better says so
                self._change(fraction=fraction, note=str(event.get("note", "")), eta_s=eta_s)
            elif event["event"] == "stage_done":
                self._change(fraction=1.0, note="", eta_s=0.0)
            elif event["event"] == "place":
                self._change(place=str(event["text"]))
        self._tell()

    def _conclude(self, last: Event | None, code: int) -> None:
        with self._lock:
            self._status = replace(self._status, code=code)  # told with the end, not before it
        if last is None:
            if self._status.state is JobState.CANCELLING:
                self._end(JobState.CANCELLED)
            else:
                self._end(JobState.FAILED, _told_exit(code), "\n".join(self._tail))
        elif last["event"] == "failed":
            details = str(last.get("details") or "\n".join(self._tail))
            self._end(JobState.FAILED, str(last["message"]), details)
        elif last["event"] == "cancelled":
            self._end(JobState.CANCELLED)
        else:
            self._end(JobState.DONE, result=last.get("result") or {})
        self._tell()

    def _end(
        self, state: JobState, message: str = "", details: str = "", result: Mapping[str, Any] | None = None
    ) -> None:
        with self._lock:
            if self._killer is not None:
                self._killer.cancel()
            self._change(state=state, message=message, details=details, result=result or {}, eta_s=None)

    def _change(self, **facts: Any) -> None:
        """Under the lock; `_tell` follows, without it."""
        status = replace(self._status, **facts)
        if status != self._status:
            self._status = status
            self._news.append(status)

    def _tell(self) -> None:
        """Tell the listeners what changed, in order and with no lock held: they may use jobs and queues."""
        while True:
            with self._lock:
                if self._telling or not self._news:
                    return
                self._telling = True
                status = self._news.popleft()
            try:
                for listener in tuple(self._listeners):
                    listener(status)
            finally:
                self._telling = False
            if status.ended:
                self._ended.set()


def _event(line: bytes) -> Event | None:
    """The event of a line; None for what a library printed past us."""
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) and isinstance(event.get("event"), str) else None


def _told_exit(code: int) -> str:
    if code == -signal.SIGKILL:
        return (
            "the worker was killed by the system, most likely because memory ran out; close other programs, or"
            " process with the draft preset"
        )
    if code < 0:
        return f"the worker crashed ({signal.Signals(-code).name}); run it again, and send the details if it repeats"
    return f"the worker ended without a word (exit code {code}); run it again, and send the details if it repeats"
