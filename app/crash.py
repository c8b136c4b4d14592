"""Crash reports, kept on this machine alone: `crash-DATE.txt` under XDG_STATE_HOME/roomlight/crashes.

A Python fault is written where it happens. A crash of the process itself (a driver, a library) leaves a trace by
`faulthandler` in `native.txt`, which the next start files away as a report.
"""

import contextlib
import datetime
import faulthandler
import importlib.metadata
import platform
import sys
import traceback
from pathlib import Path
from types import TracebackType
from typing import IO

from app import places

MOST_KEPT = 20


def folder() -> Path:
    return places.state() / "crashes"


def facts() -> str:
    """What somebody who helps has to know of this installation; nothing about the person."""
    lines = [f"Python {sys.version.split()[0]}, {platform.platform()}"]
    for name in ("roomlight", "PySide6-Essentials", "numpy", "torch", "open3d"):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            lines.append(f"{name} {importlib.metadata.version(name)}")
    return "\n".join(lines)


def told(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> str:
    return "".join(traceback.format_exception(kind, error, trace)) + "\n" + facts() + "\n"


def keep(text: str, where: Path | None = None, now: datetime.datetime | None = None) -> Path | None:
    """Write a report; None where the disk refuses. Only the latest are kept."""
    place, moment = where or folder(), now or datetime.datetime.now()
    try:
        place.mkdir(parents=True, exist_ok=True)
        path = place / f"crash-{moment:%Y-%m-%d-%H%M%S-%f}.txt"
        path.write_text(text)
        for old in sorted(place.glob("crash-*.txt"))[:-MOST_KEPT]:
            old.unlink()
    except OSError:
        return None
    return path


def watch(where: Path | None = None) -> tuple[IO[str] | None, Path | None]:
    """Let the next native crash leave a trace; the open file, and the report of the last one if there was any."""
    place = where or folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
        native = place / "native.txt"
        last = (
            keep(f"{native.read_text()}\n{facts()}\n", place)
            if native.is_file() and native.stat().st_size
            else None
        )
        file = native.open("w")
    except (OSError, UnicodeDecodeError):
        return None, None
    faulthandler.enable(file)
    return file, last
