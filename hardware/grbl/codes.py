"""The numbered alarms and errors of each firmware: a name, and what a person can do about each.

What a number means depends on who says it. Source: GRBL 1.1 documentation, "Interface", tables of error and alarm codes
(errors 1 to 17 and 20 to 38, alarms 1 to 9), and GRBL 1.1h, alarm 10; grblHAL, alarms.h and errors.h; FluidNC, Alarm.h
and Error.h. Left out are errors that only files, scripts and networks provoke.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from hardware.errors import PositionLostError, RefusedError

GRBL, GRBLHAL, FLUIDNC = "GRBL", "grblHAL", "FluidNC"


@dataclass(frozen=True, slots=True)
class Code:
    name: str  # what happened
    remedy: str  # what to do about it


_HOME = "home the rig before it moves again"
_RETRY = "a line was damaged on its way: check cable and grounding, then try again"
_OURS = "roomlight does not send such a line, so it was damaged on its way: check cable and grounding"

_SHARED_ALARMS: Mapping[int, Code] = {
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
}  # fmt: skip

_DUAL = "check both switches of the axis, then home again"
_HARDWARE = "switch the controller off, see to what it complains of, then home the rig"

ALARMS: Mapping[str, Mapping[int, Code]] = {
    GRBL: {**_SHARED_ALARMS, 10: Code("homing fail: only one switch of a dual axis was found", _DUAL)},
    GRBLHAL: {
        **_SHARED_ALARMS,
        10: Code("emergency stop", "release the stop button, then home the rig"),
        11: Code("homing required", "home the rig"),
        12: Code("a limit switch is pressed", "move the axis off its switch by hand, then home the rig"),
        13: Code("probe protection", f"unplug the probe, then {_HOME}"),
        14: Code("the spindle did not reach its speed", f"switch the spindle off, then {_HOME}"),
        15: Code("homing fail: the second switch of a dual axis was not found", _DUAL),
        16: Code("its self-test failed", _HARDWARE),
        17: Code("motor fault", "check the motor drivers and their supply, then home the rig"),
        18: Code(
            "homing fail: bad configuration",
            "correct the homing settings: $44 and $45 say which axes home, $22 whether, $130 and $131 how far",
        ),
        19: Code("no answer on Modbus", "check the spindle's cable or switch the spindle off; then home the rig"),
        20: Code("an input/output expander failed", f"check its supply, then {_HOME}"),
        21: Code("its memory failed", _HARDWARE),
    },
    FLUIDNC: {
        **_SHARED_ALARMS,
        10: Code("spindle control", f"check the spindle's wiring, then {_HOME}"),
        11: Code("an input pin was active at the start", "release that switch, then home the rig"),
        12: Code("a limit switch is ambiguous", "move the axis off its switch by hand, then home again"),
        13: Code("hard stop", f"release the stop button, then {_HOME}"),
        14: Code("not homed", "home the rig"),
        15: Code("it has just started", "home the rig"),
        16: Code("an input/output expander was reset", f"check its supply, then {_HOME}"),
        17: Code("a G-code error", f"{_RETRY}; {_HOME} first"),
        18: Code("the probe hit a hard limit", f"unplug the probe, then {_HOME}"),
    },
}  # fmt: skip

_SHARED_ERRORS: Mapping[int, Code] = {
    1: Code("expected a command letter", _RETRY),
    2: Code("bad number format", _RETRY),
    3: Code("invalid $ statement", _RETRY),
    4: Code("negative value where only a positive one can be", _RETRY),
    5: Code(
        "homing is switched off",
        "switch it on with $22=1 if the rig has limit switches; otherwise say homing=none in the device URL",
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

_CONFIG = "correct the controller's configuration file; its start-up messages name the line"

ERRORS: Mapping[str, Mapping[int, Code]] = {
    GRBL: _SHARED_ERRORS,
    GRBLHAL: {
        **_SHARED_ERRORS,
        18: Code("its reset input is active", "release the reset button, then try again"),
        19: Code("zero or negative value where only a positive one can be", _RETRY),
        39: Code("value out of range", _RETRY),
        40: Code("a tool change is pending", "end the tool change at the machine, then try again"),
        43: Code("feed rate beyond its maximum", "lower feed= in the device URL, or raise $110 and $111"),
        45: Code("a limit switch is pressed", "move the axis off its switch by hand, then home the rig"),
        46: Code("homing required", "home the rig; without limit switches switch homing off with $22=0"),
        49: Code("its self-test failed", _HARDWARE),
        50: Code("emergency stop", "release the stop button, then home the rig"),
        51: Code("motor fault", "check the motor drivers and their supply, then home the rig"),
        52: Code("setting out of range", "choose another value"),
        53: Code("switched off by its settings", "switch homing on with $22=1, or say homing=none in the device URL"),
        55: Code("bad homing configuration", "correct $44 and $45, which say the axes that home"),
        56: Code("the work coordinate system is locked", "unlock G54 in the controller's settings"),
        58: Code("an auxiliary port is not available", "correct the controller's settings"),
        79: Code("not allowed while a critical alarm stands", "end what the alarm told, then home the rig"),
    },
    FLUIDNC: {
        **_SHARED_ERRORS,
        18: Code("no homing cycle is configured", "give the axes a homing section, or say homing=none in the device URL"),
        19: Code("homing of a single axis is not allowed", "allow it in the axis' homing section"),
        39: Code("parameter number too high", _OURS),
        40: Code("an input pin is active", "release stop button, door and reset, then try again"),
        80: Code("setting out of range", "choose another value"),
        81: Code("invalid value of a setting", "choose another value"),
        110: Code("it wants a password", "log in at the controller, or switch its passwords off"),
        113: Code("it was reset meanwhile", _HOME),
        120: Code("another interface is using it", "end the job or the connection there, then try again"),
        130: Code("the jog was cancelled", "try again"),
        150: Code("bad pin in its configuration", _CONFIG),
        151: Code("bad setting at run time", _CONFIG),
        152: Code("its configuration is invalid", _CONFIG),
    },
}  # fmt: skip

LOCKED = (9, 46)  # the position is lost, or not known yet


def alarm(number: int, port: str, firmware: str) -> PositionLostError:
    """The error for ALARM:`number`; every alarm locks the controller until it is homed."""
    code = ALARMS[firmware].get(number) or _unlisted(firmware, _HOME)
    return PositionLostError(f"{port}: ALARM:{number}, {code.name}; {code.remedy}")


def error(number: int, line: str, port: str, firmware: str) -> RefusedError | PositionLostError:
    """The error for error:`number` in answer to `line`."""
    code = ERRORS[firmware].get(number) or _unlisted(firmware, "try again")
    text = f"{port}: error:{number}, {code.name} (to {line!r}); {code.remedy}"
    return PositionLostError(text) if number in LOCKED else RefusedError(text)


def _unlisted(firmware: str, next_step: str) -> Code:
    return Code(f"not in our list of {firmware}'s", f"look it up in its manual; then {next_step}")
