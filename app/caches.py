"""What the program keeps so as not to make it again: how large it is, clearing it, and keeping it elsewhere."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from app import places
from app.words import QT_TRANSLATE_NOOP
from engine.errors import SessionError
from engine.io.session import told

NAMES = {
    "studio": QT_TRANSLATE_NOOP("caches", "Light of virtual rooms"),
    "made": QT_TRANSLATE_NOOP("caches", "Pictures of what stages made"),
    "photographs": QT_TRANSLATE_NOOP("caches", "Contact sheets"),
    "thumbnails": QT_TRANSLATE_NOOP("caches", "Pictures of recent sessions"),
    "bench": QT_TRANSLATE_NOOP("caches", "Sets of the benchmark"),
}
"""Folders that can be cleared while the program runs. Compiled kernels are not: a solve may be about to load them."""


def sizes() -> Mapping[str, int]:
    """Bytes on disk of each of `NAMES`."""
    return {name: _size(places.cache() / name) for name in NAMES}


def clear(name: str) -> None:
    """Remove one of `NAMES`; what is not there is cleared.

    Raises:
        SessionError: the disk refuses.
    """
    folder = places.cache() / name
    with told(folder):
        if folder.is_dir():
            shutil.rmtree(folder)


def move(folder: Path) -> Path:
    """Keep all of it in `folder` from now on. A link stands in its usual place, so that every program finds it there.

    Raises:
        SessionError: something is there already, or the disk refuses; all is where it was.
    """
    usual, there = places.cache(), folder / places.cache().name
    here, partial = usual.resolve(), there.with_name(f".{there.name}.partial")
    if there.exists() and not (there == usual and usual.is_symlink()):
        raise SessionError(f"{there}: is there already; choose another folder")
    with told(there):
        here.mkdir(parents=True, exist_ok=True)
        try:
            shutil.move(here, partial)
        except OSError:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        usual.unlink(missing_ok=True)  # the link, where it was elsewhere before
        partial.rename(there)
        if there != usual:
            usual.symlink_to(there)
    return there


def _size(folder: Path) -> int:
    """Of all files below; what goes away meanwhile counts nothing."""
    total = 0
    for where, _, files in os.walk(folder):
        for file in files:
            try:
                total += (Path(where) / file).stat().st_size
            except OSError:
                continue
    return total
