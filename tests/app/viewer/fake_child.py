"""A drawing process that draws nothing: speaks the protocol, and misbehaves on request.

`python -m tests.app.viewer.fake_child [--die-at ready|load|look] [--hang-at look] [--unable] [--needs-screen]
[--refuse] [--noise] [--filament-dies] [--slow SECONDS]`. Pictures are filled with the number of their look.
"""

import argparse
import os
import sys
import time

import numpy as np

from app.viewer import protocol
from app.viewer.frames import FrameWriter

POSE = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.5)


def contents(folder: str, surfaces: tuple[str, ...] = ("shaded", "albedo")) -> protocol.Contents:
    """Two cameras in front of one another, some of everything."""
    return protocol.Contents(
        folder, "m", ("first", "second"), (POSE, (*POSE[:-1], 0.8)), 1.5, 0.8, 0.1, 0.3, emitters=12, lamps=1,
        triangles=34, points=5, surfaces=surfaces, room_radius=2.0, radius=0.5,
    )  # fmt: skip


def say(message: object) -> None:
    sys.stdout.buffer.write(protocol.encode(message))
    sys.stdout.buffer.flush()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--renderer", default="auto")
    parser.add_argument("--die-at", default="")
    parser.add_argument("--hang-at", default="")
    parser.add_argument("--slow", type=float, default=0.0)
    for flag in ("--unable", "--needs-screen", "--refuse", "--noise", "--filament-dies"):
        parser.add_argument(flag, action="store_true")
    args = parser.parse_args()

    def reach(place: str) -> None:
        if args.die_at == place:
            print(f"fake: dying at {place}", file=sys.stderr, flush=True)
            os._exit(17)
        while args.hang_at == place:
            time.sleep(60)

    say(protocol.Note("starting"))
    reach("ready")
    if args.unable or (args.needs_screen and "DISPLAY" not in os.environ):
        say(protocol.Unable("it is a fake", "use a real one"))
        return
    say(protocol.Ready("Filament" if args.filament_dies and args.renderer == "auto" else "Fake"))
    writer, surfaces, folder = None, ("shaded", "albedo"), ""
    for line in sys.stdin.buffer:
        if args.noise:
            sys.stdout.buffer.write(b"[Open3D INFO] something to say\n\xff\n")
        match protocol.decode(line):
            case protocol.Memory(name, size):
                writer = FrameWriter(name, size)
            case protocol.Load(wanted):
                reach("load")
                folder = wanted
                say(
                    protocol.Refused("it is damaged; restore it")
                    if args.refuse
                    else protocol.Loaded(contents(folder, surfaces))
                )
            case protocol.Paint(layer, _):
                surfaces = (*surfaces, layer)
                say(protocol.Loaded(contents(folder, surfaces)))
            case protocol.Look() as look:
                reach("look")
                if args.filament_dies and args.renderer == "auto":
                    os._exit(18)
                time.sleep(args.slow)
                assert writer is not None
                pixels = np.full((look.height, look.width, 4), look.number % 251, np.uint8)
                slot, stamp = writer.write(pixels)
                say(protocol.Frame(look.number, slot, stamp, look.width, look.height, 1, True, 1.0))
            case protocol.Ping(number):
                say(protocol.Pong(number))
            case protocol.Probe(number, x, y):
                say(protocol.Probed(number, (x, y, 1.0)))


if __name__ == "__main__":
    main()
