"""Longest time the window stands still while it captures, processes and orbits the 3D view. Median of the runs' longest.

    python -m tests.bench.window [--runs 5] [--seconds 15] [--page view3d] [--where]

The real window with its real children: a virtual capture (no room), `process` of the bundled session, and a scene of
100k triangles and 100k points that is orbited without pause. A timer ticks every 5 ms in the window's thread; a gap is
the time between two ticks. Beside the longest stands the most work that the thread itself did in any: the rest it waited for
a core. `--where` says what the window was doing whenever a gap grew beyond 60 ms.
"""

import argparse
import faulthandler
import os
import re
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from PySide6.QtCore import QObject, Qt, QTimer

from app.viewer import orbit
from app.views.capture.page import CapturePage
from app.views.main_window import MainWindow
from app.views.process.page import ProcessPage
from app.views.view3d.page import View3dPage
from app.work.jobs import Job
from tests.app.viewer import made
from tests.end_to_end import bundled, windowed
from tests.end_to_end.windowed import until

LIMIT_MS = 100.0
TICK_MS = 5
ORBIT_MS = 33
LONG_S = 0.06
SETTLE_S = 3.0  # from showing a page to measuring
RIG, CAMERA = "virtual:grbl?speed=20", "virtual:?size=320x240"
POSES = 400  # more than are taken while this runs


class Ticks(QObject):
    """Counts how late the window's thread comes to its timer."""

    def __init__(self) -> None:
        super().__init__()
        self.last, self._worked = time.perf_counter(), time.thread_time()
        self.gaps: list[tuple[float, float]] = []
        self.timer = QTimer(self)
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(self._tick)
        self.timer.start(TICK_MS)

    def _tick(self) -> None:
        now, worked = time.perf_counter(), time.thread_time()
        self.gaps.append((now - self.last, worked - self._worked))
        self.last, self._worked = now, worked

    def measure(self, seconds: float) -> list[tuple[float, float]]:
        """Gaps of the next `seconds`, and how much of each the window's thread had a core."""
        self.gaps = []
        windowed.live(seconds)
        return self.gaps


class Witness:
    """Looks from another thread what the window does while it is late.

    By faulthandler: whoever holds a frame keeps its locals alive, and a painter that outlives its event crashes Qt.
    """

    def __init__(self, ticks: Ticks) -> None:
        self._ticks, self._main = ticks, f"{threading.get_ident():016x}"
        self.seen: Counter[str] = Counter()
        threading.Thread(target=self._run, name="witness", daemon=True).start()

    def _run(self) -> None:
        with tempfile.TemporaryFile("w+") as file:
            while True:
                time.sleep(0.01)
                if time.perf_counter() - self._ticks.last > LONG_S:
                    file.seek(0)
                    file.truncate()
                    faulthandler.dump_traceback(file)
                    file.seek(0)
                    self.seen[self._stack(file.read())] += 1

    def _stack(self, text: str) -> str:
        """The innermost calls of the window's thread."""
        lines = next(part for part in text.split("\n\n") if self._main in part).splitlines()[1:6]
        return " < ".join(re.sub(r'.*/(.*?)", line (\d+) in (.*)', r"\1:\2 \3", line) for line in lines)


class Load:
    """Everything at the same time."""

    def __init__(self, window: MainWindow, folder: Path) -> None:
        self.window, self._folder = window, folder
        scene = made.session(folder / "scene.session", 40, int(50_000**0.5 / 0.97) + 2, 100_000)
        self._bundled = bundled.copy(bundled.DEMO, folder / "bundled.session")
        window.go_to_session(scene)
        self.view = windowed.page(window, "view3d", View3dPage)
        windowed.scene_of(self.view)
        self._timer = QTimer()
        self._timer.timeout.connect(self._orbit)
        self._job: Job | None = None
        self.pictures = 0
        self._picture = self.view.canvas.picture

    def begin(self) -> None:
        self.capture = windowed.page(self.window, "capture", CapturePage)
        windowed.connect(self.capture, RIG, CAMERA)
        windowed.choose_plan(self.capture, "suited", POSES)
        windowed.start(self.capture, self._folder / "capture.session")
        until(lambda: windowed.taken(self.capture.state) >= 2, "the capture goes on")
        self.keep_processing()
        until(lambda: self._job is not None and self._job.status.stage, "processing goes on")
        self._timer.start(ORBIT_MS)

    def keep_processing(self) -> None:
        """Another run, with another seed, where the last one is done."""
        if self._job is not None and not self._job.status.ended:
            return
        model = windowed.page(self.window, "process", ProcessPage).model
        assert model is not None
        again = self._bundled.with_name(f"bundled{len(self.window.shell.board.queue)}.session")
        bundled.copy(self._bundled, again)
        self._job = model.enqueue(again, "cpu")

    @property
    def going(self) -> str:
        """How far everything is."""
        assert self._job is not None
        status = self._job.status
        return f"{windowed.taken(self.capture.state)} shots, {status.stage} {status.fraction:.0%}, {self.pictures} 3D pictures"

    def _orbit(self) -> None:
        if self.view.canvas.picture is not self._picture:
            self._picture, self.pictures = self.view.canvas.picture, self.pictures + 1
        self.view.canvas.eye_moved.emit(orbit.turned(self.view.state.eye, 0.03, 0.0), True)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--page", default="view3d", help="the page that is shown")
    parser.add_argument("--where", action="store_true")
    args = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    longest, worked = [], []
    with tempfile.TemporaryDirectory(prefix="roomlight-bench-") as scratch:
        os.environ.update(windowed.own_places(Path(scratch) / "xdg"))
        with windowed.opened() as window:
            load = Load(window, Path(scratch))
            load.begin()
            ticks = Ticks()
            witness = Witness(ticks) if args.where else None
            for run in range(args.runs):
                load.keep_processing()
                window.show_page(args.page)
                windowed.live(SETTLE_S)
                gaps = ticks.measure(args.seconds)
                longest.append(1000 * max(gap for gap, _ in gaps))
                worked.append(1000 * max(work for _, work in gaps))
                late = sum(gap > LONG_S for gap, _ in gaps)
                print(
                    f"run {run + 1}: longest gap {longest[-1]:.0f} ms, {late} over {1000 * LONG_S:.0f} ms, most work in one"
                    f" {worked[-1]:.0f} ms; page {args.page}; load {os.getloadavg()[0]:.1f}; {load.going}",
                    flush=True,
                )
    median = statistics.median(longest)
    print(
        f"longest gap between ticks {median:.0f} ms (median of {args.runs} runs' longest; limit {LIMIT_MS:.0f} ms);"
        f" most work between two {statistics.median(worked):.0f} ms;"
        f" page {args.page}, {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}"
    )
    if witness is not None:
        for stack, count in witness.seen.most_common(12):
            print(f"{count:4} {stack}")
    return 0 if median <= LIMIT_MS else 1


if __name__ == "__main__":
    sys.exit(main())
