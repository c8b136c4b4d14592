"""What roomlight must be told of a GRBL rig, and how it is written in a device URL.

    grbl:///dev/ttyUSB0?baud=115200&axes=xy&pan=-180..180&tilt=-40..60&feed=1800&steps=88.889&backlash=0.3
    grbl:///dev/ttyACM0?pan=endless&homing=none

X turns pan and Y turns tilt; GRBL's millimetres are degrees.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from hardware.errors import SettingsError
from hardware.urls import Word, pair, read_words, span, yes

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class GrblConfig:
    """One rig. Pairs are (pan, tilt); of a turntable the second is not used."""

    port: str
    baud: int = 115200
    axes: str = "x"  # "x": turntable; "xy": pan and tilt
    pan: Range | None = (-180.0, 180.0)  # travel, degrees; None: turns endlessly
    tilt: Range = (-45.0, 45.0)
    feed_deg_min: float = 1800.0  # along the path
    steps_per_deg: tuple[float, float] | None = (
        None  # $100 and $101 must say the same; None: they are believed
    )
    backlash_deg: tuple[float, float] = (0.0, 0.0)  # taken up by approaching every angle from below
    homing: str = "switches"  # "none": the place where the rig is homed becomes zero
    home_deg: tuple[float, float] = (0.0, 0.0)  # the angles at which homing leaves it
    wrap: bool = False  # the controller counts pan modulo 360

    def __post_init__(self) -> None:
        _check(self.axes in ("x", "xy"), f"axes={self.axes}", "x for a turntable or xy for pan and tilt")
        _check(self.baud > 0, f"baud={self.baud}", "the controller's baud rate, usually 115200")
        _check(self.homing in ("switches", "none"), f"homing={self.homing}", "switches or none")
        ranges = [("pan", self.pan)] if self.axes == "x" else [("pan", self.pan), ("tilt", self.tilt)]
        for name, travel in ranges:
            if travel is not None:
                good = all(map(math.isfinite, travel)) and travel[0] < travel[1]
                _check(good, f"{name}={travel[0]:g}..{travel[1]:g}", "lowest..highest in degrees")
        _check(_positive(self.feed_deg_min), f"feed={self.feed_deg_min:g}", "degrees per minute, above 0")
        for value in self.steps_per_deg or ():
            _check(_positive(value), f"steps={value:g}", "steps per degree, above 0")
        for value in self.backlash_deg:
            _check(0 <= value < 90, f"backlash={value:g}", "degrees, 0 or a little more")
        for value in self.home_deg:
            _check(math.isfinite(value), f"home={value:g}", "the angle at which homing leaves the rig")

    @classmethod
    def from_query(cls, port: str, query: Mapping[str, str]) -> "GrblConfig":
        """From the words after `?` of a device URL.

        Raises:
            SettingsError: a word that is not known, or a value that cannot be meant.
        """
        return cls(
            port,
            **{FIELDS.get(word, word): value for word, value in read_words("grbl", query, WORDS).items()},
        )


def _check(good: bool, what: str, remedy: str) -> None:
    if not good:
        raise SettingsError(f"grbl: {what} cannot be meant; give {remedy}")


def _positive(value: float) -> bool:
    return math.isfinite(value) and value > 0


def _pan(text: str) -> Range | None:
    return None if text == "endless" else span(text)


WORDS: Mapping[str, Word] = {
    "baud": Word(int, "115200"),
    "axes": Word(str, "xy"),
    "pan": Word(_pan, "-180..180 or pan=endless"),
    "tilt": Word(span, "-45..45"),
    "feed": Word(float, "1800"),
    "steps": Word(pair, "88.889 or steps=88.889,100"),
    "backlash": Word(pair, "0.3 or backlash=0.3,0.5"),
    "homing": Word(str, "switches or homing=none"),
    "home": Word(pair, "-179,0"),
    "wrap": Word(yes, "yes or wrap=no"),
}
# Of `GrblConfig`, where they are not the words themselves.
FIELDS = {
    "feed": "feed_deg_min", "steps": "steps_per_deg", "backlash": "backlash_deg", "home": "home_deg",
}  # fmt: skip
