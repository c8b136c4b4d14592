"""Cold start of the window: from the start of the process until it is painted and takes events. Median of five.

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

LIMIT_S = 3.0

CHILD = """
import sys, time
from PySide6.QtCore import QTimer
from app.settings import Settings
from app.views import application, theme
from app.views.main_window import MainWindow
app = application.make()
settings = Settings()
theme.install(app, settings.value.theme)
window = MainWindow(settings)
window.show()
def usable():
    window.grab()  # everything in view has been painted once
    print(time.time(), flush=True)
    window.close()
    app.quit()
QTimer.singleShot(0, usable)
app.exec()
"""


def main(runs: int) -> int:
    times = []
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
            times.append(float(answer.stdout.split()[-1]) - start)
    median = statistics.median(times)
    print(
        f"window usable after {median:.2f} s (median of {runs}; first {times[0]:.2f} s; limit {LIMIT_S:.0f} s)"
    )
    return 0 if median <= LIMIT_S else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 5))
