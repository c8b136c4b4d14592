"""A serial port as lines of text: whole lines in, whole messages out, a deadline on every wait.

One thread reads. Any thread may write, and a write never waits for a read, so that a stop reaches the wire
while an answer is awaited. Source: termios(3), tty_ioctl(4) (TIOCEXCL), pyserial 3.5.
"""

import contextlib
import errno
import os
import stat
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path

import serial

from hardware.errors import AbsentError, AccessError, BusyError, DisconnectedError, HardwareError, ReplyError
from hardware.holders import holders

LONGEST_LINE = 4096  # bytes without a line end: noise, which is dropped
_SLICE_S = 0.05  # how soon a wait notices that the line was closed
# What pyserial lets through when a port is gone; termios.error is no OSError.
_BROKEN = (OSError, serial.SerialException, termios.error, TypeError)


class Line:
    """An open port. Lines end in LF; CR and everything else that is not printable ASCII stays for the caller to judge."""

    def __init__(self, port: str, baud: int, clock: Callable[[], float] = time.monotonic):
        """Open `port` for this process alone, without pulling DTR where the system lets us: that resets an Arduino.

        Raises:
            AbsentError, AccessError, BusyError: the port is not there, not ours to open, or in use.
        """
        self.port = port
        self._clock = clock
        self._writing = threading.Lock()
        self._buffer = bytearray()
        self._serial = _open(port, baud)

    def write(self, message: bytes) -> None:
        """Put all of a message on the wire, unmixed with other threads' messages.

        Raises:
            DisconnectedError: the port is gone or closed.
        """
        with self._writing:
            try:
                self._serial.write(message)
                self._serial.flush()
            except _BROKEN as error:
                raise self._gone(error) from error

    def read_line(self, deadline: float) -> bytes:
        """The next line without its LF and CR; `deadline` is a time of the clock given on opening.

        Raises:
            ReplyError: nothing whole came in time; what came stays for the next call.
            DisconnectedError: the port is gone or closed.
        """
        while True:
            end = self._buffer.find(b"\n")
            if end >= 0:
                line = bytes(self._buffer[:end]).rstrip(b"\r")
                del self._buffer[: end + 1]
                return line
            if len(self._buffer) > LONGEST_LINE:
                self._buffer.clear()
            left = deadline - self._clock()
            if left <= 0:
                raise ReplyError(f"{self.port}: no answer in time; check cable, power and baud rate")
            try:
                self._serial.timeout = min(left, _SLICE_S)
                self._buffer += self._serial.read(self._serial.in_waiting or 1)
            except _BROKEN as error:
                raise self._gone(error) from error

    @property
    def unfinished(self) -> bytes:
        """What has come of a line whose end has not."""
        return bytes(self._buffer)

    def drop_input(self) -> None:
        """Forget what has arrived: it answers nothing that is asked from now on."""
        try:
            while self._serial.in_waiting:
                self._serial.read(self._serial.in_waiting)
        except _BROKEN as error:
            raise self._gone(error) from error
        self._buffer.clear()

    def close(self) -> None:
        with contextlib.suppress(OSError, serial.SerialException):
            self._serial.close()

    def _gone(self, error: Exception) -> DisconnectedError:
        return DisconnectedError(
            f"{self.port}: the connection is gone ({error}); check cable and power, then home the rig again"
        )


def _open(port: str, baud: int) -> serial.Serial:
    if not os.path.exists(port):
        raise AbsentError(f"{port}: there is no such port; plug the rig in, or see `roomlight rig list`")
    try:
        if not stat.S_ISCHR(os.stat(port).st_mode):
            raise AbsentError(f"{port}: is not a serial port; see `roomlight rig list`")
        made = serial.Serial(baudrate=baud, timeout=_SLICE_S, write_timeout=2.0, exclusive=True)
        made.port = port
        made.dtr = None  # pyrefly: ignore[bad-argument-type]  (pyserial then leaves the pin alone)
        made.open()
    except PermissionError as error:
        raise _not_ours(port) from error
    except (OSError, ValueError) as error:  # pyserial's own faults are OSErrors
        number = getattr(error, "errno", None)
        if number in (errno.EACCES, errno.EPERM):
            raise _not_ours(port) from error
        if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
            raise BusyError(f"{port}: is in use{_by_whom(port)}; let go of it there first") from error
        raise HardwareError(
            f"{port}: cannot be opened as a serial port ({error}); unplug it and plug it in again"
        ) from error
    return made


def _not_ours(port: str) -> AccessError:
    import grp

    try:
        group = grp.getgrgid(os.stat(port).st_gid).gr_name
    except (OSError, KeyError):
        group = "dialout"
    return AccessError(
        f"{port}: no permission; add yourself to its group with `sudo usermod -aG {group} $USER` and log in again"
    )


def _by_whom(port: str) -> str:
    """' by NAME (process 123)' as far as we can see."""
    found = holders(Path(port))
    return f" by {' and '.join(map(str, found))}" if found else ""
