"""What the GRBL emulator keeps without power: `$` settings, work offsets, start-up lines, build text.

Source: GRBL 1.1 documentation, "Configuring v1.1" ($-settings, their units and bounds) and "Interface", section
"$ settings message" for how they are printed. Lengths are millimetres as GRBL counts them (a rig's degrees).
"""

from collections.abc import Mapping, Sequence

AXES = 3
LETTERS = "XYZ"
SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30")  # in the order of `$#`
STARTUP_LINES = 2

# Error codes of refused settings.
BAD_VALUE, SHORT_PULSE, NEEDS_HOMING, TOO_FAST, UNKNOWN = 4, 6, 10, 12, 3

_WHOLE = (0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 30, 31, 32)  # printed without decimals
_FLAGS = (4, 5, 6, 13, 20, 21, 22, 32)

DEFAULTS: Mapping[int, float] = {
    0: 10, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0, 20: 0, 21: 0, 22: 0, 23: 0,
    24: 25.0, 25: 500.0, 26: 250, 27: 1.0, 30: 1000, 31: 0, 32: 0,
    100: 250.0, 101: 250.0, 102: 250.0, 110: 500.0, 111: 500.0, 112: 500.0,
    120: 10.0, 121: 10.0, 122: 10.0, 130: 200.0, 131: 200.0, 132: 200.0,
}  # fmt: skip


class Memory:
    """The EEPROM; every method that refuses returns GRBL's error code, 0 for done."""

    def __init__(self, settings: Mapping[int, float] | None = None, step_rate_hz: float | None = None):
        """`step_rate_hz` is the compile-time limit MAX_STEP_RATE_HZ, None when it was not compiled in."""
        self._factory = {**DEFAULTS, **(settings or {})}
        self._step_rate_hz = step_rate_hz
        self.settings = dict(self._factory)
        self.offsets: dict[str, list[float]] = {}
        self.startup = [""] * STARTUP_LINES
        self.build = ""
        self.restore("*")

    def flag(self, number: int) -> bool:
        return bool(self.settings[number])

    def per_axis(self, first: int) -> tuple[float, ...]:
        """The three settings that begin at `first`: 100 steps/mm, 110 mm/min, 120 mm/s2, 130 mm."""
        return tuple(self.settings[first + axis] for axis in range(AXES))

    def store(self, number: int, value: float) -> int:
        if value < 0:
            return BAD_VALUE
        if number not in self.settings:
            return UNKNOWN
        if number >= 100:
            if self._step_rate_hz and number < 120:
                other = self.settings[number + 10 if number < 110 else number - 10]
                if value * other > 60 * self._step_rate_hz:
                    return TOO_FAST
            self.settings[number] = value
            return 0
        if number == 0 and value < 3:
            return SHORT_PULSE
        if number == 20 and int(value) and not self.flag(22):
            return NEEDS_HOMING
        whole = int(value) & 0xFF
        self.settings[number] = bool(whole) if number in _FLAGS else whole if number in _WHOLE else value
        if number in (30, 31):
            self.settings[number] = value
        if number == 22 and not whole:
            self.settings[20] = 0
        return 0

    def restore(self, what: str) -> None:
        """`$` settings, `#` offsets, `*` everything."""
        if what in "$*":
            self.settings = dict(self._factory)
        if what in "#*":
            self.offsets = {name: [0.0] * AXES for name in SYSTEMS}
        if what == "*":
            self.startup = [""] * STARTUP_LINES
            self.build = ""

    def printed(self) -> list[str]:
        """The lines of `$$`."""
        return [
            f"${number}={int(value)}" if number in _WHOLE else f"${number}={value:.3f}"
            for number, value in self.settings.items()
        ]


def placed(values: Sequence[float], inches: bool) -> str:
    """Coordinates as GRBL prints them: three decimals, four in inches."""
    if inches:
        return ",".join(f"{value / 25.4:.4f}" for value in values)
    return ",".join(f"{value:.3f}" for value in values)
