"""Device URLs taken apart: `grbl:///dev/ttyUSB0?baud=115200&axes=xy` is a scheme, a place and settings.

`%20` and the like stand for the characters that have a meaning here (RFC 3986, section 2.1); a plus is a plus.
"""

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from hardware.errors import SettingsError


@dataclass(frozen=True, slots=True)
class DeviceUrl:
    """`scheme:place?query`; place and query are decoded."""

    scheme: str
    place: str
    query: Mapping[str, str]


def parse(text: str, what: str, examples: Mapping[str, str]) -> DeviceUrl:
    """Take a device URL apart.

    Args:
        what: "rig" or "camera", for messages.
        examples: an example of each scheme there is.

    Raises:
        SettingsError: it is none of these; the message lists them.
    """
    possible = ", ".join(examples.values())
    scheme, colon, rest = text.strip().partition(":")
    if not colon:
        raise SettingsError(f"{text!r} is no device URL of a {what}; possible are {possible}")
    if scheme not in examples:
        raise SettingsError(f"{text!r}: there is no {what} of the kind {scheme!r}; possible are {possible}")
    place, _, query = rest.partition("?")
    if place.startswith("//"):
        place = place[2:]
        if not place.startswith("/"):
            raise SettingsError(f"{text!r}: a path has three slashes, as in {scheme}:///{place.lstrip('/')}")
    return DeviceUrl(scheme, unquote(place), _settings(text, query))


def _settings(text: str, query: str) -> dict[str, str]:
    settings: dict[str, str] = {}
    for part in query.split("&") if query else []:
        word, equals, value = part.partition("=")
        if not equals or not word:
            raise SettingsError(f"{text!r}: {part!r} is no setting; write settings as ?word=value&word=value")
        if word in settings:
            raise SettingsError(f"{text!r}: {word}= is said twice; leave one out")
        settings[word] = unquote(value)
    return settings


class UnknownSettingError(SettingsError):
    """A device URL has a setting that this kind of device does not know."""


@dataclass(frozen=True, slots=True)
class Word:
    """A setting of a URL: how its text is read (a ValueError: it cannot be), and an example of it."""

    read: Callable[[str], Any]
    example: str


def read_words(scheme: str, query: Mapping[str, str], words: Mapping[str, Word]) -> dict[str, Any]:
    """The values of the settings given.

    Raises:
        UnknownSettingError: a setting that is not known.
        SettingsError: a value that cannot be meant.
    """
    unknown = sorted(set(query) - set(words))
    if unknown:
        known = ", ".join(sorted(words)) or "none"
        raise UnknownSettingError(
            f"{scheme}: unknown setting {unknown[0]!r} in the device URL; there are {known}"
        )
    values = {}
    for word, text in query.items():
        try:
            values[word] = words[word].read(text)
        except ValueError:
            raise SettingsError(
                f"{scheme}: {word}={text} cannot be meant; write it like {word}={words[word].example}"
            ) from None
    return values


def number(lowest: float, highest: float) -> Callable[[str], float]:
    """Reads a number within bounds."""

    def read(text: str) -> float:
        value = float(text)
        if not lowest <= value <= highest:
            raise ValueError
        return value

    return read


def whole(lowest: int, highest: int) -> Callable[[str], int]:
    """Reads a whole number within bounds."""

    def read(text: str) -> int:
        value = int(text)
        if not lowest <= value <= highest:
            raise ValueError
        return value

    return read


def one_of(*choices: str) -> Callable[[str], str]:
    """Reads one of some words."""

    def read(text: str) -> str:
        if text not in choices:
            raise ValueError
        return text

    return read


def yes(text: str) -> bool:
    """Reads yes or no."""
    if text not in ("yes", "no"):
        raise ValueError
    return text == "yes"


def span(text: str) -> tuple[float, float]:
    """Reads LOWEST..HIGHEST."""
    lowest, highest = map(_finite, text.split(".."))
    if not lowest < highest:
        raise ValueError
    return lowest, highest


def pair(text: str) -> tuple[float, float]:
    """Reads one number for both axes, or two with a comma."""
    numbers = [_finite(part) for part in text.split(",")]
    if len(numbers) > 2:
        raise ValueError
    return numbers[0], numbers[-1]


def _finite(text: str) -> float:
    return number(-sys.float_info.max, sys.float_info.max)(text)


def triple(text: str) -> tuple[float, float, float]:
    """Reads three numbers with commas between."""
    x, y, z = (number(-1e6, 1e6)(part) for part in text.split(","))
    return x, y, z


def size(text: str) -> tuple[int, int]:
    """Reads WIDTHxHEIGHT in pixels."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if not found:
        raise ValueError
    return int(found[1]), int(found[2])
