"""A GRBL 1.1h, grblHAL or FluidNC controller as a `Firmware`: bytes in, bytes out, with motors that take their time.

Source: GRBL 1.1 documentation, "Interface" (start-up message, 128-byte receive buffer, 80-character lines), "Real-time
Commands" (characters picked out of the stream before lines are made of it); the others: see
`dialects`. Three axes in mm, of which a rig uses X as pan and Y as tilt, degrees.
"""

import math
import threading
from collections.abc import Mapping

from hardware.interfaces import Angles
from hardware.virtual.grbl.core import (
    ALARM,
    HARD_LIMIT,
    HOME,
    HOMING_REQUIRED,
    IDLE,
    JOG,
    RX_BYTES,
    SLEEP,
    Core,
    Reset,
    Steps,
)
from hardware.virtual.grbl.dialects import GRBL, Dialect
from hardware.virtual.grbl.execute import line, startup
from hardware.virtual.grbl.motion import Mechanics, Stepper
from hardware.virtual.grbl.settings import Memory

BOOT_S = 1.6  # an Arduino's boot loader waits that long before GRBL runs
OVERFLOW = 11
_SOFT_RESET, _DOOR, _JOG_CANCEL = 0x18, 0x84, 0x85
_REQUESTS = {ord("?"): "status", ord("~"): "start", ord("!"): "hold", _DOOR: "door"}
_ENDS = b"\r\n"


class GrblFirmware:
    """See the module. It gets power, and greets, when time first passes. Faults may be called from any thread."""

    def __init__(
        self,
        settings: Mapping[int, float] | None = None,
        mechanics: Mechanics | None = None,
        dialect: Dialect = GRBL,
        homes: tuple[int, ...] = (0, 1),
        step_rate_hz: float | None = None,
    ):
        """
        Args:
            settings: `$` numbers and values that differ from GRBL's own defaults.
            homes: axes that `$H` homes, as compiled in; 0 is X.
            step_rate_hz: fastest steps, where the firmware was compiled to check that.
        """
        self.memory = Memory(settings, step_rate_hz)
        self._stepper = Stepper(self.memory, mechanics or Mechanics())
        self._core = Core(self.memory, self._stepper, dialect, homes)
        self._lock = threading.RLock()
        self._text = bytearray()
        self._comment, self._too_long = "", False
        self._refusals: list[int] = []
        self._boots_at = -math.inf
        self._program: Steps[None] | None = None
        self._wake: float | None = None

    def receive(self, data: bytes, now: float) -> None:
        with self._lock:
            self._pass(now)
            if now >= self._boots_at:  # a boot loader does not understand
                for byte in data:
                    self._byte(byte)

    def advance(self, now: float) -> bytes:
        with self._lock:
            self._pass(now)
            said = bytes(self._core.out)
            self._core.out.clear()
            return said

    def angles(self) -> Angles:
        """Where the mechanics really stand, whatever the controller believes; from any thread."""
        with self._lock:
            pan, tilt, _ = self._stepper.angles
            return Angles(pan, tilt)

    # -- faults of the device itself

    def stall(self, axis: int, stalled: bool = True) -> None:
        """The motor of `axis` hums and does not turn; the controller counts on."""
        with self._lock:
            self._stepper.stalled[axis] = stalled

    def hit_limit(self) -> None:
        """A limit switch trips, by something in the way or by noise on its cable."""
        with self._lock:
            self._limit()
            self._resume()

    def emergency_stop(self) -> None:
        """The button wired to the controller's reset input."""
        with self._lock:
            self._core.abort()
            self._resume()

    def brown_out(self, slip_deg: float = 0.0) -> None:
        """The supply dips: the motors let go and pan turns on by `slip_deg`; it boots again, knowing nothing."""
        with self._lock:
            core = self._core
            self._stepper.reset()
            self._stepper.slip(0, slip_deg)
            self._stepper.set_position((0.0,) * len(self._stepper.position))
            core.out.clear()
            self._boots_at = core.now + BOOT_S
            self._program = self._run()
            self._resume()

    def refuse_next(self, code: int) -> None:
        """The next line is answered `error:CODE` and not executed; for codes that no line of ours provokes."""
        self._refusals.append(code)

    # -- time

    def _pass(self, now: float) -> None:
        core = self._core
        if self._program is None:
            core.now = now
            self._program = self._run()
            self._resume()
        while core.now < now:
            until = now if self._wake is None else min(now, self._wake)
            passed = self._stepper.advance(until - core.now)
            core.now = until if passed >= until - core.now else core.now + passed
            self._happened()
            self._resume()

    def _happened(self) -> None:
        if self._stepper.ended:
            self._stepper.ended = False
            self._core.flags.add("stop")
        if self._stepper.switched:
            self._stepper.switched = False
            if self.memory.flag(21) and self._core.state != HOME:
                self._limit()

    def _limit(self) -> None:
        core = self._core
        if core.state != ALARM and not core.alarm:
            core.abort()
            core.alarm = HARD_LIMIT

    def _resume(self) -> None:
        """Let the program run until it waits."""
        if self._program is not None:
            self._wake = next(self._program)

    # -- bytes

    def _byte(self, byte: int) -> None:
        core = self._core
        if byte == _SOFT_RESET:
            core.abort()
        elif byte in _REQUESTS:
            core.flags.add(_REQUESTS[byte])
        elif byte == _JOG_CANCEL:
            if core.state == JOG:
                core.flags.add("cancel")
        elif 0x90 <= byte <= 0x9D:
            core.override(byte)
        elif byte > 0x7F:
            return
        else:
            if len(core.rx) < RX_BYTES:
                core.rx.append(byte)
            if byte not in _ENDS and len(core.rx) < RX_BYTES:
                return
        self._resume()

    # -- the program

    def _run(self) -> Steps[None]:
        core = self._core
        while core.now < self._boots_at:
            yield self._boots_at
        for told in core.dialect.boot:
            core.say(told)
        core.homed = False
        core.state = ALARM if self.memory.flag(22) else IDLE
        while True:
            core.restart()
            self._text.clear()
            self._comment, self._too_long = "", False
            self._greet()
            try:
                yield from self._loop()
            except Reset:
                continue

    def _greet(self) -> None:
        core = self._core
        core.say("")
        core.say(core.dialect.greeting)

    def _loop(self) -> Steps[None]:
        core = self._core
        if self.memory.flag(21) and self._stepper.pressed():
            core.state = ALARM
            core.message("Check Limits")
        core.stands = 0
        if core.dialect.homing_required and self.memory.flag(22) and not core.homed:
            core.state, core.stands = ALARM, HOMING_REQUIRED
            core.say(f"ALARM:{HOMING_REQUIRED}")
            core.message("Homing cycle required")
        elif core.state in (ALARM, SLEEP):
            core.state = ALARM
            core.unlock_message()
        else:
            core.state = IDLE
            yield from startup(core)
        while True:
            while core.rx:
                byte = core.rx.popleft()
                if byte in _ENDS:
                    yield from core.checkpoint()
                    yield from self._line()
                else:
                    self._gather(chr(byte))
            core.auto_start()
            yield from core.checkpoint()
            yield None

    def _gather(self, character: str) -> None:
        """Spaces, comments and block-delete signs are left out, letters made capitals."""
        if self._comment or self._too_long:
            if character == ")" and self._comment == "(":
                self._comment = ""
        elif character <= " " or character == "/":
            pass
        elif character in "(;":
            self._comment = character
        elif len(self._text) >= self._core.dialect.line_characters:
            self._too_long = True
        else:
            self._text += character.upper().encode()

    def _line(self) -> Steps[None]:
        core = self._core
        text, too_long = self._text.decode(), self._too_long
        self._text.clear()
        self._comment, self._too_long = "", False
        if too_long:
            core.answer(OVERFLOW)
        elif not text:
            core.answer(0)
        elif self._refusals:
            core.answer(self._refusals.pop(0))
        else:
            core.answer((yield from line(core, text)))
