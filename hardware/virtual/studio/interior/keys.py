"""The key of a room (`Interior.key`) without loading it: kept beside the bakes by what is in the scene's files.

Loading takes Mitsuba a quarter of a minute a room, reading the files a tenth of a second. What names a kept key: the scene
file, every file that a word in it leads to (meshes, textures, spectra, scenes that it includes), Mitsuba's release, and our
own text that turns them into a room.
"""

import contextlib
import hashlib
import os
import re
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

from hardware.virtual.studio import solids, tracer
from hardware.virtual.studio.interior import looks, outside, read

READERS = (read, looks, outside, solids, tracer)


def of(path: Path, cache: Path) -> str:
    """As `read.read(path).key`; the scene is loaded once, and again when something in its files changed.

    Raises:
        StudioError: as `read.read`.
    """
    contents = digest(path)
    kept = cache / f"{contents}.key"
    if contents is not None:
        with contextlib.suppress(OSError):  # none there
            if re.fullmatch("[0-9a-f]{16}", key := kept.read_text()):
                return key
    key = read.read(path).key
    if contents is not None:
        with contextlib.suppress(OSError):  # the next call loads the scene again, no more
            cache.mkdir(parents=True, exist_ok=True)
            partial = kept.with_name(f".{kept.name}.{os.getpid()}")
            partial.write_text(key)
            partial.replace(kept)
    return key


def digest(scene: Path) -> str | None:
    """Names what the room is made of; None where the files cannot be read here, and Mitsuba has to say what is wrong."""
    sha = hashlib.sha256(version("mitsuba").encode())
    for module in READERS:
        sha.update(Path(str(module.__file__)).read_bytes())
    try:
        for said, file in _files(scene):
            sha.update(f"{said}\0{file.stat().st_size}\0".encode())
            with file.open("rb") as opened:
                sha.update(hashlib.file_digest(opened, "sha256").digest())
    except (OSError, ElementTree.ParseError):
        return None
    return sha.hexdigest()[:32]


def _files(scene: Path) -> Iterator[tuple[str, Path]]:
    """The scene and all that its words lead to, with these words, in their order. A word that leads to no file is none.

    Words may hold `$name` of a <default>, and lead from the folder of any scene file, from a <path>, or from where we are.
    """
    yield "", scene
    scenes, seen = [scene], {scene}
    folders, defaults = [Path.cwd(), scene.parent], {}
    for file in scenes:  # grows
        for element in ElementTree.parse(file).iter():
            values = list(element.attrib.values())
            if element.tag == "default":
                defaults[element.get("name", "")] = element.get("value", "")
            for name in sorted(defaults, key=len, reverse=True):
                values = [value.replace(f"${name}", defaults[name]) for value in values]
            if element.tag == "path":
                folders += [folder / value for folder in tuple(folders) for value in values]
            for value, folder in ((value, folder) for value in values for folder in tuple(folders)):
                found = folder / value
                if found in seen or not os.path.isfile(found):
                    continue
                seen.add(found)
                yield value, found
                if element.tag == "include":
                    scenes.append(found)
                    folders.append(found.parent)
