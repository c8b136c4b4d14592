"""One measurement as one JSON record: what was run where, and every number with its unit and what counts as worse."""

import functools
import importlib.metadata
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from app import places
from app.sources import digest
from engine.errors import RoomlightError

SCHEMA = 1
PACKAGES = ("roomlight", "numpy", "scipy", "numba", "torch", "mitsuba")
DIRECTIONS = ("lower", "higher")


class BenchError(RoomlightError):
    """What was asked of the benchmark does not fit together, or a file of it cannot be read or written."""


@dataclass(frozen=True, slots=True)
class Metric:
    """One number. `direction` is the better one; `tolerance`, in the value's unit, is how much worse passes the gate.

    A metric without tolerance (seconds, bytes) is never gated: it tells of the machine.
    """

    key: str  # as window-duo/standard/normal
    value: float
    unit: str
    direction: str  # "lower" | "higher"
    tolerance: float | None = None
    extrapolated: bool = False


@dataclass(frozen=True, slots=True)
class Record:
    """One call of `roomlight bench`."""

    command: str
    size: str
    inputs: str
    seed: int
    machine: Mapping[str, Any]
    versions: Mapping[str, str]
    metrics: tuple[Metric, ...]
    # What a table is made of, group by group: a table may be printed of several records.
    rows: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    # Mask and poses of every set, where they were estimated (`estimated.Estimated`); older records have none.
    estimated: Sequence[Mapping[str, Any]] = field(default_factory=list)


def write(record: Record, path: Path) -> None:
    """As JSON, NaN and infinities as null.

    Raises:
        BenchError: the disk refuses.
    """
    metrics = [asdict(m) | {"value": m.value if math.isfinite(m.value) else None} for m in record.metrics]
    content = {"schema": SCHEMA} | asdict(record) | {"metrics": metrics}
    try:
        places.keep(path, json.dumps(content, indent=1) + "\n")
    except OSError as error:
        raise BenchError(
            f"{path}: cannot be written ({error.strerror or error}); name another file"
        ) from error


def read(path: Path) -> Record:
    """What `write` wrote.

    Raises:
        BenchError: the file is gone, is no record, or of another schema.
    """
    try:
        content = json.loads(path.read_bytes())
        if content.pop("schema") != SCHEMA:
            raise ValueError(f"its schema is not {SCHEMA}")
        metrics = tuple(
            Metric(**(entry | {"value": math.nan if entry["value"] is None else float(entry["value"])}))
            for entry in content.pop("metrics")
        )
        for metric in metrics:
            if metric.direction not in DIRECTIONS:
                raise ValueError(f"{metric.key} has direction {metric.direction!r}")
            if metric.tolerance is not None and not metric.tolerance >= 0:
                raise ValueError(f"{metric.key} has tolerance {metric.tolerance!r}")
        return Record(**content, metrics=metrics)
    except OSError as error:
        raise BenchError(
            f"{path}: cannot be read ({error.strerror or error}); name a record of `bench`"
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BenchError(
            f"{path}: is no record of `roomlight bench` ({error}); make one with --write-baseline"
        ) from error


def machine(device: str) -> dict[str, Any]:
    """Processor, cores this process may use, memory, and the GPU where it computes on one."""
    facts: dict[str, Any] = {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        "gpu": None,
    }
    if device == "cuda":
        import torch

        facts["gpu"] = torch.cuda.get_device_name()
    return facts


def versions() -> dict[str, str]:
    """Of Python, the packages that compute, the studio that made the sets, and the solvers' source."""
    from hardware.virtual.studio import shoot

    found = {"python": platform.python_version(), "studio": str(shoot.VERSION), "engine": engine_digest()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


@functools.cache
def engine_digest() -> str:
    """Names the content of the engine's and the baselines' source: another text may compute another result."""
    import engine

    (root,) = engine.__path__
    return digest(Path(root), Path(__file__).parent / "baselines")


def told(record: Record) -> str:
    """The line under a table: where it was measured, with what."""
    where = record.machine
    parts = [
        str(where["processor"]),
        f"{where['cores']} core{'s' * (where['cores'] != 1)}",
        f"{where['memory_gb']} GB",
    ]
    parts += [str(where["gpu"])] if where["gpu"] else []
    known: Sequence[str] = [
        f"{name} {record.versions[name]}" for name in ("roomlight", "python", "numba", "torch")
    ]
    return f"{', '.join(parts)}; {', '.join(known)}; seed {record.seed}"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
