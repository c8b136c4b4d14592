"""The queue between two starts: what waited, or was running when the window closed, in `queue.json`.

A run that was stopped half-way is queued again: its finished stages stay finished. A file that cannot be read or
written costs the queue and nothing else.
"""

import contextlib
import json
from pathlib import Path

from app import places
from app.work.jobs import Job
from app.work.queue import Board


def _path() -> Path:
    return places.state() / "queue.json"


def write(board: Board, path: Path | None = None) -> None:
    """Keep what waits or runs of the queue."""
    place = path or _path()
    content = [
        {"name": job.status.name, "task": job.task, "request": job.request}
        for job in board.queue
        if not job.status.ended
    ]
    with contextlib.suppress(OSError):
        if content:
            places.keep(place, json.dumps(content, indent=1))
        else:
            place.unlink(missing_ok=True)


def read(path: Path | None = None) -> list[Job]:
    """The jobs that waited, not started; sessions that are gone are left out."""
    try:
        content = json.loads((path or _path()).read_bytes())
        rows = [(str(row["name"]), str(row["task"]), dict(row["request"])) for row in content]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [
        Job(name, task, request)
        for name, task, request in rows
        if task == "process" and (Path(str(request.get("session", ""))) / "session.json").is_file()
    ]
