"""Cold start of the window: from the start of the process until it is painted and takes events; and what the first show of each
page then costs its thread, the page's modules loaded as a thread of the window does it before. Medians of five.

    python -m tests.bench.gui_start [RUNS]        (QT_QPA_PLATFORM=offscreen without a screen)

Each run is a process of its own with empty settings. "Cold" is a fresh process: the first run also reads the
files from the disk where the system has not got them in memory; its time is printed beside the median.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time

LIMIT_S = 1.0
PAGE_LIMIT_S = 0.3  # of processor time

CHILD = """
import sys, time
from PySide6.QtCore import QTimer
from app.settings import Settings
from app.views import application, theme
from app.views.main_window import MainWindow
from app.views.pages import PAGES, load
app = application.make()
settings = Settings()
theme.install(app, settings.value.theme)
window = MainWindow(settings)
window.show()
def usable():
    window.grab()  # everything in view has been painted once
    print("usable", time.time())
    for row in PAGES[1:]:
        load(row)
        start = time.thread_time()
        window.show_page(row.key)
        app.processEvents()
        print(row.key, time.thread_time() - start)
    window.close()
    app.quit()
QTimer.singleShot(0, usable)
app.exec()
"""


def main(runs: int) -> int:
    times: list[float] = []
    shows: dict[str, list[float]] = {}
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as home:
            places = {f"XDG_{name}_HOME": home for name in ("CONFIG", "STATE", "CACHE")}
            start = time.time()
            answer = subprocess.run(
                [sys.executable, "-c", CHILD],
                env={**os.environ, **places},
                capture_output=True,
                text=True,
                check=True,
            )
        for line in answer.stdout.splitlines():
            name, value = line.split()
            if name == "usable":
                times.append(float(value) - start)
            else:
                shows.setdefault(name, []).append(float(value))
    median = statistics.median(times)
    print(
        f"window usable after {median:.2f} s (median of {runs}; first {times[0]:.2f} s; limit {LIMIT_S:.1f} s)"
    )
    pages = {name: statistics.median(took) for name, took in shows.items()}
    told = ", ".join(f"{name} {took:.2f}" for name, took in pages.items())
    print(f"first show of a page, s of processor time (limit {PAGE_LIMIT_S:.1f}): {told}")
    return 0 if median <= LIMIT_S and max(pages.values()) <= PAGE_LIMIT_S else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 5))
