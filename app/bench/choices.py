"""What a set is of: a room and an object by the studio's own names, or out of files, which their content names.

A set of files is kept under a digest of what the studio reads in them, so that another file of the same name is another set.
Tables show the files' names without suffix (of a `scene.xml` its folder's).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.bench.record import BenchError


@dataclass(frozen=True, slots=True)
class Choice:
    """A room, or an object."""

    asked: str  # as the studio is asked for it
    name: str  # in tables
    key: str  # in the name of a set's folder
    material: str | None = None  # None: its own, or the studio's default


def built_in(name: str) -> Choice:
    """One of the studio's own."""
    return Choice(name, name, name)


def rooms(asked: Sequence[str]) -> tuple[Choice, ...]:
    """
    Raises:
        BenchError: no such name, or one room twice.
        StudioError: a scene that cannot be used, and why.
    """
    from hardware.virtual.studio import rooms as furnished
    from hardware.virtual.studio.interior import read

    names = _names("room", asked, furnished.ROOMS, "a Mitsuba 3 scene.xml")
    return tuple(
        built_in(each)
        if each in furnished.ROOMS
        else _of_file(each, names[each], _room_key(read.read(Path(each))))
        for each in asked
    )


def objects(asked: Sequence[str], material: str | None, seed: int) -> tuple[Choice, ...]:
    """`material` is that of mesh files, painted by `seed`; the studio's own objects keep theirs.

    Raises:
        BenchError: no such name, one object twice, or a material where no object is a file.
        StudioError: a mesh or a material that cannot be used, and why.
    """
    from hardware.virtual.studio import bodies
    from hardware.virtual.studio.objects import OBJECTS

    names = _names("object", asked, OBJECTS, "a mesh file")
    if material is not None and not names:
        raise BenchError(f"--material {material}: is for mesh files, and --objects names none; leave it out")
    return tuple(
        built_in(each) if each in OBJECTS
        else _of_file(each, names[each], bodies.stand(bodies.Thing(each, material=material), seed).body.name, material)
        for each in asked
    )  # fmt: skip


def _room_key(interior: Any) -> str:
    return f"{interior.name}-{interior.key}"


def _of_file(asked: str, name: str, key: str, material: str | None = None) -> Choice:
    return Choice(asked, name if material is None else f"{name}-{material}", _plain(key), material)


def _names(
    what: str, asked: Sequence[str], known: Mapping[str, Any] | Sequence[str], file: str
) -> dict[str, str]:
    """Of those that are files the name in tables: without suffix, after as many of the folders above as tell all apart."""
    files = [each for each in asked if each not in known]
    for each in files:
        if "/" not in each and not Path(each).suffix:
            raise BenchError(
                f"there is no {what} called {each!r}; choose of {', '.join(known)}, or give {file}"
            )
    parts = {each: _parts(Path(each)) for each in files}
    if len(set(parts.values())) < len(files) or len(set(asked)) < len(asked):
        raise BenchError(f"--{what}s: names one {what} twice; name each once")
    taken = [each for each in asked if each in known]
    names = {each: _plain(folders[-1]) for each, folders in parts.items()}
    for depth in range(2, 1 + max(map(len, parts.values()), default=1)):
        every = [*taken, *names.values()]
        alike = [each for each in files if every.count(names[each]) > 1]
        names |= {each: _plain("-".join(parts[each][-depth:])) for each in alike}
    return names


def _parts(path: Path) -> tuple[str, ...]:
    whole = path.resolve()
    return whole.parent.parts if whole.stem == "scene" else (*whole.parent.parts, whole.stem)


def _plain(name: str) -> str:
    """As a file's name and a metric's key may hold it."""
    return re.sub(r"[^\w.+-]+", "_", name)
