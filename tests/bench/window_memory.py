"""Does the window grow while it captures? Resident memory of its process over 200 shots through the Capture page.

    python -m tests.bench.window_memory [--shots 200]

A virtual capture (no room, small photographs, three exposures a pose) with the Capture page shown: every photograph,
histogram and panorama is drawn. Growth counts from shot 20, when everything is loaded.
"""

import argparse
import gc
import os
import sys
import tempfile
from pathlib import Path

from app.views.capture.page import CapturePage
from tests.end_to_end import windowed
from tests.end_to_end.windowed import until

LIMIT_MB = 100.0
FIRST, STEP = 20, 50
RIG, CAMERA = "virtual:grbl?speed=1000", "virtual:?size=160x120"


def resident_mb() -> float:
    """Of this process, without its children."""
    gc.collect()
    line = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS")
    )
    return int(line.split()[1]) / 1024


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shots", type=int, default=200)
    args = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with tempfile.TemporaryDirectory(prefix="roomlight-bench-") as scratch:
        os.environ.update(windowed.own_places(Path(scratch) / "xdg"))
        with windowed.opened() as window:
            page = windowed.page(window, "capture", CapturePage)
            windowed.connect(page, RIG, CAMERA)
            windowed.choose_plan(page, "suited", args.shots)
            windowed.start(page, Path(scratch) / "long.session")
            marks = [FIRST, *range(STEP, args.shots, STEP), args.shots]
            before = {}
            for mark in marks:
                until(
                    lambda mark=mark: windowed.taken(page.state) >= mark or page.state.ended is not None,
                    f"shot {mark}", 1800,
                )  # fmt: skip
                before[mark] = resident_mb()
                print(f"shot {mark:4}: {before[mark]:6.1f} MB", flush=True)
            windowed.finished(page)
            if windowed.taken(page.state) < args.shots:
                print(f"only {windowed.taken(page.state)} shots were taken: {page.state.ended}")
                return 2
            pictures = len(page.state.findings)
    growth = before[args.shots] - before[FIRST]
    print(
        f"the window grew by {growth:.1f} MB from shot {FIRST} to shot {args.shots} (limit {LIMIT_MB:.0f} MB);"
        f" {pictures} findings; load {os.getloadavg()[0]:.1f}"
    )
    return 0 if growth <= LIMIT_MB else 1


if __name__ == "__main__":
    sys.exit(main())
