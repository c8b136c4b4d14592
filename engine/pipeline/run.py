"""Run what the plan says: one stage after the other, each finished by one rename or not at all.

A stage works in `stages/<stage>/<fingerprint>.partial`; when all its files are synced the
folder loses its suffix. A run killed at any moment leaves finished stages and at most one `.partial`, which
the next run wipes; stages are deterministic, so the second try gives the same bytes as an undisturbed one.
"""

import contextlib
import ctypes
import importlib.metadata
import os
import platform
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from engine.errors import SessionError
from engine.io.session import Session, lock, read_params, sync, told, write_params
from engine.pipeline import artifacts, stages
from engine.pipeline.settings import Settings, to_toml
from engine.pipeline.stages import Stage, Step, Work
from engine.progress import Progress

DEVICES = ("auto", "cpu", "cuda")


@dataclass(frozen=True, slots=True)
class Watcher:
    """Who is told what happens: a stage begins, moves on, ends after so many seconds, has something to look at meanwhile."""

    begins: Callable[[Step], None] = field(default=lambda step: None)
    moves: Callable[[Step, float, str], None] = field(default=lambda step, fraction, note: None)
    ends: Callable[[Step, float], None] = field(default=lambda step, seconds: None)
    cancelled: Callable[[], bool] = field(default=lambda: False)
    views: Callable[[Step, Callable[[], Any]], None] = field(default=lambda step, make: None)


def process(
    session: Session,
    table: Sequence[Stage],
    settings: Settings,
    device: str = "auto",
    until: str | None = None,
    watcher: Watcher | None = None,
) -> tuple[Step, ...]:
    """Run every stage that is not done, up to `until`; returns the steps as planned.

    Raises:
        SessionError: another process holds the session, the disk refuses, or `device` is not there.
        Cancelled: a stop was asked for; what was finished stays.
        RoomlightError: what a stage has to say about its data.
    """
    watcher = watcher or Watcher()
    with lock(session):
        steps = stages.until(stages.plan(session, table, settings), until)
        waiting = [step for step in steps if not step.done]
        chosen = choose_device(device, needed=bool(waiting))
        if read_params(session) != to_toml(settings):
            write_params(session, to_toml(settings))
        for step in waiting:
            watcher.begins(step)
            start = time.perf_counter()
            _run_stage(session, step, steps, settings, chosen, watcher)
            watcher.ends(step, time.perf_counter() - start)
        _point_to_latest(session, steps)
    return steps


def _run_stage(
    session: Session, step: Step, steps: Sequence[Step], settings: Settings, device: str, watcher: Watcher
) -> None:
    partial = step.folder.with_name(step.folder.name + ".partial")
    with told(partial):
        shutil.rmtree(partial, ignore_errors=True)
        # A folder whose record is unreadable is not a result; the plan counted it as never run.
        shutil.rmtree(step.folder, ignore_errors=True)
        partial.mkdir(parents=True)
    start, cpu = time.perf_counter(), time.process_time()
    _reset_peak_memory()
    progress = Progress(
        lambda fraction, note: watcher.moves(step, fraction, note), watcher.cancelled,
        viewer=lambda make: watcher.views(step, make),
    )  # fmt: skip
    work = Work(
        session, step.params, settings.seed, device, partial, step.given, loader(steps), progress
    )  # fmt: skip
    progress.step(0.0)
    try:
        with told(partial):
            records = step.stage.produce(work)
        for name, record in records.items():
            artifacts.save(partial, name, record)
        seconds = time.perf_counter() - start, time.process_time() - cpu
        _finish(partial, step, settings.seed, device, *seconds)
    except BaseException:
        # Also gives a full disk its space back.
        shutil.rmtree(partial, ignore_errors=True)
        raise


def _finish(partial: Path, step: Step, seed: int, device: str, seconds: float, cpu_seconds: float) -> None:
    """Write the record, sync, rename."""
    record = {
        "stage": step.stage.name,
        "version": step.stage.version,
        "params": stages.counted_params(step.stage, step.params, seed, step.given),
        "inputs": dict(step.inputs),
        "given": step.given,
        "device": device,
        "seconds": round(seconds, 3),
        "cpu_seconds": round(cpu_seconds, 3),
        "peak_memory_bytes": _peak_memory(),
        "finished": time.time(),
        "software": _software(),
    }
    artifacts.save_json(partial / "record.json", record)
    with told(partial):
        # Files too: what a stage wrote itself may still be in memory only.
        for path in partial.rglob("*"):
            sync(path)
        sync(partial)
        partial.rename(step.folder)
        sync(step.folder.parent)


def loader(steps: Sequence[Step]) -> Callable[[str, str, type], Any]:
    """Reads records of the steps' stages: `load(stage, record, type)`.

    The function raises SessionError where the stage has not run with the present settings.
    """
    folders = {step.stage.name: step.folder for step in steps}

    def load(stage: str, record: str, kind: type) -> Any:
        folder = folders[stage]
        if not (folder / "record.json").is_file():
            session = folder.parent.parent.parent
            raise SessionError(
                f"{session}: stage {stage} has not run with the present settings; run"
                f" `roomlight process {session}`"
            )
        return artifacts.load(folder, record, kind)

    return load


def has_cuda() -> bool:
    """Whether torch finds a CUDA device. It takes seconds to load, and is asked only where NVIDIA's driver is."""
    try:
        ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
    except OSError:
        return False
    import torch

    return torch.cuda.is_available()


def choose_device(device: str, needed: bool = True) -> str:
    """ "cpu" or "cuda"; looks for CUDA only when something will run.

    Raises:
        SessionError: CUDA was asked for and is not there.
    """
    if device not in DEVICES:
        raise SessionError(f"device {device!r} is unknown; choose {', '.join(DEVICES)}")
    if device == "cpu" or (device == "auto" and not needed):
        return "cpu"
    if has_cuda():
        return "cuda"
    if device == "cuda":
        raise SessionError(
            "--device cuda: no CUDA device is usable here (torch finds none); use --device cpu, or install"
            " the NVIDIA driver and a torch built with CUDA"
        )
    return "cpu"


def _point_to_latest(session: Session, steps: Sequence[Step]) -> None:
    """`exports/latest` shows the export that belongs to the present settings."""
    for step in steps:
        if step.stage.name != "export":
            continue
        link, beside = session.folder / "exports" / "latest", session.folder / "exports" / ".latest.partial"
        with told(link):
            link.parent.mkdir(exist_ok=True)
            beside.unlink(missing_ok=True)
            beside.symlink_to(os.path.relpath(step.folder, link.parent))
            beside.replace(link)


def _reset_peak_memory() -> None:
    """Start the kernel's high-water mark afresh, where it lets us; else it stays that of the whole run."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_memory() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return 0


def _software() -> Mapping[str, str]:
    names = (
        "roomlight",
        "numpy",
        "scipy",
        "numba",
        "torch",
        "rawpy",
        "pycolmap",
        "opencv-contrib-python-headless",
    )
    found = {"python": platform.python_version()}
    for name in names:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found
