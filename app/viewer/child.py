"""The drawing process: `python -m app.viewer.child`, wishes on stdin, answers on stdout, pictures in shared memory.

It ends when stdin does, even if a driver hangs. Whatever libraries print goes to stderr. See protocol.py.
"""

import argparse
import os
import sys
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from app import cores
from app.viewer import protocol
from app.viewer.canvas import Canvas, NoGraphics
from app.viewer.drawing import Drawing
from app.viewer.frames import FrameWriter
from engine.errors import RoomlightError, reason
from engine.io.formats.arrays import UNREADABLE

RENDERERS = ("auto", "opengl", "filament")


class Inbox:
    """What the window asked, read by a thread of its own; of several wishes to look only the newest is kept."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._changed = threading.Condition()
        self._waiting: deque[Any] = deque()
        self._look: protocol.Look | None = None

    def start(self) -> None:
        threading.Thread(target=self._read, name="inbox", daemon=True).start()

    def put(self, message: Any) -> None:
        with self._changed:
            if isinstance(message, protocol.Look):
                self._look = message
            else:
                self._waiting.append(message)
            self._changed.notify()

    def take(self, wait: bool) -> Any | None:
        """The next message, the newest look after all others; None when there is none and `wait` is not set."""
        with self._changed:
            if wait:
                self._changed.wait_for(lambda: self._waiting or self._look is not None)
            if self._waiting:
                return self._waiting.popleft()
            look, self._look = self._look, None
            return look

    def _read(self) -> None:
        for line in self._stream:
            self.put(protocol.decode(line))
        # The window is gone. The main thread may be stuck in a driver, so nobody is asked.
        os._exit(0)


class Service:
    """Answers messages by drawing; lives in the thread that made the canvas."""

    def __init__(self, canvas: Canvas, answers: BinaryIO) -> None:
        self._drawing = Drawing(canvas, note=lambda text: self.say(protocol.Note(text)))
        self._answers = answers
        self._writer: FrameWriter | None = None
        self._contents: protocol.Contents | None = None

    def say(self, message: Any) -> None:
        say(self._answers, message)

    @property
    def busy(self) -> bool:
        return self._drawing.pending and self._writer is not None

    def step(self) -> None:
        """Draw a little more of what was asked for last."""
        drawn = self._drawing.step()
        if drawn is None or self._writer is None:
            return
        height, width, _ = drawn.pixels.shape
        slot, stamp = self._writer.write(drawn.pixels)
        self.say(
            protocol.Frame(
                self._drawing.number,
                slot,
                stamp,
                width,
                height,
                drawn.samples,
                drawn.last,
                drawn.milliseconds,
            )
        )

    def handle(self, message: Any) -> None:
        match message:
            case protocol.Look():
                self._drawing.look(message)
            case protocol.Ping(number):
                self.say(protocol.Pong(number))
            case protocol.Memory(name, slot_bytes):
                if self._writer is not None:
                    self._writer.close()
                self._writer = FrameWriter(name, slot_bytes)
            case protocol.Load(folder):
                self._load(Path(folder))
            case protocol.Probe(number, x, y):
                self.say(protocol.Probed(number, self._drawing.probe(x, y)))
            case protocol.Paint(layer, path):
                self._paint(layer, Path(path))

    def _load(self, folder: Path) -> None:
        from app.viewer.scene import load

        try:
            scene = load(folder, lambda text: self.say(protocol.Note(text)))
        except (RoomlightError, OSError) as error:
            self.say(protocol.Refused(str(error)))
            return
        self._drawing.load(scene)
        self._contents = scene.contents
        self.say(protocol.Loaded(scene.contents))

    def _paint(self, name: str, path: Path) -> None:
        from app.viewer.shades import painted

        parts = self._drawing.parts
        if parts is None or self._contents is None or not parts.scene.layers:
            return
        try:
            radiance = np.load(path, allow_pickle=False)
        except UNREADABLE as error:
            self.say(
                protocol.Note(f"{path}: cannot be read ({reason(error)}); the layer {name} stays as it was")
            )
            return
        shape = parts.scene.layers["shaded"].colours.shape
        if radiance.shape != shape:
            self.say(
                protocol.Note(
                    f"{path}: is {radiance.shape}, the maps are {shape}; layer {name} stays as it was"
                )
            )
            return
        parts.paint(name, painted(radiance))
        self._drawing.restart()
        surfaces = tuple(dict.fromkeys((*self._contents.surfaces, name)))
        self._contents = replace(self._contents, surfaces=surfaces)
        self.say(protocol.Loaded(self._contents))


def make_canvas(renderer: str) -> Canvas:
    """
    Raises:
        NoGraphics: nothing here can draw.
    """
    if renderer == "filament" or (renderer == "auto" and _has_card()):
        from app.viewer.canvas_filament import FilamentCanvas

        return FilamentCanvas()
    from app.viewer.canvas_opengl import OpenGLCanvas

    return OpenGLCanvas()


def _has_card() -> bool:
    from app.viewer.vulkan import cards

    return bool(cards())


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m app.viewer.child")
    parser.add_argument("--renderer", choices=RENDERERS, default="auto")
    args = parser.parse_args(argv)
    answers = _own_stdout()
    inbox = Inbox(sys.stdin.buffer)
    inbox.start()
    say(answers, protocol.Note("starting the 3D view"))
    cores.leave_out_plots()
    try:
        canvas = make_canvas(args.renderer)
    except NoGraphics as error:
        say(answers, protocol.Unable(error.reason, error.remedy))
        return 3
    cores.stand_back()  # pictures may come later, keys and clicks may not
    say(answers, protocol.Note("preparing the 3D view"))
    from app.viewer.sprites import prepare

    prepare()
    service = Service(canvas, answers)
    service.say(protocol.Ready(canvas.name))
    while True:
        message = inbox.take(wait=not service.busy)
        if message is not None:
            service.handle(message)
        else:
            service.step()


def say(answers: BinaryIO, message: Any) -> None:
    answers.write(protocol.encode(message))
    answers.flush()


def _own_stdout() -> BinaryIO:
    """The answers' stream; from now on whatever else is printed, by libraries in C too, goes to stderr."""
    own = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return own


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    # Renderers abort when the interpreter takes them down.
    os._exit(code)
