"""Cycles of widgets are taken down in the window's thread, and in no other.

Python looks for cycles in whichever thread happens to allocate. Qt takes widgets down in the window's thread only: in any
other one the process dies in Qt's own list of widgets.
"""

import gc

from PySide6.QtCore import QObject, QTimer

LOOK_MS = 1000


def collect_here(parent: QObject) -> None:
    """Let only this thread's event loop look for cycles, about as often as Python would, while `parent` lives."""
    gc.disable()
    timer = QTimer(parent)
    timer.timeout.connect(collect_due)
    timer.start(LOOK_MS)


def collect_due() -> None:
    """Look for cycles in every generation that Python would look at by now."""
    counts = zip(gc.get_count(), gc.get_threshold(), strict=True)
    due = [generation for generation, (count, limit) in enumerate(counts) if count > limit]
    if due:
        gc.collect(due[-1])
