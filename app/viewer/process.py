"""The drawing process as the system sees it: start, lines in and out without ever waiting, the tail of its errors, kill."""

import contextlib
import os
import select
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")
_TAIL_BYTES = 8192
_CHUNK = 1 << 16
REAP_S = 2.0


class Child:
    """One process; belongs to one thread."""

    def __init__(self, renderer: str, on_screen: bool, command: Sequence[str] | None = None) -> None:
        """`on_screen` lets it see the screen; without, Open3D draws through EGL, in no window at all."""
        words = [*(command or (sys.executable, "-m", "app.viewer.child")), "--renderer", renderer]
        environment = {key: value for key, value in os.environ.items() if on_screen or key not in _SCREENS}
        found = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), found] if found else [str(ROOT)])
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            # Linux divides its cores among sessions first: the window is not to wait for what its child has used up.
            start_new_session=True,
        )
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            assert stream is not None
            os.set_blocking(stream.fileno(), False)
        self._partial = b""
        self._tail: deque[bytes] = deque()
        self._ended = False
        self._quiet = False  # stderr was closed

    @property
    def pid(self) -> int:
        return self._process.pid

    def write(self, line: bytes) -> None:
        """Hand a line over; a child that reads nothing any more loses it, and the watch will notice."""
        assert self._process.stdin is not None
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(self._process.stdin.fileno(), line)

    @staticmethod
    def wait(child: "Child | None", wake: int, seconds: float) -> tuple[bool, list[bytes], bool]:
        """Wait for the child's words or the descriptor `wake`; (woken, whole lines, whether the child still lives)."""
        streams = [] if child is None or child._ended else child._streams()
        # Not select(), which knows no descriptor beyond 1023.
        poller = select.poll()
        for stream in (wake, *streams):
            poller.register(stream, select.POLLIN)
        ready = [stream for stream, _ in poller.poll(max(seconds, 0.0) * 1000)]
        lines = [] if child is None else child._read([stream for stream in ready if stream != wake])
        return wake in ready, lines, child is not None and not child._ended

    def ending(self) -> str:
        """How it ended, in words."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            code = self._process.wait(REAP_S)
            if code < 0:
                with contextlib.suppress(ValueError):
                    return f"signal {signal.Signals(-code).name}"
            return f"exit code {code}"
        return "closed its output"

    def errors(self) -> str:
        """The last of what it wrote to stderr."""
        if not self._ended:
            self._read(self._streams())
        return b"".join(self._tail)[-_TAIL_BYTES:].decode(errors="replace").strip()

    def kill(self) -> None:
        """Not to be refused, not even by a process that is stopped."""
        self._process.kill()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        # A process stuck inside the kernel is left to it.
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(REAP_S)
        self._ended = True

    def _streams(self) -> list[int]:
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        out, err = self._process.stdout.fileno(), self._process.stderr.fileno()
        return [out] if self._quiet else [out, err]

    def _read(self, ready: Sequence[int]) -> list[bytes]:
        lines: list[bytes] = []
        out = -1 if self._ended else self._streams()[0]
        for stream in ready:
            try:
                chunk = os.read(stream, _CHUNK)
            except BlockingIOError:
                continue
            if stream == out:
                *whole, self._partial = (self._partial + chunk).split(b"\n")
                lines += whole
                self._ended = self._ended or not chunk
            elif not chunk:
                self._quiet = True
            else:
                self._tail.append(chunk)
                while sum(map(len, self._tail)) > 2 * _TAIL_BYTES:
                    self._tail.popleft()
        return lines
