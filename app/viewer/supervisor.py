"""The window's side of the drawing process: starts it, tells it what to draw, and starts it again when it hangs or dies.

One thread does everything that could wait; every public method returns at once, from any thread. At most one wish to look is
under way: while it is, only the newest is kept. A fresh child gets the same session, layers and wish as the last
one had. After too many restarts the view stops until `retry`.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.viewer import protocol
from app.viewer.events import Event, Picture, Status
from app.viewer.frames import FrameReader, MemoryFull, slot_bytes
from app.viewer.orbit import Orbit
from app.viewer.process import Child
from app.viewer.watch import FRAME, LOADED, PONG, READY, Patience, Restarts, Watch

PING_EVERY_S = 2.0
MOST_PIXELS = 6_000_000  # of a picture; larger windows get it enlarged
_HEADROOM = 1.3  # a window that grows a little needs no new memory


class Supervisor:
    """Watches over one drawing process. `listener` is called from the watching thread."""

    def __init__(
        self,
        listener: Callable[[Event], None],
        command: Sequence[str] | None = None,
        patience: Patience | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._listener, self._command = listener, command
        self._patience, self._clock = patience or Patience(), clock
        self._lock = threading.Lock()
        self._wake_out, self._wake_in = os.pipe()
        os.set_blocking(self._wake_in, False)
        self._thread: threading.Thread | None = None
        # What is wanted, guarded by the lock.
        self._folder: str | None = None
        self._look: protocol.Look | None = None
        self._count = 0
        self._orders: deque[Any] = deque()
        # The rest belongs to the thread.
        self._child: Child | None = None
        self._watch = Watch(self._patience)
        self._restarts = Restarts(self._patience)
        self._reader: FrameReader | None = None
        self._status = Status()
        self._paints: dict[str, protocol.Paint] = {}
        self._sent: dict[int, protocol.Look] = {}
        self._told = -1  # number of the newest look that was sent
        self._renderer, self._on_screen = "auto", False
        self._pinged = 0.0

    def show(self, folder: Path | None) -> None:
        """Show a session, or nothing; reads it again if it is the same."""
        with self._lock:
            self._folder = None if folder is None else str(folder)
        self._order("show")

    def look(self, orbit: Orbit, width: int, height: int, moving: bool, style: protocol.Style) -> int:
        """Draw this; returns its number."""
        shrink = max((width * height / MOST_PIXELS) ** 0.5, 1.0)
        with self._lock:
            self._count += 1
            number = self._count
            size = max(int(width / shrink), 1), max(int(height / shrink), 1)
            self._look = protocol.Look(number, orbit, *size, moving, style)
        self._wake()
        return number

    def probe(self, x: float, y: float) -> int:
        """Ask what is under a place of the last picture, as shares of its size; `Probed` answers."""
        with self._lock:
            self._count += 1
            number = self._count
        self._order(protocol.Probe(number, x, y))
        return number

    def paint(self, layer: str, path: Path) -> None:
        """Give the surface a layer of its own colours, until another session is shown; see protocol.Paint."""
        self._order(protocol.Paint(layer, str(path)))

    def retry(self) -> None:
        """Try again after the view got stuck."""
        self._order("retry")

    def close(self, wait_s: float = 2.0) -> None:
        """End the child and give its memory back."""
        self._order("close")
        if self._thread is not None:
            self._thread.join(wait_s)

    def _order(self, order: Any) -> None:
        with self._lock:
            self._orders.append(order)
            if self._thread is None and order == "show":
                self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
                self._thread.start()
        self._wake()

    def _wake(self) -> None:
        try:
            os.write(self._wake_in, b"!")
        except BlockingIOError:
            pass  # it has been woken often enough
        except OSError:
            pass  # it has ended

    # What follows runs in the thread.

    def _run(self) -> None:
        try:
            while self._round():
                pass
        finally:
            self._drop()
            os.close(self._wake_out)
            wake, self._wake_in = self._wake_in, -1
            os.close(wake)

    def _round(self) -> bool:
        """Do what was ordered, hear what was answered, look at the clock; False at the end."""
        with self._lock:
            orders, self._orders = list(self._orders), deque()
        for order in orders:
            if order == "close":
                return False
            self._obey(order)
        self._send_look()
        self._ping()
        now = self._clock()
        left = self._watch.left(now)
        until_ping = max(self._pinged + PING_EVERY_S - now, 0.05)
        woken, lines, alive = Child.wait(
            self._child, self._wake_out, min(until_ping, left if left is not None else until_ping)
        )
        if woken:
            os.read(self._wake_out, 4096)
        for line in lines:
            self._hear(line)
        if self._child is None:
            return True
        if not alive:
            self._fell(f"ended by itself ({self._child.ending()})")
        elif (late := self._watch.overdue(self._clock())) is not None:
            self._fell(f"did not answer in {getattr(self._patience, late):g} s ({late})")
        return True

    def _obey(self, order: Any) -> None:
        if order == "retry":
            self._restarts.forgive()
            if self._status.state == "refused" and self._ready:
                self._load()
            elif self._status.stuck:
                self._drop()
                self._start("starting")
        elif order == "show":
            self._paints.clear()
            if self._folder is None:
                self._tell(state="off" if self._child is None else self._status.state)
            elif self._child is None and not self._status.stuck:
                self._start("starting")
            elif self._child is not None and not self._watch.owes(READY):
                self._load()
        elif isinstance(order, protocol.Paint):
            self._paints[order.layer] = order
            if self._ready:
                self._say(order)
        elif isinstance(order, protocol.Probe):
            if self._ready:
                self._say(order)
            else:
                self._listener(protocol.Probed(order.number, ()))

    @property
    def _ready(self) -> bool:
        return self._child is not None and not self._watch.owes(READY) and not self._watch.owes(LOADED)

    def _start(self, state: str, message: str = "", details: str = "") -> None:
        self._watch = Watch(self._patience)
        self._sent.clear()
        self._told = -1
        try:
            self._child = Child(self._renderer, self._on_screen, self._command)
        except OSError as error:
            self._tell(
                state="failed", message="The 3D view cannot be started.",
                remedy=f"The system says: {error}. Close other programs and try again.",
            )  # fmt: skip
            return
        self._watch.asked(READY, self._clock())
        self._pinged = self._clock()
        self._tell(state=state, message=message, remedy="", details=details)

    def _drop(self) -> None:
        """End the child, whatever it is doing, and forget its memory."""
        if self._child is not None:
            self._child.kill()
            self._child = None
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _fell(self, why: str) -> None:
        """The child is of no use any more: start another one, unless that was tried too often."""
        assert self._child is not None
        details = self._child.errors()
        if self._status.renderer and self._status.renderer != "OpenGL":
            self._renderer = "opengl"  # the safer one from now on
        self._drop()
        if self._restarts.allowed(self._clock()):
            self._status = replace(self._status, restarts=self._status.restarts + 1)
            self._start("restarting", why, details)
        else:
            self._tell(
                state="failed", message=f"The 3D view {why}, again and again.",
                remedy="Captures and processing are not affected. Update the driver of the graphics card, or try"
                " again.",
                details=details,
            )  # fmt: skip

    def _load(self) -> None:
        if self._folder is None:
            return
        self._say(protocol.Load(self._folder))
        for paint in self._paints.values():
            self._say(paint)
        self._watch.asked(LOADED, self._clock())
        self._tell(state="loading", message="")

    def _send_look(self) -> None:
        """The newest wish, if none is under way and it is not that which was sent last."""
        with self._lock:
            look = self._look
        if look is None or look.number == self._told or not self._ready or self._watch.owes(FRAME):
            return
        needed = slot_bytes(look.width, look.height)
        if self._reader is None or self._reader.slot_bytes < needed:
            try:
                reader = FrameReader(int(needed * _HEADROOM))
            except MemoryFull as error:
                self._drop()
                self._tell(state="failed", message="There is no memory left for pictures.", remedy=str(error))
                return
            if self._reader is not None:
                self._reader.close()
            self._reader = reader
            self._say(protocol.Memory(reader.name, reader.slot_bytes))
        self._sent = {number: sent for number, sent in self._sent.items() if number >= self._told}
        self._sent[look.number] = look
        self._told = look.number
        self._say(look)
        self._watch.asked(FRAME, self._clock())

    def _ping(self) -> None:
        now = self._clock()
        if self._child is not None and now - self._pinged >= PING_EVERY_S and not self._watch.owes(PONG):
            self._pinged = now
            self._say(protocol.Ping(int(now)))
            self._watch.asked(PONG, now)

    def _say(self, message: Any) -> None:
        if self._child is not None:
            self._child.write(protocol.encode(message))

    def _hear(self, line: bytes) -> None:
        now = self._clock()
        try:
            message = protocol.decode(line)
        except protocol.ProtocolError:
            return  # a library's own words, which no watchdog should mind
        match message:
            case protocol.Ready(renderer):
                self._watch.heard(READY, now)
                self._tell(renderer=renderer)
                self._load()
            case protocol.Note(text):
                self._watch.lives(now)
                if self._status.state != "restarting":
                    self._tell(message=text)
            case protocol.Loaded(contents):
                self._watch.heard(LOADED, now)
                if contents.folder == self._folder:
                    self._listener(contents)
                    self._tell(state="showing", message="")
            case protocol.Refused(reason):
                self._watch.heard(LOADED, now)
                self._tell(state="refused", message=reason)
            case protocol.Unable(reason, remedy):
                self._unable(reason, remedy)
            case protocol.Frame():
                self._show(message, now)
            case protocol.Probed():
                self._listener(message)
            case protocol.Pong():
                self._watch.heard(PONG, now)

    def _unable(self, reason: str, remedy: str) -> None:
        assert self._child is not None
        details = self._child.errors()
        self._drop()
        if not self._on_screen and os.environ.get("DISPLAY"):
            self._on_screen = True  # an older Open3D, or a driver, that needs the screen
            self._start("starting")
        else:
            message = f"The 3D view cannot run: {reason}."
            self._tell(state="unable", message=message, remedy=remedy, details=details)

    def _show(self, frame: protocol.Frame, now: float) -> None:
        if frame.number == self._told:
            self._watch.heard(FRAME, now)
        look = self._sent.get(frame.number)
        if look is None or self._reader is None:
            return
        pixels = self._reader.copy(frame.slot, frame.stamp, slot_bytes(frame.width, frame.height))
        if pixels is not None:
            self._listener(
                Picture(
                    pixels, frame.width, frame.height, look, frame.samples, frame.last, frame.milliseconds
                )
            )

    def _tell(self, **changes: Any) -> None:
        self._status = replace(self._status, **changes)
        self._listener(self._status)
