"""A worker child: `python -m app.work.worker TASK REQUEST` does one task and speaks JSON lines with the window.

Events go to stdout, commands come from stdin (app/work/jobs.py says which). What libraries print lands on stderr. The
child ends when stdin closes: the task is asked to stop, and does not outlive GRACE_S.
"""

import importlib
import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from app import cores
from app.exit_codes import ExitCode, code_of
from app.settings import Settings
from engine.errors import Cancelled, RoomlightError
from engine.progress import Progress
from hardware.errors import HardwareError

# Task -> where it is: a function of the request and the link; what it returns goes with `done`.
TASKS = {
    "process": "app.work.tasks:process",
    "import": "app.work.tasks:import_photographs",
    "simulate": "app.work.tasks:simulate",
    "demo": "app.work.tasks:demo",
    "export": "app.work.tasks:export",
    "report": "app.work.tasks:report",
    "desk": "app.capture.desk.serving:serve",
    "answers": "app.work.answers:serve",
    "rerender": "app.inspect.rerendering:serve",
    "coverage": "app.relight.coverage:serve",
    "relight": "app.relight.transfer:serve",
    "relit": "app.relight.pictures:serve",
    "panorama": "app.relight.sources:serve_panorama",
}

PROMPT = {"answers"}
"""What the window waits for; every other task stands back for the window."""

GRACE_S = 10.0
PROGRESS_EVERY_S = 0.05
MOST_EARLY = 1000
ORPHANED = 3  # exit code
UNATTENDED = "--unattended"
"""No window is near: the child stands back for nobody, and dies with the thread that started it."""

Task = Callable[[Mapping[str, Any], "Link"], Mapping[str, Any] | None]


class Link:
    """The child's end: emits events, hears commands. Thread-safe."""

    def __init__(self, out: int, clock: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            out: file descriptor that events are written to.
        """
        self._out, self._clock = out, clock
        self._lock, self._hearing = threading.Lock(), threading.RLock()
        self._hears: dict[str, Callable[[Mapping[str, Any]], None]] = {}
        self._early: list[Mapping[str, Any]] = []  # came before the task was there to hear them
        self._asked_to_stop = threading.Event()
        self._told_at = -PROGRESS_EVERY_S

    def emit(self, event: str, **facts: Any) -> None:
        """Write one event; `facts` are what JSON knows."""
        line = memoryview(json.dumps({"event": event, **facts}).encode() + b"\n")
        with self._lock:
            try:
                while line:
                    line = line[os.write(self._out, line) :]
            except OSError:
                # The window is gone; stdin closes too and ends the task.
                self._asked_to_stop.set()

    def log(self, text: str) -> None:
        self.emit("log", text=text)

    def move(self, fraction: float, note: str = "") -> None:
        """A progress event, at most some twenty a second."""
        now = self._clock()
        if fraction >= 1 or now - self._told_at >= PROGRESS_EVERY_S:
            self._told_at = now
            self.emit("progress", fraction=round(float(fraction), 4), note=note)

    def cancelled(self) -> bool:
        return self._asked_to_stop.is_set()

    def progress(self) -> Progress:
        """What engine functions take: moves the bar, raises Cancelled once a stop was asked for."""
        return Progress(self.move, self.cancelled)

    def hear(self, command: str, handler: Callable[[Mapping[str, Any]], None]) -> None:
        """Call `handler` with each `command`, those that came before it included, one at a time.

        "gone" is heard when the window is gone.
        """
        with self._hearing:
            self._hears[command] = handler
            early = [content for content in self._early if content["command"] == command]
            self._early = [content for content in self._early if content["command"] != command]
            for content in early:
                handler(content)

    def take(self, line: bytes) -> None:
        """One line from the window."""
        try:
            content = json.loads(line)
            command = content["command"]
        except (ValueError, KeyError, TypeError):
            self.log(f"not understood: {line[:200]!r}")
            return
        if command == "cancel":
            self._asked_to_stop.set()
        self._pass_on(content)

    def end(self) -> None:
        """The window is gone: stop."""
        self._asked_to_stop.set()
        self._pass_on({"command": "gone"})

    def _pass_on(self, content: Mapping[str, Any]) -> None:
        with self._hearing:
            handler = self._hears.get(content["command"])
            if handler is not None:
                handler(content)
            else:
                self._early = [*self._early, content][-MOST_EARLY:]


def listen(
    link: Link, source: int, leave: Callable[[int], None] = os._exit, grace_s: float = GRACE_S
) -> None:
    """Read commands until the window closes its end, then see to it that this process ends too."""
    rest = b""
    # A raw read: a thread inside a buffered reader would keep the interpreter from ending in order.
    while block := os.read(source, 65536):
        *lines, rest = (rest + block).split(b"\n")
        for line in lines:
            link.take(line)
    timer = threading.Timer(grace_s, leave, [ORPHANED])
    timer.daemon = True
    timer.start()
    link.end()


def perform(task: Task, request: Mapping[str, Any], link: Link) -> int:
    """Run one task; the last event says how it ended. Returns the exit code."""
    try:
        result = task(request, link)
    except Cancelled:
        link.emit("cancelled")
        return ExitCode.STOPPED
    except (RoomlightError, HardwareError) as error:
        link.emit(
            "failed", message=" ".join(str(error).split()), details=traceback.format_exc(), expected=True
        )
        return code_of(error)
    except MemoryError:
        link.emit(
            "failed",
            message="memory ran out; close other programs, or process with the draft preset",
            details=traceback.format_exc(),
        )
        return ExitCode.REFUSED
    except Exception as error:
        link.emit(
            "failed",
            message=f"a fault in Roomlight itself ({type(error).__name__}: {error}); run it again, and send the"
            " details if it repeats",
            details=traceback.format_exc(),
        )
        return ExitCode.FAULT
    link.emit("done", result=dict(result or {}))
    return ExitCode.DONE


def find(name: str) -> Task:
    module, _, function = TASKS[name].partition(":")
    return getattr(importlib.import_module(module), function)


def main(argv: Sequence[str]) -> int:
    name, request, *options = argv
    if UNATTENDED in options:
        cores.die_with_starter()
    cores.hold_to(Settings().value.cores)
    cores.prepare()
    out = os.dup(1)
    os.dup2(2, 1)
    sys.stdout = sys.stderr
    link = Link(out)
    threading.Thread(target=listen, args=(link, 0), name="commands", daemon=True).start()

    def work(request: Mapping[str, Any], link: Link) -> Mapping[str, Any] | None:
        return find(name)(request, link)

    asked = json.loads(request)
    watches = "scheduler" in asked  # what a cluster does, and works itself on nothing
    if not (UNATTENDED in options or watches or name in PROMPT):
        # This thread alone: the one that hears a stop does not wait.
        cores.stand_back()
    code = perform(work, asked, link)
    os.close(out)
    return code


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stderr.flush()
    # What was asked is done and told; the farewells of large libraries take seconds, and some crash.
    os._exit(code)
