"""Run a capture in the terminal: a bar, what a person should see as lines, and Ctrl-C.

The capture runs in a thread of its own, so that Ctrl-C is heard while a device is waited for: once, it ends after the
exposure under way and the rig stops; twice, everything stops at once, as on SIGTERM and SIGHUP.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from queue import Empty, SimpleQueue
from types import FrameType

from rich.console import Console

from app.capture.order import CaptureError
from app.capture.run import Capture
from app.capture.status import Finding, Missing, Outcome, Phase, Status
from app.terminal import Display
from engine.capture_checks.finding import Severity
from engine.errors import RoomlightError
from hardware.errors import HardwareError

PATIENCE_S = 10.0  # for devices to hear a stop; then the program ends all the same
POLL_S = 0.5
TOLD_MISSING = 5


def resume_with(folder: Path) -> str:
    return f"`roomlight capture --resume {folder}`"


class Screen:
    """Hears a capture's statuses and a device's progress in any thread, shows them in the one that calls `show`."""

    def __init__(self) -> None:
        self._news: SimpleQueue[Status | str | signal.Signals | None] = SimpleQueue()
        self._findings = self._missing = 0

    def heard(self, status: Status) -> None:
        """The capture's listener."""
        self._news.put(status)

    def progress(self, fraction: float, note: str) -> None:
        """A device that takes long says how far it is, as a virtual room that is baked."""
        self._news.put(f"{note}, {fraction:.0%}")

    def run(self, capture: Capture, folder: Path) -> Outcome:
        """Run it to its end.

        Raises:
            CaptureError: as `Capture.run`, saying also how to go on where there is something to go on with.
            RoomlightError, HardwareError: why it did not start.
        """
        ended: list[Outcome | BaseException] = []

        def work() -> None:
            try:
                ended.append(capture.run())
            except BaseException as error:
                ended.append(error)
            self._news.put(None)

        thread = threading.Thread(target=work, name="capture", daemon=True)
        with self._signals(), Display(Console()) as display:
            display.begin("capture")
            thread.start()
            self._show(capture, display)
            thread.join(POLL_S)
        if not ended:
            raise CaptureError(
                f"{folder}: a device does not hear the stop; switch it off, then go on with {resume_with(folder)}"
            )
        result = ended[0]
        if isinstance(result, Outcome):
            return result
        kept = capture.status.taken
        if isinstance(result, RoomlightError | HardwareError) and (kept or capture.began):
            raise CaptureError(
                f"{result}; {kept} of {capture.status.total} poses are kept: go on with {resume_with(folder)}"
            ) from result
        raise result

    def _show(self, capture: Capture, display: Display) -> None:
        """Until the capture ended, or does not hear that it should."""
        asked = 0
        left_s = PATIENCE_S
        while left_s > 0:
            try:
                news = self._news.get(timeout=POLL_S)
            except Empty:
                left_s -= POLL_S if asked > 1 else 0.0
                continue
            match news:
                case None:
                    break
                case Status():
                    self._tell(news, display)
                case str():
                    display.move(_share(capture.status), news)
                case _:
                    asked += 1 if news is signal.SIGINT else 2
                    self._obey(capture, display, asked)

    def _obey(self, capture: Capture, display: Display, asked: int) -> None:
        stop, told = (
            (capture.control.cancel, "stopping after this exposure; Ctrl-C again stops at once")
            if asked == 1
            else (capture.control.stop, "stopping at once")
        )
        try:
            stop()
        except HardwareError as error:
            told = f"THE STOP DID NOT REACH THE RIG: {error}"
        display.say(told)

    def _tell(self, status: Status, display: Display) -> None:
        for finding in status.findings[self._findings :]:
            display.say(_finding(finding))
        self._findings = max(self._findings, len(status.findings))
        for item in status.missing[self._missing :]:
            display.say(f"{item.pose.name} is left for the end: {item.reason}")
        self._missing = len(status.missing)
        if status.phase is not Phase.ENDED:
            display.move(_share(status), _note(status))

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        def hear(number: int, frame: FrameType | None) -> None:
            self._news.put(signal.Signals(number))  # SimpleQueue may be filled from a signal handler

        numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
        numbers = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]  # nohup
        before = [(number, signal.signal(number, hear)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)


def _finding(finding: Finding) -> str:
    """One line; nobody may be there to decide, so that a capture in the terminal goes on whatever was found."""
    urgent = "STOP: " if finding.severity is Severity.STOP else ""
    return f"{urgent}{finding.pose}: {finding.text}" if finding.pose else f"{urgent}{finding.text}"


def _share(status: Status) -> float:
    return status.taken / max(status.total, 1)


def _note(status: Status) -> str:
    words = [f"{status.taken} of {status.total}"]
    if status.pose is not None:
        words.append(f"{status.pose.name} {status.pose.label}".strip())
    return ", ".join([*words, status.phase.value, *([status.message] if status.message else [])])


def told_missing(missing: tuple[Missing, ...], total: int, folder: Path) -> str:
    """Which poses are missing and why, in one line."""
    told = "; ".join(f"{item.pose.name}: {item.reason}" for item in missing[:TOLD_MISSING])
    more = f"; and {len(missing) - TOLD_MISSING} more" if len(missing) > TOLD_MISSING else ""
    return (
        f"{len(missing)} of {total} poses are missing ({told}{more}); {resume_with(folder)} tries them again"
    )
