"""What a set is of: a room and an object by the studio's own names, or out of files, which their content names.

A set of files is kept under a digest of what the studio reads in them, so that another file of the same name is another set,
and so is another material, size or place. Tables show the files' names without suffix (of a `scene.xml` its folder's), and
after them what else was asked for.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app import places
from app.bench.record import BenchError

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Choice:
    """A room, or an object."""

    asked: str  # as the studio is asked for it
    name: str  # in tables
    key: str  # in the name of a set's folder
    material: str | None = None  # this and the following; None: its own, or the studio's default
    size_m: float | None = None
    turn_deg: float | None = None
    place: Place | None = None


def built_in(name: str) -> Choice:
    """One of the studio's own."""
    return Choice(name, _plain(name), _plain(name))


def rooms(asked: Sequence[str], place: Place | None = None) -> tuple[Choice, ...]:
    """`place` is the rig's in a scene file's frame.

    Raises:
        BenchError: no such name, one room twice, or a place for other than one scene file.
        StudioError: a scene that cannot be used, and why.
    """
    from hardware.virtual.studio import rooms as furnished

    names = _names("room", asked, furnished.ROOMS, furnished.is_built_in, "a Mitsuba 3 scene.xml")
    if place is not None and (len(names), len(asked)) != (1, 1):
        raise BenchError(
            f"--place: is a place in one scene file, and --rooms names {', '.join(asked)}; name one file, or leave it out"
        )
    return tuple(
        built_in(each) if furnished.is_built_in(each) else _room(each, names[each], place) for each in asked
    )


def objects(
    asked: Sequence[str],
    material: str | None,
    seed: int,
    size_m: float | None = None,
    turn_deg: float | None = None,
) -> tuple[Choice, ...]:
    """`material`, size and turn are those of mesh files, painted by `seed`; the studio's own objects keep theirs.

    Raises:
        BenchError: no such name, one object twice, or a material, size or turn where no object is a file.
        StudioError: a mesh, a material, a size or a turn that cannot be used, and why.
    """
    from hardware.virtual.studio.objects import OBJECTS, is_built_in

    names = _names("object", asked, OBJECTS, is_built_in, "a mesh file")
    for option, value in {"--material": material, "--object-size": size_m, "--turn": turn_deg}.items():
        if value is not None and not names:
            raise BenchError(f"{option} {value}: is for mesh files, and --objects names none; leave it out")
    return tuple(
        built_in(each) if is_built_in(each) else thing(each, names[each], material, seed, size_m, turn_deg)
        for each in asked
    )


def _room(asked: str, name: str, place: Place | None) -> Choice:
    from hardware.virtual.studio.interior import keys
    from hardware.virtual.studio.order import called

    key = f"{called(Path(asked))}-{keys.of(Path(asked), places.cache() / 'studio')}"
    at = "" if place is None else "-at-" + "_".join(f"{x:.9g}" for x in place)
    return Choice(asked, name + at, _plain(key + at), place=place)


def picked(option: str, asked: Sequence[str], known: Iterable[str]) -> tuple[str, ...]:
    """Of the known names those that were asked for, all if none is.

    Raises:
        BenchError: none is called so.
    """
    names = tuple(known)
    for name in asked:
        if name not in names:
            raise BenchError(f"{option}: there is none called {name!r}; choose of {', '.join(names)}")
    return tuple(name for name in names if not asked or name in asked)


def thing(
    asked: str,
    name: str,
    material: str | None,
    seed: int,
    size_m: float | None = None,
    turn_deg: float | None = None,
) -> Choice:
    """An object that is changed, built in or a mesh, called `name` and after what it is made of.

    Raises:
        StudioError: as `objects`.
    """
    from hardware.virtual.studio import bodies

    key = bodies.stand(bodies.Thing(asked, size_m, material, turn_deg or 0.0), seed).body.name
    name += "" if material is None else f"-{material}"
    name += "" if size_m is None else f"-{size_m:g}m"
    name += "" if turn_deg is None else f"-{turn_deg:g}deg"
    return Choice(asked, _plain(name), _plain(key), material, size_m, turn_deg)


def _names(
    what: str, asked: Sequence[str], known: Mapping[str, Any], own: Callable[[str], bool], file: str
) -> dict[str, str]:
    """Of those that are files the name in tables: without suffix, after as many of the folders above as tell all apart."""
    files = [each for each in asked if not own(each)]
    for each in files:
        if "/" not in each and not Path(each).suffix:
            raise BenchError(
                f"there is no {what} called {each!r}; choose of {', '.join(known)}, or give {file}"
            )
    parts = {each: _parts(Path(each)) for each in files}
    if len(set(parts.values())) < len(files) or len(set(asked)) < len(asked):
        raise BenchError(f"--{what}s: names one {what} twice; name each once")
    taken = [each for each in asked if own(each)]
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
