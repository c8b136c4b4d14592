"""How the number libraries share the processor with everything else that runs, and keep what they compile."""

import atexit
import contextlib
import ctypes
import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType

from app import places
from app.sources import digest

UNUSED_S = 30 * 24 * 3600.0
"""After which kernels that no program asked for are thrown away."""


def prepare() -> None:
    """What every process of ours does before it loads torch, numba or Open3D."""
    share()
    keep_kernels()
    leave_out_plots()


def share() -> None:
    """Let OpenMP's threads wait asleep (OpenMP 5.2, OMP_WAIT_POLICY), and one thread do a product of matrices; call before numpy,
    torch or numba are loaded.

    By default they spin between the parts of a solve, and on two cores take from a capture, the window or another
    session what nobody gains: a kernel beside other work took half as much processor time again.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    # Products divided among threads sum in another order on another number of cores; ours are many, and run side by side.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Numba asks for TBB first, and warns on the terminal where it finds an old one, as Open3D brings.
    os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp tbb workqueue")


def keep_kernels(source: Path = Path(__file__).parents[1]) -> None:
    """Let Numba keep its compiled kernels by the text of all of them; call before numba is loaded.

    Numba compiles a kernel anew when its own file changes, not when that of another kernel does which it takes in
    (Numba manual, "Caching limitations"): after an update of some files it would go on with the old law in them.
    Where a person's cache cannot be written, kernels are kept for this run alone: Numba would refuse to compile them.
    Those of earlier texts go when they have not been asked for in a month.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    folder = places.cache() / "kernels" / digest(source / "engine", source / "app", holding=b"numba")
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for other in folder.parent.iterdir():
            if time.time() - other.stat().st_mtime > UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)
    if not os.access(folder, os.W_OK):
        folder = Path(tempfile.mkdtemp(prefix="roomlight-kernels-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def leave_out_plots() -> None:
    """Let Open3D come without its plots in a browser, which nobody asks for; call before it is loaded.

    They need Dash, which takes half of the second and a half that Open3D takes.
    """
    plots = ModuleType("open3d.visualization.draw_plotly")
    for name in ("get_plotly_fig", "draw_plotly", "draw_plotly_server"):
        setattr(plots, name, None)
    sys.modules.setdefault(plots.__name__, plots)


def die_with_starter() -> None:
    """Let Linux kill this process the moment the thread that started it ends, however that ends (prctl(2), PR_SET_PDEATHSIG)."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


def hold_to(count: int) -> None:
    """Let this process and what it starts run on so many cores; 0: on all. Call before libraries count them."""
    there = sorted(os.sched_getaffinity(0))
    if 0 < count < len(there):
        os.sched_setaffinity(0, there[-count:])


NICE = 5
"""A third of the weight of a program that does not stand back (sched(7))."""


def stand_back() -> None:
    """Let the window have a core the moment it asks for one; beside other programs this thread and those it starts keep a fair share.

    A batch thread never interrupts who is at work when it wakes up (sched(7), SCHED_BATCH). Linux divides its cores among sessions
    before it looks at the niceness of processes ("The autogroup feature"), so the session has the same small one: a child is in
    one of its own, and with none the window waits for it.
    """
    os.nice(NICE)
    with contextlib.suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(NICE))
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
