"""Where this person's settings, state and caches lie (XDG Base Directory Specification 0.8)."""

import os
from pathlib import Path


def config() -> Path:
    """What the person chose."""
    return _home("XDG_CONFIG_HOME", ".config")


def state() -> Path:
    """What survives a restart and is of no use elsewhere: crash reports, the queue."""
    return _home("XDG_STATE_HOME", ".local/state")


def data() -> Path:
    """What was given to the person and is theirs to change: the demo."""
    return _home("XDG_DATA_HOME", ".local/share")


def cache() -> Path:
    """What can be made again."""
    return _home("XDG_CACHE_HOME", ".cache")


def keep(path: Path, text: str) -> None:
    """Replace a small file of the person's: a reader sees the old or the new. Not synced: the window never waits
    for a disk, and what a power cut may cost here can be made again.

    Raises:
        OSError: the disk refuses.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.partial")
    beside.write_text(text)
    beside.replace(path)


def _home(variable: str, otherwise: str) -> Path:
    said = os.environ.get(variable, "")
    # The specification: a path that is not absolute is to be ignored.
    root = Path(said) if os.path.isabs(said) else Path(os.path.expanduser("~")) / otherwise
    return root / "roomlight"
