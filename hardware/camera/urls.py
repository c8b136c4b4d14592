"""Open cameras by their device URL: which words each kind knows, and what they become.

gphoto2:usb:001,004?to=ram    folder:/home/me/tethered?suffix=.cr3&bracket=3
virtual:?room=parlour&object=blob&size=320x240&card=/tmp/card
"""

import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hardware.errors import SettingsError
from hardware.interfaces import Angles, Camera
from hardware.urls import DeviceUrl, Word, number, one_of, read_words, size, whole

if TYPE_CHECKING:
    from hardware.virtual.scenes import Scene

CARD = "card"  # the room that takes no time
SAMPLES = 64  # light paths per pixel of the object in a virtual room
Progress = Callable[[float, str], None]


def _path(text: str) -> Path:
    if not text:
        raise ValueError
    return Path(os.path.expanduser(text))


GPHOTO_WORDS = {
    "to": Word(one_of("card", "ram"), "card or to=ram (the camera's memory, gone when it is switched off)"),
    "wait": Word(number(1.0, 3600.0), "15 (seconds from an exposure to its file)"),
}
FOLDER_WORDS = {
    "suffix": Word(str, ".cr3 (nothing else counts)"),
    "bracket": Word(whole(1, 99), "3 (files of one pose)"),
    "wait": Word(number(1.0, 86400.0), "300 (seconds without a new file)"),
}
VIRTUAL_WORDS = {
    "room": Word(str, "parlour or room=card (no room, but at once)"),
    "object": Word(str, "blob"),
    "size": Word(size, "320x240"),
    "seed": Word(whole(0, 2**31), "1"),
    "vignetting": Word(number(0.0, 0.99), "0.2"),
    "samples": Word(whole(1, 4096), "64 (light paths per pixel of the object)"),
    "card": Word(_path, "/tmp/card (a folder to keep its files in)"),
    "cache": Word(_path, "/tmp/studio (a folder for baked rooms)"),
}


def open_url(
    url: DeviceUrl,
    where: Callable[[], Angles] | None,
    tell: Callable[[str], None] | None,
    progress: Progress | None,
    kind: str,
) -> Camera:
    """See `hardware.find.open_camera`."""
    match url.scheme:
        case "gphoto2":
            return _gphoto(url)
        case "folder":
            return _folder(url, tell or _tell_in_terminal)
        case _:
            return _virtual(url, where or _at_zero, progress or _unseen, kind)


def _gphoto(url: DeviceUrl) -> Camera:
    words = read_words("gphoto2", url.query, GPHOTO_WORDS)
    from hardware.camera.gphoto import GphotoConfig, open_camera

    given: dict[str, Any] = {"port": url.place or None, "to_card": words.get("to", "card") == "card"}
    if "wait" in words:
        given["arrive_s"] = words["wait"]
    return open_camera(GphotoConfig(**given))


def _folder(url: DeviceUrl, tell: Callable[[str], None]) -> Camera:
    words = read_words("folder", url.query, FOLDER_WORDS)
    if not url.place:
        raise SettingsError(
            "folder: which one? Write folder:/path/to/tethered, where your tether program stores files"
        )
    from hardware.camera.folder import FolderCamera, FolderConfig

    given: dict[str, Any] = {word: words[word] for word in ("suffix", "bracket") if word in words}
    if "wait" in words:
        given["timeout_s"] = words["wait"]
    return FolderCamera(FolderConfig(_path(url.place), **given), tell)


def _virtual(url: DeviceUrl, where: Callable[[], Angles], progress: Progress, kind: str) -> Camera:
    words = read_words("virtual", url.query, VIRTUAL_WORDS)
    if url.place:
        raise SettingsError(
            f"virtual:{url.place}: nothing stands after the colon; write virtual:?room=parlour&object=blob"
        )
    from hardware.virtual.camera import VirtualCamera, VirtualCameraConfig
    from hardware.virtual.studio import objects, rooms

    room, thing = words.get("room", CARD), words.get("object", "blob")
    if room != CARD:
        # Told now: the room itself is only built at the first exposure.
        _must_be_one_of("room", room, (*rooms.ROOMS, CARD))
        _must_be_one_of("object", thing, objects.OBJECTS)
    elif "object" in words:
        raise SettingsError(
            "virtual: an object stands in a room; say which, as in virtual:?room=parlour&object=blob"
        )
    given: dict[str, Any] = {
        word: words[word] for word in ("size", "seed", "vignetting", "card") if word in words
    }
    config = VirtualCameraConfig(**given)

    def scene() -> "Scene":
        from hardware.virtual import scenes

        if room == CARD:
            return scenes.Card(kind, config.size, config.seed)
        cache = words.get("cache") or _cache()
        return scenes.Studio(room, thing, kind, config.size, words.get("samples", SAMPLES), cache, progress)

    return VirtualCamera(config, scene, where)


def _must_be_one_of(word: str, name: str, there: Iterable[str]) -> None:
    if name not in there:
        raise SettingsError(f"virtual: there is no {word} called {name!r}; choose one of {', '.join(there)}")


def _cache() -> Path:
    """Where `roomlight simulate` keeps its baked rooms too."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "roomlight" / "studio"


def _at_zero() -> Angles:
    return Angles(0.0)


def _tell_in_terminal(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _unseen(fraction: float, note: str) -> None:
    """Nobody watches."""
