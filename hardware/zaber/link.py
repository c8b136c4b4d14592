"""Questions and answers with Zaber devices on one cable: each answer belongs to its question, by its message id.

Any thread may ask; one question at a time is on the wire. `stop` waits for nobody. Source: Zaber "ASCII Protocol
Reference Manual", firmware 7, sections Message IDs and Message Format. Times are seconds of the clock given.
"""

import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace

from hardware.errors import ReplyError
from hardware.line import Line
from hardware.zaber import messages


class Link:
    """The cable; `checked` is set once the devices are known to end their answers with checksums."""

    def __init__(self, line: Line, reply_s: float, clock: Callable[[], float]):
        self.line, self.reply_s, self._clock = line, reply_s, clock
        self.checked = False
        self._ids = itertools.cycle(range(100))
        self._asking = threading.Lock()

    @property
    def port(self) -> str:
        return self.line.port

    def stop(self, addresses: Sequence[int]) -> None:
        """All axes of these devices stop. No lock but that of the wire: it goes out while an answer is awaited.

        Raises:
            DisconnectedError: the cable is gone.
        """
        self.line.write(
            b"".join(messages.command(address, 0, next(self._ids), "stop") for address in addresses)
        )

    def ask(self, address: int, axis: int, text: str, tries: int = 3) -> messages.Message:
        """The answer to a command that was accepted. Questions may be asked again, orders must not.

        Raises:
            ReplyError: no answer that could be read, or the device says to try again.
            RefusedError: it was rejected; the message names reason and remedy.
            DisconnectedError: the cable is gone.
        """
        with self._asking:
            for left in reversed(range(tries)):
                try:
                    return self._accepted(address, axis, text, self.reply_s)
                except ReplyError:
                    if not left:
                        raise
        raise AssertionError("a question is asked at least once")

    def peek(self, address: int, axis: int, text: str, patience_s: float) -> messages.Message | None:
        """Like `ask`, once, within `patience_s`; None if somebody else's question takes the wire for so long."""
        if not self._asking.acquire(timeout=patience_s / 2):
            return None
        try:
            return self._accepted(address, axis, text, patience_s / 2)
        finally:
            self._asking.release()

    def _accepted(self, address: int, axis: int, text: str, patience_s: float) -> messages.Message:
        reply = self._exchange(address, axis, text, patience_s)
        if reply.rejected:
            raise messages.refusal(f"{self.port}, device {address} axis {axis}", text, reply.data)
        return reply

    def _exchange(self, address: int, axis: int, text: str, patience_s: float) -> messages.Message:
        """Send a command and wait for the answer with its id; what else comes answers something older, or nothing."""
        id = next(self._ids)
        deadline = self._clock() + patience_s
        self.line.write(messages.command(address, axis, id, text))
        trouble = f"{self.port}: no answer to '{text}'; check cable, power and baud rate"
        reply: messages.Message | None = None
        # Checked here too: a line that never falls silent would otherwise be read for ever.
        while self._clock() < deadline:
            try:
                line = self.line.read_line(deadline)
            except ReplyError:
                break
            try:
                message = messages.read(line, self.checked)
            except ReplyError as error:
                trouble = f"{self.port}: {error}"
                continue
            if (message.address, message.axis, message.id) != (address, axis, id):
                continue
            if reply is None and message.kind == "@":
                reply = message
            elif reply is not None and message.continues:
                reply = replace(reply, data=f"{reply.data} {message.data}", goes_on=message.goes_on)
            if reply is not None and not reply.goes_on:
                return reply
        raise ReplyError(trouble)
