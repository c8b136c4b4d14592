"""What happened during a capture, line by line in `SESSION/capture/journal.jsonl`: for people, and for reports.

One JSON object a line with `time` (UTC) and `event`: started, begun, tried, failed, finished, homed, reconnected,
paused, resumed, left, cancelled, stopped, ended. A line is on the disk before the capture goes on. Nothing is decided by the
journal: which poses are finished is told by the session's shots alone, so a lost or torn line costs nothing.
"""

import datetime
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from engine.io.session import sync, told


def _utc() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


class Journal:
    """An open journal; one thread writes."""

    def __init__(self, path: Path, now: Callable[[], datetime.datetime] = _utc):
        """Open or begin a journal; a line torn by a power cut is ended, so that the next stands by itself.

        Raises:
            SessionError: the disk refuses.
        """
        self._path, self._now = path, now
        with told(path):
            new = not path.exists()
            self._file = path.open("ab")
            if not new and not _ends_whole(path):
                self._file.write(b"\n")
            if new:
                sync(path.parent)

    def note(self, event: str, **facts: Any) -> None:
        """Append one event; it is on the disk when this returns.

        Raises:
            SessionError: the disk refuses.
        """
        line = {"time": self._now().isoformat(timespec="milliseconds"), "event": event, **facts}
        with told(self._path):
            self._file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())

    def close(self) -> None:
        with told(self._path):
            self._file.close()


def _ends_whole(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        if not size:
            return True
        file.seek(size - 1)
        return file.read(1) == b"\n"


def read(path: Path) -> list[dict[str, Any]]:
    """Every whole line of a journal; torn ones are left out. Empty when there is none."""
    events = []
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return []
    for line in content.splitlines():
        try:
            event = json.loads(line)
        except ValueError:
            continue
        if isinstance(event, dict):
            events.append(event)
    return events
