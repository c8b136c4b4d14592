"""What a batch asks of its workers, and what comes back: one order is one child process."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from app.exit_codes import ExitCode
from engine.errors import RoomlightError

NUMBERS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "MALLOC_TRIM_THRESHOLD_",
)
"""Variables that change how number libraries work."""


class BatchError(RoomlightError):
    """Nothing of a batch can run."""


@dataclass(frozen=True, slots=True)
class Order:
    """One task of `app/work/worker.py` about one session."""

    name: str  # of the session; differs from every other order's
    task: str
    request: Mapping[str, Any]  # what JSON knows; paths are absolute
    seconds: float  # that it is expected to take, NaN where nobody knows
    memory_bytes: int
    stages: Mapping[str, float] = field(default_factory=dict)  # that are expected to run -> their seconds


@dataclass(frozen=True, slots=True)
class Ended:
    """How an order ended."""

    name: str
    code: ExitCode
    message: str = ""  # one line, "cause; remedy", where the code is not 0
    seconds: float = 0.0
    result: Mapping[str, Any] = field(default_factory=dict)  # what the task gave back


@dataclass(frozen=True, slots=True)
class Moved:
    """How far an order that runs is."""

    name: str
    stage: str
    fraction: float  # of the stage
    note: str
    machine: str = ""  # that has it
