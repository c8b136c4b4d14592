"""GRBL's numbered alarms and errors: a name, and what a person can do about each.

Source: GRBL 1.1 documentation, "Interface", tables of error and alarm codes (errors 1 to 17 and 20 to 38, alarms 1 to
9; 18 and 19 are FluidNC's, Error.h); GRBL 1.1h, alarm 10; FluidNC, Protocol.h, alarms 10 to 18.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from hardware.errors import PositionLostError, RefusedError


@dataclass(frozen=True, slots=True)
class Code:
    name: str  # what happened
    remedy: str  # what to do about it


_HOME = "home the rig before it moves again"
_RETRY = "a line was damaged on its way: check cable and grounding, then try again"
_OURS = "roomlight does not send such a line, so it was damaged on its way: check cable and grounding"

ALARMS: Mapping[int, Code] = {
    1: Code("hard limit: a limit switch was pressed", f"look what it ran into, or shield its cable; then {_HOME}"),
    2: Code(
        "soft limit: the target lies beyond the controller's own travel",
        "make the configured travel fit $130 and $131, then home the rig",
    ),
    3: Code("reset while it moved: steps may be lost", _HOME),
    4: Code("probe fail: the probe was not in its initial state", f"unplug the probe, then {_HOME}"),
    5: Code("probe fail: the probe made no contact", f"unplug the probe, then {_HOME}"),
    6: Code("homing fail: it was reset meanwhile", "home the rig again"),
    7: Code("homing fail: the safety door was opened", "close the door, then home the rig again"),
    8: Code(
        "homing fail: pulling off did not release the limit switch",
        "raise the pull-off ($27) or check the switch and its wiring, then home again",
    ),
    9: Code(
        "homing fail: no limit switch was found",
        "check switches and wiring, raise the travel ($130, $131) or lower the pull-off ($27); a GRBL that also homes"
        " an axis Z which the rig lacks must be built with HOMING_CYCLE_0 for X and Y only",
    ),
    10: Code(
        "homing fail on a dual axis (FluidNC: spindle control)",
        "check both switches of the axis, or the spindle's wiring; then home again",
    ),
    11: Code("FluidNC: an input pin was active at the start", "release that switch, then home the rig"),
    12: Code("FluidNC: a limit switch is ambiguous", "move the axis off its switch by hand, then home again"),
    13: Code("FluidNC: hard stop", f"release the stop button, then {_HOME}"),
    14: Code("FluidNC: not homed", "home the rig"),
    15: Code("FluidNC: it has just started", "home the rig"),
    16: Code("FluidNC: an input/output expander was reset", f"check its supply, then {_HOME}"),
    17: Code("FluidNC: a G-code error", f"{_RETRY}; {_HOME} first"),
    18: Code("FluidNC: the probe hit a hard limit", f"unplug the probe, then {_HOME}"),
}  # fmt: skip

ERRORS: Mapping[int, Code] = {
    1: Code("expected a command letter", _RETRY),
    2: Code("bad number format", _RETRY),
    3: Code("invalid $ statement", _RETRY),
    4: Code("negative value where only a positive one can be", _RETRY),
    5: Code(
        "homing is switched off",
        "switch it on with $22=1 if the rig has limit switches; otherwise configure the rig with homing=none",
    ),
    6: Code("step pulse below 3 microseconds", "set $0 to 3 or more"),
    7: Code(
        "its memory could not be read, defaults are in force", "set all $ settings of the controller again"
    ),
    8: Code("not idle", "wait until the rig stands, or stop it, then try again"),
    9: Code("locked by an alarm or a jog", _HOME),
    10: Code("soft limits need homing", "set $22=1 before $20=1"),
    11: Code("line too long", _OURS),
    12: Code("step rate too high", "lower $110 and $111, or the steps per degree ($100, $101)"),
    13: Code("safety door open", "close the door, then try again"),
    14: Code("line too long for its memory", "shorten the start-up line or build text"),
    15: Code("jog beyond the travel", "choose an angle within $130 and $131"),
    16: Code("invalid jog command", _OURS),
    17: Code("laser mode needs a PWM spindle", "set $32=0"),
    18: Code("FluidNC: no homing cycle is configured", "give the axes a homing section, or configure homing=none"),
    19: Code("FluidNC: homing of a single axis is not allowed", "allow it in the axis' homing section"),
    20: Code("unsupported command", _RETRY),
    21: Code("two commands of one modal group", _RETRY),
    22: Code("no feed rate", _RETRY),
    23: Code("a command that must be a whole number", _RETRY),
    24: Code("two commands that want axis words", _RETRY),
    25: Code("a word was repeated", _RETRY),
    26: Code("axis words are missing", _RETRY),
    27: Code("invalid line number", _RETRY),
    28: Code("a value word is missing", _RETRY),
    29: Code("there is no such work coordinate system", _RETRY),
    30: Code("G53 without G0 or G1", _OURS),
    31: Code("axis words that nothing uses", _RETRY),
    32: Code("an arc without axis words in its plane", _OURS),
    33: Code("invalid target", _RETRY),
    34: Code("invalid arc radius", _OURS),
    35: Code("an arc without an offset in its plane", _OURS),
    36: Code("unused words", _RETRY),
    37: Code("tool length offset on the wrong axis", _OURS),
    38: Code("tool number too high", _RETRY),
}  # fmt: skip

LOCKED = 9


def alarm(number: int, port: str) -> PositionLostError:
    """The error for ALARM:`number`; every alarm locks the controller until it is homed."""
    code = ALARMS.get(number, Code("an alarm that this version does not know", _HOME))
    return PositionLostError(f"{port}: ALARM:{number}, {code.name}; {code.remedy}")


def error(number: int, line: str, port: str) -> RefusedError | PositionLostError:
    """The error for error:`number` in answer to `line`."""
    code = ERRORS.get(number, Code("an error that this version does not know", "look it up in its manual"))
    text = f"{port}: error:{number}, {code.name} (to {line!r}); {code.remedy}"
    return PositionLostError(text) if number == LOCKED else RefusedError(text)
