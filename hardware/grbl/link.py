"""Talk with a GRBL controller: lines out as its buffer has room, replies in, and a stop that overtakes both.

Source: GRBL 1.1 documentation, "Interface", section "Streaming: character-counting" (128 bytes of buffer, one `ok` or
`error` a line, in order) and "Real-time Commands". One thread at a time converses; `stop` and `request` may be called
by any. What an answer means for the rig is decided by the `judge` that the caller hands in.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hardware.errors import ReplyError, StoppedError
from hardware.grbl import codes as grbl_codes
from hardware.grbl.status import Banner, Noise, Ok, Refusal, Report, parse, work_place
from hardware.grbl.status import Reply as Said
from hardware.line import Line

RX_BYTES = 128
POLL_S = 0.1  # GRBL's manual asks for no more than ten status queries a second
LOOK_S = 1.0  # a status report comes within 20 ms
REASK_S = 0.5  # a query without its report was lost, or came while the controller was deaf to it
BANNER_S = 1.0  # after a soft reset
QUIET_S = 0.5  # after the first of several start-up messages
RESETS = 3  # GRBL overhears one for 0.5 s after a limit alarm, and an Arduino boots for 2 s
IDLE_S = 1.0  # idle for longer with a line unanswered: its answer was lost
HOLD, RESET, QUERY = b"!", b"\x18", b"?"
HOME, MODES = "$H", "$G"


@dataclass(frozen=True, slots=True)
class Restarted:
    """The start-up message of a reset that we asked for; a `Banner` is one that we did not ask for."""


Reply = Said | Restarted
Judge = Callable[[Reply | None], None]  # None: nothing came; called often, raises what ends the conversation


class GrblLink:
    """An open line to a controller, and what it last said of its state."""

    def __init__(self, line: Line, clock: Callable[[], float], axes: int):
        self.line, self.port = line, line.port
        self._clock, self._axes = clock, axes
        self.firmware = grbl_codes.GRBL  # whose alarms and errors it tells
        self.unit = 1.0  # mm of one unit in reports; 25.4 with $13=1
        self.report: Report | None = None
        self.offset: tuple[float, ...] | None = None  # WCO, as last told
        self.waiting: deque[str] = deque()  # lines sent and not yet answered
        self.answered = ""  # the line that the last `ok` or `error` answered
        self.resets_due = 0  # soft resets whose start-up message has not come
        self.gate = threading.Lock()
        self.homing = False  # only a reset interrupts it
        self.hold_left = False  # a `!` was sent that nobody has cleared away
        self._stops = self._began = 0
        self._queried_s: float | None = None  # when the state was asked for, until it is told

    # -- stop

    def begin(self, homing: bool) -> None:
        """An order begins: stops from now on are meant for it."""
        with self.gate:
            self._began, self.homing = self._stops, homing

    @property
    def stopped(self) -> bool:
        return self._stops != self._began

    @property
    def stops(self) -> int:
        return self._stops

    def stop(self) -> None:
        """Put the byte that stops on the wire, and let no line of the running order follow it."""
        with self.gate:
            self._stops += 1
            self.hold_left = True
            if self.homing:
                self.resets_due += 1
            self.line.write(RESET if self.homing else HOLD)

    def abort(self) -> None:
        """Soft reset without waiting for its start-up message."""
        with self.gate:
            self.resets_due += 1
            self.line.write(RESET)

    def hold(self) -> None:
        """Stand still, to be cleared away before anything else is asked."""
        with self.gate:
            self.hold_left = True
            self.line.write(HOLD)

    def cleared(self, stops: int) -> None:
        """The hold is cleared away, unless another `stop` came since there were `stops`."""
        with self.gate:
            self.hold_left = self._stops != stops

    def request(self, byte: bytes) -> None:
        """A real-time character."""
        self.line.write(byte)

    # -- lines

    def send(self, text: str) -> None:
        """One line; `exchange` waits for its answer.

        Raises:
            StoppedError: `stop` was called since the order began.
        """
        with self.gate:
            if self.stopped:
                raise StoppedError(f"{self.port}: stopped on request; move again to go on")
            self.waiting.append(text)
            self.line.write(text.encode("ascii") + b"\n")

    def read(self, deadline: float) -> Reply | None:
        """The next reply, None if none came in time; keeps account of what it answers.

        Raises:
            DisconnectedError: the port is gone.
        """
        try:
            said = self.line.read_line(deadline)
        except ReplyError:
            return None
        reply = parse(said)
        if isinstance(reply, Ok | Refusal):
            if not self.waiting:
                return Noise(said)
            self.answered = self.waiting.popleft()
        elif isinstance(reply, Banner):
            self._forget()
            if self.resets_due:
                self.resets_due -= 1
                return Restarted()
        elif isinstance(reply, Report):
            if len(reply.place) < self._axes:
                return Noise(said)
            self.report, self._queried_s = reply, None
            self.offset = reply.offset or self.offset
        return reply

    def _forget(self) -> None:
        """It starts again: nothing that was asked before will be answered."""
        self.waiting.clear()
        self.offset = self.report = self._queried_s = None

    def place(self, report: Report) -> tuple[float, ...] | None:
        """Work position, mm; None as long as the controller has not told its offset."""
        if report.machine and self.offset is None:
            return None
        place = work_place(report, self.offset or ())
        return tuple(round(self.unit * value, 4) for value in place[: self._axes])

    def exchange(self, lines: Sequence[str], allowed_s: float, judge: Judge) -> list[Reply]:
        """Send lines and wait until every one is answered; returns what else was said.

        While the controller reports a hold, time stands still for `allowed_s`.

        Raises:
            RefusedError: a line was refused; those after it may have been executed.
            ReplyError: answers are missing.
            HardwareError: whatever `judge` raises.
        """
        queue, heard, refused = deque(lines), [], None
        now = self._clock()
        end, poll, idle_since = now + allowed_s, now + POLL_S, None
        while self.waiting or (queue and refused is None):
            while queue and refused is None and self._room(queue[0]):
                self.send(queue.popleft())
            reply = self.read(min(end, poll))
            before, now = now, self._clock()
            judge(reply)
            if isinstance(reply, Restarted):
                raise ReplyError(f"{self.port}: the controller started again late; try again")
            if self.report is not None and self.report.state in ("Hold", "Door"):
                end += now - before
            if isinstance(reply, Report):
                idle_since = (idle_since or now) if reply.state == "Idle" else None
            elif reply is not None:
                idle_since = None
            if isinstance(reply, Refusal):
                refused = refused or grbl_codes.error(reply.code, self.answered, self.port, self.firmware)
            elif reply is not None:
                heard.append(reply)
            if self.waiting and (now >= end or (idle_since is not None and now - idle_since > IDLE_S)):
                raise self._unanswered(idle=now < end)
            if now >= poll:
                self._query(now)
                poll = now + POLL_S
        if refused is not None:
            raise refused
        return heard

    def _query(self, now: float) -> None:
        """Ask for the state; one question at a time, so that what is told next was asked last."""
        if self._queried_s is None or now - self._queried_s >= REASK_S:
            self._queried_s = now
            self.request(QUERY)

    def _room(self, text: str) -> bool:
        return sum(len(line) + 1 for line in self.waiting) + len(text) + 1 <= RX_BYTES

    def _unanswered(self, idle: bool) -> ReplyError:
        what = "it is idle, so its answer was lost" if idle else "no answer in time"
        return ReplyError(f"{self.port}: {self.waiting[0]!r}: {what}; check cable and power, then try again")

    def drain(self, judge: Judge) -> None:
        """Take note of what has arrived unasked."""
        while (reply := self.read(self._clock() + 0.001)) is not None:
            judge(reply)

    def listen(self, seconds: float, judge: Judge) -> None:
        """Let time pass."""
        end = self._clock() + seconds
        while self._clock() < end:
            judge(self.read(end))

    def look(self, judge: Judge, allowed_s: float = LOOK_S) -> Report:
        """Ask for a status report and wait for it; what an earlier question is still to be told is not it.

        Raises:
            ReplyError: none came.
        """
        now = self._clock()
        end, stale = now + allowed_s, self._queried_s is not None
        while now < end:
            self._query(now)
            reply = self.read(min(end, now + POLL_S))
            judge(reply)
            if isinstance(reply, Report):
                if not stale:
                    return reply
                stale = False
            now = self._clock()
        raise ReplyError(f"{self.port}: the controller does not tell its state; check cable and power")

    def reset(self, judge: Judge) -> None:
        """Soft reset: after its start-up message nothing comes that was asked before it.

        Raises:
            ReplyError: neither a start-up message nor a state as after one came.
        """
        for _ in range(RESETS):
            self.abort()
            if self._greeted(judge):
                self.resets_due = 0  # those not answered by now were not heard
                return
        raise ReplyError(f"{self.port}: the controller does not start again; check cable and power")

    def _greeted(self, judge: Judge) -> bool:
        """Has it started again, and has what more start-up messages are due had time to come?"""
        end, greeted = self._clock() + BANNER_S, False
        while self.resets_due and (now := self._clock()) < end:
            reply = self.read(min(end, now + QUIET_S) if greeted else end)
            if reply is None and greeted:
                break
            greeted = greeted or isinstance(reply, Restarted)
            judge(reply)
        return greeted or self._at_rest(judge)

    def _at_rest(self, judge: Judge) -> bool:
        """Does it stand, and take lines? What it greets with may be any text (FluidNC, `$Start/Message`), or nothing."""
        self._forget()  # what was asked before was answered while one waited for a greeting, or never will be
        with contextlib.suppress(ReplyError):
            if self.look(judge).state in ("Idle", "Alarm"):
                with self.gate:
                    self.waiting.append(MODES)
                    self.line.write(MODES.encode("ascii") + b"\n")
                end = self._clock() + LOOK_S
                while self.waiting and self._clock() < end:
                    judge(self.read(end))
                answered = not self.waiting
                self.waiting.clear()
                return answered
        return False
