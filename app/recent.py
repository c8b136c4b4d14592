"""What a session's folder shows at a glance, for the start page: no engine, no hashing, a few directory listings.

It may be slow on a network drive, so the window asks in a thread.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from app import places
from app.parameters import STAGES
from app.state import called

# Pictures that an export holds, best first.
PICTURES = ("photograph.png", "albedo.png")


@dataclass(frozen=True, slots=True)
class Glance:
    """One session as the start page shows it."""

    folder: Path
    there: bool
    views: int = 0
    planned: int | None = None  # poses of its capture; None: it was imported
    finished: tuple[str, ...] = ()  # stages with any finished result, in order
    changed: float = 0.0  # seconds since the epoch, of the latest thing that happened to it
    picture: Path | None = None  # an existing file

    @property
    def name(self) -> str:
        return called(self.folder)

    @property
    def capture_unfinished(self) -> bool:
        return self.planned is not None and self.views < self.planned


def look(folder: Path, cache: Path | None = None) -> Glance:
    """Look at a folder; never raises for one that is gone, closed or damaged."""
    try:
        if not (folder / "session.json").is_file():
            return Glance(folder, there=False)
        shots = list((folder / "shots").glob("*/shot.json"))
        finished = tuple(name for name in STAGES if _finished(folder / "stages" / name))
        watched = [folder / "session.json", folder / "shots", folder / "params.toml", folder / "exports"]
        watched += [folder / "stages" / name for name in finished]
        changed = max(path.stat().st_mtime for path in watched if path.exists())
        return Glance(
            folder, True, len(shots), _planned(folder), finished, changed, _picture(folder, cache)
        )  # fmt: skip
    except OSError:
        return Glance(folder, there=False)


def thumbnail_file(folder: Path, cache: Path | None = None) -> Path:
    """Where a small picture of the session is kept between starts: named after its place and its photographs."""
    import hashlib

    try:
        stamp = (folder / "shots").stat().st_mtime_ns
    except OSError:
        stamp = 0
    key = hashlib.sha256(f"{folder.absolute()} {stamp}".encode()).hexdigest()[:24]
    return (cache or places.cache()) / "thumbnails" / f"{key}.png"


def _finished(stage: Path) -> bool:
    return any(path.parent.suffix != ".partial" for path in stage.glob("*/record.json"))


def _planned(folder: Path) -> int | None:
    try:
        return len(json.loads((folder / "capture" / "order.json").read_bytes())["poses"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _picture(folder: Path, cache: Path | None) -> Path | None:
    shown = [folder / "exports" / "latest" / name for name in PICTURES]
    return next((path for path in (*shown, thumbnail_file(folder, cache)) if path.is_file()), None)
