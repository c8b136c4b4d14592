"""How the number libraries share the processor with everything else that runs."""

import contextlib
import os
from pathlib import Path


def share() -> None:
    """Let OpenMP's threads wait asleep (OpenMP 5.2, OMP_WAIT_POLICY); call before torch or numba are loaded.

    By default they spin between the parts of a solve, and on two cores take from a capture, the window or another
    session what nobody gains: a kernel beside other work took half as much processor time again.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def stand_back(nice: int) -> None:
    """Let whoever else wants a core have it first; for a process in a session of its own.

    Linux divides its cores among sessions before it looks at the niceness of processes, and only the session's own
    niceness counts between them (sched(7), "The autogroup feature").
    """
    if not nice:
        return
    os.nice(nice)
    with contextlib.suppress(OSError):  # a kernel without the feature needs nothing more
        Path("/proc/self/autogroup").write_text(str(nice))
