"""Pictures a second of the 3D view while it orbits: 100k triangles and 100k points, 800 x 600.

    python -m tests.bench.view3d [--triangles 100000] [--points 100000] [--size 800 600] [--seconds 10]

Everything is in it: the wish to the drawing process, drawing, shared memory, and the copy in the window's process. The
target is 15 a second on two cores without a graphics card. Prints one line a way to show the emitters.
"""

import argparse
import itertools
import os
import statistics
import tempfile
import threading
import time
from pathlib import Path

from app.viewer import orbit
from app.viewer.events import Event, Picture
from app.viewer.orbit import Orbit
from app.viewer.protocol import Contents, Style
from app.viewer.supervisor import Supervisor
from tests.app.viewer import made

TARGET = 15.0


class Orbiting:
    """Asks for the next picture as soon as one is there, as a hand on the mouse would."""

    def __init__(self, width: int, height: int) -> None:
        self._size = width, height
        self._changed = threading.Condition()
        self._contents: Contents | None = None
        self._pictures: list[tuple[float, Picture]] = []
        self.supervisor = Supervisor(self._hear)

    def _hear(self, event: Event) -> None:
        with self._changed:
            if isinstance(event, Contents):
                self._contents = event
            elif isinstance(event, Picture):
                self._pictures.append((time.perf_counter(), event))
            self._changed.notify_all()

    def open(self, folder: Path) -> Contents:
        self.supervisor.show(folder)
        with self._changed:
            if not self._changed.wait_for(lambda: self._contents is not None, 120) or self._contents is None:
                raise RuntimeError("the drawing process does not come up")
            return self._contents

    def still(self, eye: Orbit, style: Style) -> float:
        """Draw until it gets no better; seconds."""
        start = time.perf_counter()
        number = self.supervisor.look(eye, *self._size, False, style)
        with self._changed:
            self._changed.wait_for(
                lambda: any(p.look.number == number and p.last for _, p in self._pictures[-1:]), 60
            )
        return time.perf_counter() - start

    def orbit(self, eye: Orbit, style: Style, seconds: float) -> list[tuple[float, Picture]]:
        """Orbit; when which picture was there."""
        first = len(self._pictures)
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            eye = orbit.turned(eye, 0.03, 0.0)
            number = self.supervisor.look(eye, *self._size, True, style)
            with self._changed:
                self._changed.wait_for(
                    lambda number=number: self._pictures[-1:] and self._pictures[-1][1].look.number >= number,
                    10,
                )
        return self._pictures[first:]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--triangles", type=int, default=100_000)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--size", type=int, nargs=2, default=(800, 600))
    parser.add_argument("--seconds", type=float, default=10.0)
    args = parser.parse_args()
    side = int((args.triangles / 2) ** 0.5 / 0.97) + 2
    with tempfile.TemporaryDirectory() as folder:
        session = made.session(Path(folder) / "bench.session", 40, side, args.points)
        view = Orbiting(*args.size)
        try:
            start = time.perf_counter()
            contents = view.open(session)
            print(
                f"{contents.triangles} triangles, {contents.emitters} points, {args.size[0]} x {args.size[1]},"
                f" {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f};"
                f" on after {time.perf_counter() - start:.1f} s"
            )
            middle = Orbit(contents.centre, 1.0, 0.5, 0.4, contents.up, contents.front)
            eye = orbit.fitted(middle, contents.centre, 1.3 * contents.radius, args.size[0] / args.size[1])
            for way in ("points", "ellipsoids", "splats"):
                style = Style(emitters=way)
                still_s = view.still(eye, style)
                pictures = view.orbit(eye, style, args.seconds)
                times = [when for when, _ in pictures]
                gaps = [b - a for a, b in itertools.pairwise(times)]
                rate = (len(times) - 1) / (times[-1] - times[0])
                _, last = pictures[-1]
                print(
                    f"{way:10} {rate:6.1f} pictures/s (target {TARGET:g}), median gap {1e3 * statistics.median(gaps):.0f} ms,"
                    f" longest {1e3 * max(gaps):.0f} ms, drawn {last.width} x {last.height} while moving;"
                    f" at rest full after {still_s:.2f} s"
                )
        finally:
            view.supervisor.close()


if __name__ == "__main__":
    main()
