"""How the number libraries share the processor with everything else that runs."""

import os


def share() -> None:
    """Let OpenMP's threads wait asleep (OpenMP 5.2, OMP_WAIT_POLICY); call before torch or numba are loaded.

    By default they spin between the parts of a solve, and on two cores take from a capture, the window or another
    session what nobody gains: a kernel beside other work took half as much processor time again.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
