"""The heart of the GRBL emulator: machine states, real-time requests, alarms, and what is told of them.

Source: GRBL 1.1 documentation, "Real-time Commands" and "Interface" (states, sub-states, alarms, status report with
WCO every 30 or 10 and Ov every 20 or 10 reports). The controller's program may wait in many places; here each of
them is a generator that yields the time when it wants to be woken, or None for "when anything happens".
"""

from collections import deque
from collections.abc import Generator, Sequence
from typing import TypeVar

from hardware.virtual.grbl.dialects import Dialect
from hardware.virtual.grbl.gcode import Parser
from hardware.virtual.grbl.motion import BLOCKS, Stepper
from hardware.virtual.grbl.settings import AXES, LETTERS, Memory, placed

T = TypeVar("T")
Steps = Generator[float | None, None, T]  # a part of the program that may wait

IDLE, RUN, HOLD, JOG, HOME, ALARM, CHECK, DOOR, SLEEP = (
    "Idle", "Run", "Hold", "Jog", "Home", "Alarm", "Check", "Door", "Sleep",
)  # fmt: skip
HARD_LIMIT, SOFT_LIMIT, ABORTED, HOMING_RESET, HOMING_PULLOFF, HOMING_APPROACH = 1, 2, 3, 6, 8, 9
HOMING_REQUIRED = 11  # grblHAL

RX_BYTES = 128
ALARM_S = 0.5  # the controller does nothing else that long after telling of an alarm
_BUSY = (HOME, RUN, HOLD, JOG, DOOR)
_UNLOCK = "'$H'|'$X' to unlock"


class Reset(Exception):
    """The program was left at a soft reset and begins anew."""


class Core:
    """State that every part of the program shares."""

    def __init__(self, memory: Memory, stepper: Stepper, dialect: Dialect, homes: tuple[int, ...]):
        self.memory, self.stepper, self.dialect, self.homes = memory, stepper, dialect, homes
        self.parser = Parser(memory)
        self.now = 0.0
        self.out = bytearray()
        self.state = IDLE
        self.rx: deque[int] = deque()
        self.flags: set[str] = set()  # status, start, hold, cancel, door, sleep, stop, reset
        self.alarm = self.stands = 0  # to be told; told, and the reason why it is locked
        self.homed = False
        self.restart()

    def restart(self) -> None:
        """What a soft reset clears; state, settings and position stay."""
        self.rx.clear()
        self.flags.clear()
        self.alarm = 0
        self.suspend: set[str] = set()  # complete, jog, cancel, ajar, retracted, restore
        self.exec_hold = self.soft_limit = False
        self.feed_override = self.rapid_override = self.spindle_override = 100
        self.stepper.reset()
        self.stepper.overrides = (1.0, 1.0)
        self.parser = Parser(self.memory, position=self.placed())
        self._wco_in = self._ov_in = 0

    # -- telling

    def say(self, line: str) -> None:
        self.out += line.encode("latin-1") + b"\r\n"

    def message(self, text: str) -> None:
        self.say(self.dialect.message.format(text))

    def answer(self, code: int) -> None:
        self.say(f"error:{code}" if code else "ok")

    def unlock_message(self) -> None:
        self.message(_UNLOCK)

    def placed(self) -> tuple[float, ...]:
        """Machine position in whole steps, mm."""
        steps = self.memory.per_axis(100)
        return tuple(round(p * s) / s for p, s in zip(self.stepper.position, steps, strict=True))

    def refresh_offset(self) -> None:
        """The next report tells WCO."""
        self._wco_in = 0

    def report(self) -> None:
        state = self.state
        if state == HOLD:
            state = JOG if "jog" in self.suspend else f"Hold:{0 if 'complete' in self.suspend else 1}"
        elif state == DOOR:
            open_ = "ajar" in self.suspend
            state = f"Door:{(1 if open_ else 0) if 'retracted' in self.suspend else 2}"
        elif state == ALARM and self.dialect.homing_required and self.stands:
            state = f"Alarm:{self.stands}"
        inches, offset, place = self.memory.flag(13), self.parser.work_offset(), self.placed()
        offset, place = self._all_axes(offset), self._all_axes(place)
        mask = int(self.memory.settings[10])
        if mask & 1:
            fields = [state, f"MPos:{placed(place, inches)}"]
        else:
            work = [p - o for p, o in zip(place, offset, strict=True)]
            fields = [state, f"WPos:{placed(work, inches)}"]
        if mask & 2:
            fields.append(f"Bf:{BLOCKS - len(self.stepper.blocks)},{RX_BYTES - len(self.rx)}")
        rate = 60 * self.stepper.speed / (25.4 if inches else 1)
        spinning = 0 if self.parser.modes.spindle == "M5" else self.parser.modes.speed
        fields.append(f"FS:{rate:.0f},{spinning:.0f}")
        if pressed := self.stepper.pressed():
            fields.append("Pn:" + "".join(LETTERS[axis] for axis in sorted(pressed)))
        if self._wco_in > 0:
            self._wco_in -= 1
        else:
            self._wco_in = 29 if self.state in _BUSY else 9
            self._ov_in = self._ov_in or 1
            fields.append(f"WCO:{placed(offset, inches)}")
        if self._ov_in > 0:
            self._ov_in -= 1
        else:
            self._ov_in = 19 if self.state in _BUSY else 9
            fields.append(f"Ov:{self.feed_override},{self.rapid_override},{self.spindle_override}")
            running = {"M3": "S", "M4": "C"}.get(self.parser.modes.spindle, "")
            running += "F" if self.parser.modes.coolant == "M8" else ""
            if running:
                fields.append(f"A:{running}")
        self.say(f"<{'|'.join(fields)}{self.dialect.fields}>")

    def _all_axes(self, place: Sequence[float]) -> tuple[float, ...]:
        return (*place, *[0.0] * self.dialect.axes)[: self.dialect.axes]

    # -- real-time requests

    def abort(self) -> None:
        """Soft reset, at interrupt level: whatever moves loses steps."""
        if "reset" in self.flags:
            return
        self.flags.add("reset")
        if self.state in (RUN, HOME, JOG) or self.exec_hold:
            if self.state != HOME:
                self.alarm = ABORTED
            elif not self.alarm:
                self.alarm = HOMING_RESET
            self.stepper.reset()

    def checkpoint(self) -> Steps[None]:
        """Where the program looks for real-time requests, and stays while it is suspended.

        Raises:
            Reset: a soft reset was asked for.
        """
        yield from self._requests()
        while self.suspend:
            if "complete" in self.suspend and self.state in (DOOR, SLEEP):
                self.suspend.add("retracted")
                if self.state == SLEEP:
                    self.message("Sleeping")
                    while True:
                        yield None
                        yield from self._requests()
                self.suspend.discard("ajar")  # no door pin is compiled in: the door is shut again
            yield None
            yield from self._requests()

    def _requests(self) -> Steps[None]:
        if self.alarm:
            yield from self._alarm()
        flags = self.flags
        if "reset" in flags:
            raise Reset
        if "status" in flags:
            flags.discard("status")
            self.report()
        asked = set(flags)
        if asked & {"cancel", "hold", "door", "sleep"}:
            self._hold(asked)
            flags -= {"cancel", "hold", "door", "sleep"}
        if "start" in asked:
            flags.discard("start")
            if not asked & {"hold", "cancel", "door"}:
                self._start()
        if "stop" in flags:
            flags.discard("stop")
            self._stopped()

    def _alarm(self) -> Steps[None]:
        code, self.state = self.alarm, ALARM
        self.stands = code
        self.say(f"ALARM:{code}")
        yield from self.delay(ALARM_S)
        if code in (HARD_LIMIT, SOFT_LIMIT):
            self.message("Reset to continue")
            self.flags.discard("reset")
            while "reset" not in self.flags:
                if self.dialect.tells_in_alarm and "status" in self.flags:
                    self.flags.discard("status")
                    self.report()
                yield None
        self.alarm = 0

    def _hold(self, asked: set[str]) -> None:
        if self.state not in (ALARM, CHECK):
            if self.state in (RUN, JOG) and not self.suspend & {"cancel", "jog"}:
                self.exec_hold = self.stepper.holding = True
                if self.state == JOG and "sleep" not in asked:
                    self.suspend.add("jog")
            if self.state == IDLE:
                self.suspend = {"complete"}
            if "cancel" in asked and self.state != JOG:
                self.suspend.add("cancel")
            if "hold" in asked and self.state not in (DOOR, JOG, SLEEP):
                self.state = HOLD
            if "door" in asked:
                self.message("Check Door")
                if "jog" not in self.suspend and self.state != SLEEP:
                    self.state = DOOR
                self.suspend.add("ajar")
        if "sleep" in asked:
            if self.state == ALARM:
                self.suspend |= {"retracted", "complete"}
            self.state = SLEEP

    def _start(self) -> None:
        if self.state == DOOR and "ajar" not in self.suspend and "retracted" in self.suspend:
            self.state = IDLE
        if self.state == IDLE or (self.state == HOLD and "complete" in self.suspend):
            self.exec_hold = False
            moves = bool(self.stepper.blocks) and "cancel" not in self.suspend
            self.suspend = set()
            self.state = RUN if moves else IDLE
            if moves:
                self.stepper.begin()

    def _stopped(self) -> None:
        """A cycle ended, or a hold came to a stand."""
        if self.state in (HOLD, DOOR, SLEEP) and not self.soft_limit and "jog" not in self.suspend:
            if self.exec_hold:
                self.suspend.add("complete")
            self.exec_hold = self.stepper.holding = False
            return
        if "jog" in self.suspend:
            self.stepper.reset()
            self.parser.position = self.placed()
        self.exec_hold = self.stepper.holding = False
        if "ajar" in self.suspend:
            self.suspend = {"ajar", "complete"}
            self.state = DOOR
        else:
            self.suspend = set()
            self.state = IDLE

    def override(self, byte: int) -> None:
        """One of the extended real-time characters 0x90 to 0x9D."""
        feed = {0x91: 10, 0x92: -10, 0x93: 1, 0x94: -1}
        spindle = {0x9A: 10, 0x9B: -10, 0x9C: 1, 0x9D: -1}
        if byte == 0x90:
            self.feed_override = 100
        elif byte in feed:
            self.feed_override = min(200, max(10, self.feed_override + feed[byte]))
        elif byte in (0x95, 0x96, 0x97):
            self.rapid_override = {0x95: 100, 0x96: 50, 0x97: 25}[byte]
        elif byte == 0x99:
            self.spindle_override = 100
        elif byte in spindle:
            self.spindle_override = min(200, max(10, self.spindle_override + spindle[byte]))
        self._ov_in = 0
        self.stepper.overrides = (self.feed_override / 100, self.rapid_override / 100)
        self.stepper.plan()

    # -- waiting

    def delay(self, seconds: float) -> Steps[None]:
        """Wait without looking at anything."""
        end = self.now + seconds
        while self.now < end:
            yield end

    def auto_start(self) -> None:
        if self.stepper.blocks:
            self.flags.add("start")

    def synchronize(self) -> Steps[None]:
        """Until all that is queued has been done."""
        while True:
            self.auto_start()
            yield from self.checkpoint()
            if not self.stepper.blocks and self.state != RUN:
                return
            yield None

    def dwell(self, seconds: float) -> Steps[None]:
        """G4: after all motion, in slices of 50 ms, of which there is at least one."""
        yield from self.synchronize()
        slices = -int(-20 * seconds // 1)
        for _ in range(slices):
            yield from self.checkpoint()
            yield from self.delay(0.05)

    def line_to(
        self,
        target: tuple[float, ...],
        feed: float,
        rapid: bool = False,
        inverse_time: bool = False,
        fixed: bool = False,
    ) -> Steps[None]:
        """Queue one line, after its soft-limit check, waiting for room."""
        if self.memory.flag(20) and self.state != JOG and self.outside(target) and not fixed:
            yield from self._beyond()
        if self.state == CHECK:
            return
        while True:
            if self.stepper.full:
                self.auto_start()
            yield from self.checkpoint()
            if not self.stepper.full:
                break
            yield None
        self.stepper.append(target, feed, rapid, inverse_time, fixed)

    def outside(self, target: tuple[float, ...]) -> bool:
        """GRBL's travel is all negative, from -$130 to 0."""
        travel = self.memory.per_axis(130)
        return any(not -travel[axis] <= target[axis] <= 0 for axis in range(AXES))

    def _beyond(self) -> Steps[None]:
        self.soft_limit = True
        if self.state == RUN:
            self.flags.add("hold")
            while True:
                yield from self.checkpoint()
                if self.state == IDLE:
                    break
                yield None
        self.abort()
        self.alarm = SOFT_LIMIT
        yield from self.checkpoint()
