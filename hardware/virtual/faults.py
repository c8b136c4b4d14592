"""Any firmware behind a bad connection: what it says is spoiled, lost, chopped or late, on command.

`Wire(Faulty(firmware))` is a device with a loose plug. Every fault can be called from any thread while the wire
runs, and lasts until `heal()` unless it says otherwise. What a device itself does wrong (stall, limit hit, brown-out)
is on its own firmware; a pulled cable is `Wire.pull()`.
"""

import random
import threading
from collections import deque

from hardware.virtual.wire import Firmware


class Faulty:
    """A `Firmware` around a `Firmware`; without a fault it changes nothing."""

    def __init__(self, firmware: Firmware, seed: int = 0):
        self.firmware = firmware
        self._lock = threading.Lock()
        self._random = random.Random(seed)
        self._line = bytearray()  # of a line that may have to be lost: told once it is whole
        self._queue: deque[tuple[float, bytes]] = deque()  # due time, bytes; none overtakes another
        self._clear()

    def _clear(self) -> None:
        self._garbage = b""
        self._noise = 0.0
        self._losses: list[tuple[int, bytes]] = []
        self._delay_s = 0.0
        self._merge_s = 0.0
        self._split = self._silent = self._deaf = False

    def garbage(self, data: bytes) -> None:
        """Once: `data` between the first and the second byte of what the device says next."""
        with self._lock:
            self._garbage += data

    def noise(self, chance: float) -> None:
        """Before each byte, with this chance, a byte of any value."""
        with self._lock:
            self._noise = chance

    def lose_line(self, number: int = 1, matching: bytes = b"") -> None:
        """Once: the `number`-th line from now that begins with `matching` never arrives; 1 is the next."""
        with self._lock:
            self._losses.append((number, matching))

    def split(self) -> None:
        """Single bytes, each by itself."""
        with self._lock:
            self._split = True

    def merge(self, seconds: float) -> None:
        """Hold everything back up to `seconds`, then send it in one piece."""
        with self._lock:
            self._merge_s = seconds

    def delay(self, seconds: float) -> None:
        """Everything said from now on arrives this much later (seconds of the wire's clock)."""
        with self._lock:
            self._delay_s = seconds

    def silence(self) -> None:
        """Nothing the device says arrives; it still hears."""
        with self._lock:
            self._silent = True

    def deafen(self) -> None:
        """Nothing arrives at the device; what it says still comes."""
        with self._lock:
            self._deaf = True

    def heal(self) -> None:
        """End every fault; what was delayed still comes when it is due."""
        with self._lock:
            self._clear()

    def receive(self, data: bytes, now: float) -> None:
        with self._lock:
            if not self._deaf:
                self.firmware.receive(data, now)

    def advance(self, now: float) -> bytes:
        with self._lock:
            said = self._spoiled(self._kept(self.firmware.advance(now)))
            if said and not self._silent:
                self._enqueue(said, now)
            return self._due(now)

    def _kept(self, said: bytes) -> bytes:
        """What is left after the lines that are to be lost."""
        if not self._losses and not self._line:
            return said
        kept = bytearray()
        for byte in said:
            self._line.append(byte)
            if byte == ord("\n"):
                if not self._lost(bytes(self._line)):
                    kept += self._line
                self._line.clear()
        return bytes(kept)

    def _lost(self, line: bytes) -> bool:
        lost, later = False, []
        for number, matching in self._losses:
            if line.startswith(matching):
                number -= 1
            if number == 0:
                lost = True
            else:
                later.append((number, matching))
        self._losses = later
        return lost

    def _spoiled(self, said: bytes) -> bytes:
        if self._garbage and said:
            said, self._garbage = said[:1] + self._garbage + said[1:], b""
        if not self._noise:
            return said
        noisy = bytearray()
        for byte in said:
            if self._random.random() < self._noise:
                noisy.append(self._random.randrange(256))
            noisy.append(byte)
        return bytes(noisy)

    def _enqueue(self, said: bytes, now: float) -> None:
        due = now + self._delay_s
        if self._merge_s:
            due = self._queue[-1][0] if self._queue else due + self._merge_s
        pieces = [bytes([byte]) for byte in said] if self._split else [said]
        self._queue.extend((due, piece) for piece in pieces)

    def _due(self, now: float) -> bytes:
        """One piece when bytes go singly, otherwise all that is due."""
        said = bytearray()
        while self._queue and self._queue[0][0] <= now:
            said += self._queue.popleft()[1]
            if self._split:
                break
        return bytes(said)
