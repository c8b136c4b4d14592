"""What the benchmarks of the light read of a session, and the machine they ran on."""

import os
import platform
import sys
import time
from pathlib import Path

from app import results
from engine.light.fitting.fit import fit
from engine.light.fitting.params import LightParams
from engine.pipeline import run
from engine.progress import Progress
from engine.reference.emitter.two_stage import EmitterParams, train
from engine.types import Frames, Masks, Poses

Inputs = tuple[Frames, Masks, Poses]


def inputs(session: Path) -> Inputs:
    """What the light is fitted to; nothing in the session changes.

    Raises:
        SessionError: hdr, segment or poses has not run.
    """
    load = run.loader(results.steps_of(session))
    return load("hdr", "frames", Frames), load("segment", "masks", Masks), load("poses", "poses", Poses)


def warm(given: Inputs) -> None:
    """Compile every kernel that will be timed, by the smallest fits there are."""
    fit(*given, LightParams(max_gaussians=500, max_image_width=32, epochs=(1,)), 0, Progress())
    train(
        *given, EmitterParams(iterations=2, refinements=2, width=32, degree=1, degree_every=1), 0, Progress()
    )


def machine() -> str:
    """Cores that may be used, and how busy they were when asked."""
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    return f"{platform.machine()}, {cores} cores, load {load:.1f} before the start"


class Clock:
    """Seconds of the wall and of all cores since it was made."""

    def __init__(self) -> None:
        self._wall, self._cores = time.perf_counter(), time.process_time()

    def read(self) -> tuple[float, float]:
        return time.perf_counter() - self._wall, time.process_time() - self._cores


def told(what: str) -> Progress:
    """Progress on standard error, a line every tenth of the way."""
    said = [-1]

    def listen(fraction: float, note: str) -> None:
        if int(10 * fraction) > said[0]:
            said[0] = int(10 * fraction)
            print(f"{what}: {100 * fraction:.0f} % {note}", file=sys.stderr, flush=True)

    return Progress(listen)
