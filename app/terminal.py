"""Show work in the terminal: a bar with the time left for each stage, or plain lines without a screen."""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from types import FrameType

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import (
    Progress as Bars,
)

from engine.progress import Progress

PLAIN_EVERY_S = 10.0


class Display:
    """Bars on a terminal, lines elsewhere; `begin`, `move`, `end` one job after the other."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console, self._clock = console, clock
        self._bars = Bars(
            TextColumn("{task.description:9}"),
            BarColumn(bar_width=28),
            TextColumn("{task.percentage:3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}", style="dim"),
            console=console,
            speed_estimate_period=120,
        )
        self._task: TaskID | None = None
        self._name, self._start, self._told = "", 0.0, 0.0

    def __enter__(self) -> "Display":
        if self._console.is_terminal:
            self._bars.start()
        return self

    def __exit__(self, *fault: object) -> None:
        if self._console.is_terminal:
            self._bars.stop()

    def begin(self, name: str) -> None:
        self._name, self._start, self._told = name, self._clock(), self._clock()
        if self._console.is_terminal:
            self._task = self._bars.add_task(name, total=1.0, note="")
        else:
            self._line(f"{name}: begins")

    def move(self, fraction: float, note: str) -> None:
        if self._task is not None:
            self._bars.update(self._task, completed=fraction, note=escape(note))
        elif self._clock() - self._told >= PLAIN_EVERY_S:
            self._told = self._clock()
            passed = self._told - self._start
            left = f", about {passed * (1 - fraction) / fraction:.0f} s left" if fraction > 0.01 else ""
            self._line(f"{self._name}: {100 * fraction:.0f} %{left}{'  ' + note if note else ''}")

    def end(self, seconds: float) -> None:
        if self._task is not None:
            self._bars.update(self._task, completed=1.0, note=f"{seconds:.1f} s")
            self._task = None
        else:
            self._line(f"{self._name}: done in {seconds:.1f} s")

    def say(self, text: str) -> None:
        """A line that stays, above the bars."""
        self._line(text)

    def _line(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


@contextlib.contextmanager
def job(name: str, console: Console | None = None) -> Iterator[Progress]:
    """One named job with its own bar (on stdout unless `console` says otherwise); Ctrl-C stops it at its next step."""
    with stoppable() as cancelled, Display(console or Console()) as display:
        start = time.monotonic()
        display.begin(name)
        yield Progress(display.move, cancelled)
        display.end(time.monotonic() - start)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """What libraries in C print (LibRaw, OpenCV and OpenEXR of damaged files) goes nowhere; what Python writes is shown.

    Not for work that starts processes: their last words would be lost.
    """
    with contextlib.ExitStack() as stack:
        nowhere = stack.enter_context(open(os.devnull, "w"))
        for stream, number, redirect in (
            (sys.stdout, 1, contextlib.redirect_stdout), (sys.stderr, 2, contextlib.redirect_stderr),
        ):  # fmt: skip
            stream.flush()
            kept = os.dup(number)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, number)
            os.dup2(nowhere.fileno(), number)
            # Under a test's capture the stream is no file of the system's, and goes where it went.
            if stream in (sys.__stdout__, sys.__stderr__):
                stack.enter_context(redirect(stack.enter_context(open(kept, "w", closefd=False))))
        yield


@contextlib.contextmanager
def stoppable() -> Iterator[Callable[[], bool]]:
    """First Ctrl-C asks the work to stop at its next step; a second one interrupts it where it is."""
    asked = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        print("\nstopping at the next step; Ctrl-C again stops at once", file=sys.stderr)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)
