"""What one person prefers, in `settings.toml`: theme, recent sessions, window, device.

Nothing here blocks a start: a damaged file is set aside and defaults hold, a single wrong entry is replaced by
its default, and a disk that refuses is told once while the settings live on in memory.
"""

import contextlib
import dataclasses
import tomllib
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tomli_w

from app import places
from app.state import Trouble, Watched

MOST_RECENT = 24


@dataclass(frozen=True, slots=True)
class Preferences:
    """Every preference with its default."""

    theme: Literal["system", "dark", "light"] = "system"
    device: Literal["auto", "cpu", "cuda"] = "auto"
    cores: int = 0  # that what the window starts may use; 0: all
    new_sessions: str = ""  # the folder they are proposed in; "": where the last one went
    recent: tuple[str, ...] = ()  # session folders, latest first
    scheduler: str = ""  # of the cluster that does what is queued, as tcp://head:8786; "" for this machine
    last_folder: str = ""  # where the last file dialog was
    window: str = ""  # size and place, as Qt writes them, in hexadecimal
    shortcuts: dict[str, str] = dataclasses.field(
        default_factory=dict
    )  # keys other than the shipped ones, by what they do


class Settings:
    """The preferences in force; reading and changing them never raises."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path if path is not None else places.config() / "settings.toml"
        self.preferences: Watched[Preferences] = Watched(Preferences())
        self.notice: Trouble | None = None  # the latest thing that went wrong, for the status bar
        self._refused = False
        self._load()

    @property
    def value(self) -> Preferences:
        return self.preferences.value

    def change(self, **facts: Any) -> None:
        """Change preferences by name, and keep them."""
        self.preferences.set(dataclasses.replace(self.value, **facts))
        self._save()

    @property
    def place(self) -> Path:
        """The folder that new sessions are proposed in."""
        return Path(self.value.new_sessions or self.value.last_folder or Path.home())

    def opened(self, session: Path) -> None:
        """Put a session first in the list of recent ones."""
        this = str(session.absolute())
        rest = [other for other in self.value.recent if other != this]
        self.change(recent=(this, *rest)[:MOST_RECENT])

    def forget(self, session: Path) -> None:
        """Take a session from the list; its folder stays."""
        this = str(session.absolute())
        self.change(recent=tuple(other for other in self.value.recent if other != this))

    def _load(self) -> None:
        try:
            content = tomllib.loads(self.path.read_text())
        except FileNotFoundError:
            return
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            aside = self.path.with_name(self.path.name + ".damaged")
            with contextlib.suppress(OSError):
                self.path.replace(aside)
            self.notice = Trouble(
                f"{self.path}: damaged ({error})", f"defaults are in force; the file was kept as {aside.name}"
            )
            return
        except OSError as error:
            self.notice = Trouble(
                f"{self.path}: cannot be read ({error.strerror})",
                "defaults are in force; mind its permissions",
            )
            return
        known = {name: value for name, value in content.items() if _fits(name, value)}
        dropped = sorted(
            content.keys() & {item.name for item in dataclasses.fields(Preferences)} - known.keys()
        )
        if dropped:
            self.notice = Trouble(
                f"{self.path}: {', '.join(dropped)} cannot be meant", "defaults hold for them"
            )
        for name, value in known.items():
            known[name] = tuple(value) if isinstance(value, list) else value
        self.preferences.set(Preferences(**known))

    def _save(self) -> None:
        content = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in dataclasses.asdict(self.value).items()
        }
        try:
            places.keep(self.path, tomli_w.dumps(content))
        except OSError as error:
            if not self._refused:
                self.notice = Trouble(
                    f"{self.path}: settings cannot be kept ({error})", "they hold until the window is closed"
                )
            self._refused = True


def _fits(name: str, value: Any) -> bool:
    """Is this a value for the preference of that name? Unknown names, of a newer version say, are left out."""
    hint = typing.get_type_hints(Preferences).get(name)
    if typing.get_origin(hint) is Literal:
        return value in typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        return isinstance(value, list) and all(isinstance(item, str) for item in value)
    if typing.get_origin(hint) is dict:
        return isinstance(value, dict) and all(isinstance(item, str) for item in value.values())
    return hint is not None and type(value) is hint
