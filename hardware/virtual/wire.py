"""A pseudo-terminal with firmware behind it: programs open `port` as they would open a cable.

The firmware is a pure state machine (`Firmware`): bytes in, bytes out, time given. `Wire` runs it in a thread
against a clock, paces nothing, and can break the way cables do.
"""

import contextlib
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from typing import Protocol

TICK_S = 0.002


class Firmware(Protocol):
    """What a device's processor does. No method blocks; times are seconds of one monotonic clock."""

    def receive(self, data: bytes, now: float) -> None:
        """Bytes that arrived on the wire."""
        ...

    def advance(self, now: float) -> bytes:
        """Let time pass up to `now`; what the device puts on the wire since the last call."""
        ...


class Wire:
    """A firmware on a pseudo-terminal; `port` is the path that a driver opens."""

    def __init__(self, firmware: Firmware, clock: Callable[[], float] = time.monotonic):
        self.firmware, self._clock = firmware, clock
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._over, self._closing = threading.Event(), threading.Lock()
        self._handles = [self._master, self._slave]  # still open
        self._thread = threading.Thread(target=self._run, name="firmware", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            with contextlib.suppress(OSError, ValueError):
                ready, _, _ = select.select([self._master], [], [], TICK_S)
                if ready:
                    self.firmware.receive(os.read(self._master, 4096), self._clock())
                out = self.firmware.advance(self._clock())
                if out:
                    os.write(self._master, out)

    def pull(self) -> None:
        """Pull the cable: whoever holds the port gets EIO."""
        self._over.set()
        if self._thread is not threading.current_thread():
            self._thread.join()
        # Each once: a number that was given back may belong to another file by now.
        with self._closing:
            handles, self._handles = self._handles, []
        for handle in handles:
            os.close(handle)

    def close(self) -> None:
        self.pull()
