"""What cameras call their settings: '1/250', '0.0100s', 'f/8', '+/- 1 2/3', '75%' as numbers, and which is nearest.

Sources: the choices that libgphoto2's ptp2 driver makes of Canon's, Nikon's, Sony's and the standard's properties.
Shutter times are seconds, brackets EV, batteries 0 to 1.
"""

import math
import re
from collections.abc import Callable, Sequence

from hardware.errors import SettingsError

# Half stops are up to a quarter from what is asked for, the coarsest dials half a stop.
FARTHEST_EV = 0.5
# Nominal ends of a dial: 30 s are 32, 1/8000 s is 1/8192.
ROUNDED_EV = 0.2

_NUMBER = r"(\d+(?:\.\d+)?)"
_SECONDS = re.compile(rf"{_NUMBER}(?:/{_NUMBER})?\s*(?:s|sec|\")?$")
_STOPS = re.compile(r"\+/-\s*(\d+(?:\.\d+)?)?(?:\s*(\d+)/(\d+))?$")


def seconds(choice: str) -> float | None:
    """'1/250', '0.3', '2', '0.0100s', '10/13'; None for bulb, time, auto and flash synchronisation."""
    found = _SECONDS.match(choice.strip().lower())
    if not found:
        return None
    value = float(found[1]) / float(found[2] or 1) if float(found[2] or 1) else 0.0
    return value if value > 0 else None


def f_number(choice: str) -> float | None:
    """'8', 'f/5.6', 'F2'; None for 'implicit auto' and the like."""
    found = re.match(rf"(?:f/?)?\s*{_NUMBER}$", choice.strip().lower())
    return float(found[1]) or None if found else None


def iso(choice: str) -> int | None:
    """'100', 'ISO 6400'; None for 'Auto' and extensions without a number."""
    found = re.match(r"(?:iso\s*)?(\d+)$", choice.strip().lower())
    return int(found[1]) or None if found else None


def bracket_ev(choice: str) -> float | None:
    """'+/- 1 2/3' as 1.667; None for 'off'."""
    found = _STOPS.match(choice.strip())
    if not found or not (found[1] or found[2]):
        return None
    return float(found[1] or 0) + (float(found[2]) / float(found[3]) if found[2] else 0.0)


def battery(text: str) -> float | None:
    """'75%' as 0.75, 'Low' as 0.05; None where the camera does not tell."""
    if text.strip().lower() == "low":
        return 0.05
    found = re.match(r"(\d+)\s*%", text.strip())
    return min(int(found[1]), 100) / 100 if found else None


def offered(choices: Sequence[str], parse: Callable[[str], float | None]) -> dict[float, str]:
    """What each choice means, ascending; those without a number are left out."""
    numbers = {value: choice for choice in choices if (value := parse(choice)) is not None}
    return dict(sorted(numbers.items()))


def nearest(asked: float, values: Sequence[float], what: str, ev_per_octave: float = 1.0) -> float:
    """The offered value nearest to `asked`, in EV.

    Args:
        what: for the message, as "shutter of 2 s".
        ev_per_octave: 2 for f-numbers.

    Raises:
        SettingsError: beyond both ends, or in a gap too wide to call anything in it near.
    """
    best = min(values, key=lambda value: abs(math.log2(value / asked)))
    off = ev_per_octave * abs(math.log2(best / asked))
    outside = not min(values) <= asked <= max(values)
    if off > (ROUNDED_EV if outside else FARTHEST_EV):
        raise SettingsError(
            f"a {what} is not offered: the camera has {told(min(values))} to {told(max(values))}, the nearest is"
            f" {told(best)}; choose another exposure or fewer stops"
        )
    return best


def told(value: float) -> str:
    """0.004 as '1/250', 2.0 as '2'."""
    return f"1/{1 / value:.4g}" if 0 < value < 0.25 else f"{value:.4g}"
