"""What the window knows, without Qt: values that can be watched, and the troubles it tells.

Everything here belongs to one thread (the window's); what comes from other threads arrives through
`app/views/bridge.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from app.words import in_window

Value = TypeVar("Value")


def join(listeners: list[Any], listener: Any) -> Callable[[], None]:
    """Let `listener` be told; returns what ends that, as often as it is called."""
    listeners.append(listener)

    def leave() -> None:
        if listener in listeners:
            listeners.remove(listener)

    return leave


class Watched(Generic[Value]):
    """A value whose changes are told to listeners, in the thread that sets it."""

    def __init__(self, value: Value) -> None:
        self._value = value
        self._listeners: list[Callable[[Value], None]] = []

    @property
    def value(self) -> Value:
        return self._value

    def set(self, value: Value) -> None:
        """Nothing is told when nothing changed."""
        if value == self._value:
            return
        self._value = value
        for listener in tuple(self._listeners):
            listener(value)

    def listen(self, listener: Callable[[Value], None]) -> Callable[[], None]:
        """Tell `listener` of every later change; returns what ends that."""
        return join(self._listeners, listener)


@dataclass(frozen=True, slots=True)
class Trouble:
    """An error as a person needs it: what happened, what to do, and details to send to somebody who can help."""

    what: str
    remedy: str = ""
    details: str = ""


def trouble(message: str, details: str = "") -> Trouble:
    """The house's one-line errors say "cause; remedy": told apart at the first semicolon, in the window's words."""
    what, _, remedy = in_window(" ".join(message.split())).partition("; ")
    return Trouble(what, remedy, details)


@dataclass(frozen=True, slots=True)
class Place:
    """What a folder that somebody opens or drops turns out to be."""

    kind: str  # "session", "photographs" (anything else that is a folder), "nothing"
    folder: Path


def place_of(path: Path) -> Place:
    """A session, also when its parent (as `simulate` makes it) or a file in it was meant; else a folder of files."""
    folder = path if path.is_dir() else path.parent
    if not folder.is_dir():
        return Place("nothing", path)
    for candidate in (folder, folder / "session", folder.parent):
        if (candidate / "session.json").is_file() and (candidate != folder.parent or not path.is_dir()):
            return Place("session", candidate)
    return Place("photographs", folder)


def called(session: Path) -> str:
    """What a person calls a session: its folder's name, OUT for `simulate`'s OUT/session."""
    folder = session.absolute()
    return folder.parent.name if folder.name == "session" and folder.parent.name else folder.stem


@dataclass(frozen=True, slots=True)
class Device:
    """One device in the status bar: a rig, a camera, a GPU."""

    key: str  # "rig", "camera", "gpu"
    told: str  # some words
    well: bool = True
    details: str = ""


class State:
    """The session that is open, what one page has of it for the others, and the devices that are connected."""

    def __init__(self) -> None:
        self.session: Watched[Path | None] = Watched(None)
        self.view: Watched[int | None] = Watched(None)  # picked on some page, for the others to turn to
        self.relit: Watched[Path | None] = Watched(None)  # the surface under another light: see `View3dPage`
        self.session.listen(self._forget)
        self.devices: Watched[tuple[Device, ...]] = Watched(())

    def _forget(self, folder: Path | None) -> None:
        self.view.set(None)
        self.relit.set(None)

    def set_device(self, device: Device) -> None:
        """Show a device, in place of what was shown under its key."""
        self.devices.set((*(other for other in self.devices.value if other.key != device.key), device))

    def drop_device(self, key: str) -> None:
        self.devices.set(tuple(other for other in self.devices.value if other.key != key))
