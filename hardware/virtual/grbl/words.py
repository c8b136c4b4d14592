"""The words of one G-code line, as the GRBL emulator's parser reads them: modal commands, values, first checks.

Sources: NIST RS274NGC version 3, Table 4 (modal groups); GRBL 1.1 documentation, "Interface", table of error codes.
Values are single precision, as on the controller.
"""

import math
import re
import struct
from dataclasses import dataclass, replace

from hardware.virtual.grbl.settings import LETTERS

_MOVES = {0: "G0", 1: "G1", 2: "G2", 3: "G3", 80: "G80"}
_PROBES = {20: "G38.2", 30: "G38.3", 40: "G38.4", 50: "G38.5"}
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
_LARGEST = 3.4e38
_VALUES = "FIJKLNPRSTXYZ"


class Refused(Exception):
    """GRBL answers `error:CODE` and does nothing of the line."""

    def __init__(self, code: int):
        super().__init__(code)
        self.code = code


@dataclass(frozen=True, slots=True)
class Modes:
    """What one line leaves in force for the next."""

    motion: str = "G0"
    system: int = 0  # index of G54 to G59
    plane: str = "G17"
    inches: bool = False
    relative: bool = False
    inverse_time: bool = False
    spindle: str = "M5"
    coolant: str = "M9"
    feed: float = 0.0
    speed: float = 0.0
    tool: int = 0


class Words:
    """The letters and numbers of one line, sorted into commands and values; checks of the first pass."""

    def __init__(self, line: str, modes: Modes, jog: bool):
        self.modes = replace(modes, motion="G1", inverse_time=False) if jog else modes
        self.action = self.axis_command = self.flow = ""
        self.dynamic_tool = False
        self.groups: set[str] = set()
        self.values: dict[str, float] = {}
        at = 0
        while at < len(line):
            letter = line[at]
            if not "A" <= letter <= "Z":
                raise Refused(1)
            number = _NUMBER.match(line, at + 1)
            if number is None:
                raise Refused(2)
            at = number.end()
            self._word(letter, single(float(number[0])))

    @property
    def axes(self) -> set[int]:
        return {axis for axis, letter in enumerate(LETTERS) if letter in self.values}

    def _word(self, letter: str, value: float) -> None:
        if letter in "GM":
            whole = math.trunc(value)
            hundredths = round(100 * (value - whole))
            group = self._g(whole, hundredths) if letter == "G" else self._m(whole, hundredths)
            if group in self.groups:
                raise Refused(21)
            self.groups.add(group)
            return
        if letter not in _VALUES:
            raise Refused(20)
        if letter == "T" and value > 255:
            raise Refused(38)
        if letter in self.values:
            raise Refused(25)
        if letter in "FNPTS" and value < 0:
            raise Refused(4)
        if letter == "N" and value > 10_000_000:
            raise Refused(27)
        self.values[letter] = value

    def _g(self, whole: int, hundredths: int) -> str:
        """Modal group of a G word; takes note of it."""
        rest, group = hundredths, ""
        if whole in (10, 28, 30, 92, 4, 53):
            if whole in (10, 28, 30, 92) and hundredths == 0:
                self._takes_axes("none")
            self.action = f"G{whole}"
            if whole in (28, 30, 92) and hundredths:
                if hundredths != 10:
                    raise Refused(20)
                self.action, rest = f"G{whole}.1", 0
            group = "none"
        elif whole in (0, 1, 2, 3, 38, 80):
            if whole != 80:
                self._takes_axes("motion")
            if whole == 38:
                if hundredths not in _PROBES:
                    raise Refused(20)
                rest = 0
            motion = _PROBES[hundredths] if whole == 38 else _MOVES[whole]
            self.modes = replace(self.modes, motion=motion)
            group = "motion"
        elif whole in (17, 18, 19):
            self.modes, group = replace(self.modes, plane=f"G{whole}"), "plane"
        elif whole in (90, 91) and hundredths == 0:
            self.modes, group = replace(self.modes, relative=whole == 91), "distance"
        elif whole == 91 and hundredths == 10:
            rest, group = 0, "arc distance"
        elif whole in (93, 94):
            self.modes, group = replace(self.modes, inverse_time=whole == 93), "feed mode"
        elif whole in (20, 21):
            self.modes, group = replace(self.modes, inches=whole == 20), "units"
        elif whole == 40:
            group = "cutter"
        elif whole == 49 or (whole == 43 and hundredths == 10):
            self._takes_axes("tool")
            self.dynamic_tool, rest, group = whole == 43, 0, "tool"
        elif 54 <= whole <= 59:
            self.modes, group = replace(self.modes, system=whole - 54), "system"
        elif whole == 61 and hundredths == 0:
            group = "path"
        if not group:
            raise Refused(20)
        if rest > 0:
            raise Refused(23)
        return group

    def _takes_axes(self, what: str) -> None:
        if self.axis_command:
            raise Refused(24)
        self.axis_command = what

    def _m(self, whole: int, hundredths: int) -> str:
        if hundredths > 0:
            raise Refused(23)
        if whole in (0, 1, 2, 30):
            self.flow = "" if whole == 1 else f"M{whole}"
            return "flow"
        if whole in (3, 4, 5):
            self.modes = replace(self.modes, spindle=f"M{whole}")
            return "spindle"
        if whole in (8, 9):
            self.modes = replace(self.modes, coolant=f"M{whole}")
            return "coolant"
        raise Refused(20)


def single(value: float) -> float:
    """As a 32-bit float holds it, as far as one can."""
    return struct.unpack("f", struct.pack("f", min(max(value, -_LARGEST), _LARGEST)))[0]
