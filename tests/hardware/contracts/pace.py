"""Emulated devices under test: what they heard, and their clock.

It runs fast where a test only wants to get somewhere, slowly where it acts in the midst of a motion.
"""

import re
import time

from hardware.virtual.wire import Firmware

SLOW, FAST = 4.0, 40.0  # times faster than real; at SLOW 300 degrees of pan take 1.3 s


class Pace:
    """A clock whose rate may be changed at any moment, by any thread; it never jumps."""

    def __init__(self, rate: float = FAST):
        self._now = (time.monotonic(), 0.0, rate)  # a moment, what this clock showed then, and its rate since

    def __call__(self) -> float:
        moment, shown, rate = self._now
        return shown + rate * (time.monotonic() - moment)

    def set(self, rate: float) -> None:
        self._now = (time.monotonic(), self(), rate)


class Heard:
    """A firmware, and everything that was said to it."""

    def __init__(self, firmware: Firmware, questions: re.Pattern[bytes]):
        self.firmware, self._questions = firmware, questions
        self.bytes = b""

    def receive(self, data: bytes, now: float) -> None:
        self.bytes += data
        self.firmware.receive(data, now)

    def advance(self, now: float) -> bytes:
        return self.firmware.advance(now)

    def orders(self) -> bytes:
        """What was said, without questions that change nothing."""
        return self._questions.sub(b"", self.bytes)
