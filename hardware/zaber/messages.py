r"""Zaber's ASCII protocol as bytes: commands written, answers read, flags and rejections by name and remedy.

Source: Zaber "ASCII Protocol Reference Manual", firmware 7, sections Message Format, Warning Flags and Reply
Flags. A command is `/ADDRESS AXIS ID TEXT:CHECKSUM\n`; a device answers with one reply `@`, perhaps followed by
info `#`, and may speak of its own accord with an alert `!`. A packet that ends in `\` goes on in an info packet
that begins with `cont`; what was cut there was a space. Axis 0 is the whole device.
"""

import enum
import math
import re
from dataclasses import dataclass

from hardware.errors import HardwareError, PositionLostError, RefusedError, ReplyError

LONGEST_PACKET = 80  # bytes of a command, its line end included (comm.packet.size.max of every device so far)


@dataclass(frozen=True, slots=True)
class Message:
    """One packet from a device. `busy`, `warning` and `rejected` are of replies and alerts, False or "--" in infos."""

    kind: str  # "@" reply, "#" info, "!" alert
    address: int
    axis: int
    id: int | None
    rejected: bool
    busy: bool
    warning: str  # the worst flag in force, "--" for none
    data: str
    goes_on: bool = False  # the rest comes in an info packet
    continues: bool = False  # is the rest of an earlier packet


class Effect(enum.Enum):
    """What a warning flag means for a rig that has to know where it stands."""

    LOST = "position lost"
    BLOCKED = "cannot move"
    INTERRUPTED = "interrupted"
    NOTE = "note"
    NONE = "nothing"


@dataclass(frozen=True, slots=True)
class Flag:
    """A warning flag in words."""

    means: str
    effect: Effect
    remedy: str


_HOME = "home the rig"
_RELEASE = "remove the cause, then home the rig"

# From worst to mildest, the order in which a device shows them.
FLAGS: dict[str, Flag] = {
    "FF": Flag("critical system error", Effect.LOST, "switch the device off and on, then home the rig"),
    "FN": Flag("peripheral not supported", Effect.BLOCKED, "connect a stage that this controller knows"),
    "FZ": Flag(
        "peripheral inactive", Effect.BLOCKED, "connect the stage, or activate it in Zaber's own software"
    ),
    "FH": Flag(
        "emergency stop pressed, driver off", Effect.LOST, "release the emergency stop, then home the rig"
    ),
    "FV": Flag(
        "supply voltage too high or too low, driver off", Effect.LOST, "check the power supply, then home"
    ),
    "FO": Flag("driver off", Effect.LOST, _HOME),
    "FC": Flag(
        "inrush current too high, driver off", Effect.LOST, "check the power supply, then home the rig"
    ),
    "FM": Flag("motor too hot, driver off", Effect.LOST, "let it cool and check the load, then home the rig"),
    "FD": Flag(
        "driver off after overheating or a wrong voltage", Effect.LOST, "let it cool, then home the rig"
    ),
    "FQ": Flag("encoder error", Effect.LOST, "check the encoder's cable, then home the rig"),
    "FI": Flag("index error", Effect.LOST, _HOME),
    "FA": Flag("analog encoder out of step", Effect.LOST, _HOME),
    "FR": Flag("overdrive limit exceeded", Effect.LOST, "lighten the load or go slower, then home the rig"),
    "FS": Flag(
        "stalled and stopped", Effect.LOST, "remove what is in the way or lighten the load, then home"
    ),
    "FB": Flag("stream went out of bounds", Effect.LOST, _HOME),
    "FP": Flag("left its interpolated path", Effect.LOST, _HOME),
    "FE": Flag("went beyond a limit switch", Effect.LOST, _RELEASE),
    "FT": Flag("twisted too far", Effect.LOST, "untwist the cables, then home the rig"),
    "WL": Flag("hit a limit switch where none should be", Effect.LOST, _RELEASE),
    "WV": Flag("supply voltage out of range", Effect.NOTE, "check the power supply"),
    "WT": Flag("controller hot", Effect.NOTE, "let it cool and check its ventilation"),
    "WS": Flag("stalled and recovered", Effect.NOTE, "lighten the load or go slower"),
    "WM": Flag("displaced while it stood", Effect.LOST, "find out what pushed it, then home the rig"),
    "WP": Flag("calibration of the wrong kind", Effect.NOTE, "calibrate it in Zaber's own software"),
    "WR": Flag("no reference position", Effect.LOST, _HOME),
    "WH": Flag("not homed since it was switched on", Effect.NOTE, _HOME),
    "NC": Flag("turned by its knob", Effect.INTERRUPTED, "leave the knob alone and move again"),
    "NI": Flag("movement interrupted", Effect.INTERRUPTED, "move again"),
    "ND": Flag("stream ran dry", Effect.NOTE, ""),
    "NR": Flag("a value was rounded", Effect.NOTE, ""),
    "NT": Flag("a value was cut", Effect.NOTE, ""),
    "NU": Flag("a setting waits to take effect", Effect.NOTE, ""),
    "NJ": Flag("joystick calibrating", Effect.NOTE, ""),
    "NB": Flag("in firmware update mode", Effect.BLOCKED, "finish the update in Zaber's own software"),
}

REJECTIONS: dict[str, str] = {
    "AGAIN": "it cannot do this right now; try again",
    "AXISONLY": "this is for one axis, not for the whole device",
    "BADAXIS": "it has no such axis; correct axes= in the device URL",
    "BADCOMMAND": "it does not know this command; update its firmware or check that it is the device meant",
    "BADDATA": "a value is malformed or out of its range; check steps and limits in the device URL",
    "BADMESSAGEID": "its message id is malformed; the line is disturbed, check the cable",
    "BADSPLIT": "its packets came in the wrong order; the line is disturbed, check the cable",
    "CYCLICONLY": "only a rotary axis can do this; correct axes= in the device URL",
    "DEVICEONLY": "this is for the whole device, not for one axis",
    "DRIVERDISABLED": "its motor driver is off; release the emergency stop, then home the rig",
    "FULL": "its memory is full; delete stored data in Zaber's own software",
    "INACTIVE": "the axis has no active stage; connect it, or activate it in Zaber's own software",
    "LOCKSTEP": "the axis is coupled to another; end lockstep in Zaber's own software",
    "LONGWORD": "a word is longer than it can read; this is a bug, please report it",
    "NOACCESS": "this needs a higher access level",
    "PARKED": "it is parked; unpark it by homing the rig",
    "REMOTE": "a fieldbus has taken control; end that first",
    "STATUSBUSY": "it is busy; wait until it stands still",
    "TWISTED": "its cables are twisted; untwist them, then home the rig",
}


def checksum(body: bytes) -> str:
    """The two hex digits that end a message: what makes the sum of its bytes, after the first, a multiple of 256."""
    return f"{-sum(body) & 0xFF:02X}"


def command(address: int, axis: int, id: int, text: str = "") -> bytes:
    """The bytes of one command; without `text` it only asks for an answer.

    Raises:
        HardwareError: it would not fit into one packet, or has characters that a device does not read.
    """
    body = f"{address} {axis} {id:02d}" + (f" {text}" if text else "")
    packet = f"/{body}:{checksum(body.encode())}\n"
    if len(packet) > LONGEST_PACKET or not re.fullmatch(r"[ -9;-~]+", body):
        raise HardwareError(
            f"{text!r} is no command a Zaber device could read; this is a bug, please report it"
        )
    return packet.encode("ascii")


_REPLY = re.compile(r"@(\d\d) (\d)(?: (\d\d))? (OK|RJ) (IDLE|BUSY) (--|[A-Z]{2})(?: (.*))?")
_ALERT = re.compile(r"!(\d\d) (\d) (IDLE|BUSY) (--|[A-Z]{2})(?: (.*))?")
_INFO = re.compile(r"#(\d\d) (\d)(?: (\d\d))?(?: (cont))?(?: (.*))?")


def read(line: bytes, checked: bool = False) -> Message:
    """What one line from a device says; `checked`: the device ends its messages with checksums, so demand one.

    Raises:
        ReplyError: it is damaged, or no message of this protocol.
    """
    body, has_sum = _without_checksum(line)
    if checked and not has_sum:
        raise ReplyError(f"{_shown(line)}: its checksum is missing; the line is disturbed, check the cable")
    if not re.fullmatch(rb"[ -~]*", body):
        raise ReplyError(f"{_shown(line)}: is no message of a Zaber device; check cable and baud rate")
    text = body.decode("ascii")
    goes_on = text.endswith("\\")
    text = text.removesuffix("\\")
    if found := _REPLY.fullmatch(text):
        address, axis, id, flag, status, warning, data = found.groups()
        return Message("@", int(address), int(axis), None if id is None else int(id), flag == "RJ",
                       status == "BUSY", warning, data or "", goes_on)  # fmt: skip
    if found := _ALERT.fullmatch(text):
        address, axis, status, warning, data = found.groups()
        return Message(
            "!", int(address), int(axis), None, False, status == "BUSY", warning, data or "", goes_on
        )
    if found := _INFO.fullmatch(text):
        address, axis, id, cont, data = found.groups()
        return Message("#", int(address), int(axis), None if id is None else int(id), False, False, "--",
                       data or "", goes_on, cont is not None)  # fmt: skip
    raise ReplyError(f"{_shown(line)}: is no message of a Zaber device; check cable and baud rate")


def _without_checksum(line: bytes) -> tuple[bytes, bool]:
    """The message without its checksum, and whether it had one, which then was right."""
    if not re.fullmatch(rb".*:[0-9A-F]{2}", line, re.DOTALL):
        return line, False
    body = line[:-3]
    if checksum(body[1:]).encode() != line[-2:]:
        raise ReplyError(f"{_shown(line)}: its checksum is wrong; the line is disturbed, check the cable")
    return body, True


def _shown(line: bytes) -> str:
    text = line[:60].decode("ascii", "backslashreplace")
    return repr(text + ("..." if len(line) > 60 else ""))


def refusal(where: str, asked: str, reason: str) -> HardwareError:
    """The error for a rejected command; `where` names port and axis."""
    remedy = REJECTIONS.get(reason, "its manual lists the reason under Reply Flags")
    kind = {"AGAIN": ReplyError, "DRIVERDISABLED": PositionLostError}.get(reason, RefusedError)
    return kind(f"{where}: refused '{asked}' with {reason}: {remedy}")


def flags_in(data: str) -> tuple[str, ...]:
    """The flags that `warnings` answers with, as in "02 FS WR".

    Raises:
        ReplyError: it is not a count followed by that many flags.
    """
    count, *flags = data.split() or [""]
    if (
        not count.isdecimal()
        or int(count) != len(flags)
        or not all(re.fullmatch("[A-Z]{2}", f) for f in flags)
    ):
        raise ReplyError(f"{data!r} is no list of warnings; the line is disturbed, check the cable")
    return tuple(flags)


def number(data: str) -> float:
    """The one number that a device answered.

    Raises:
        ReplyError: it is none.
    """
    try:
        value = float(data)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ReplyError(f"{data[:40]!r} is no number; the line is disturbed, check the cable")
    return value


def severity(name: str) -> int:
    """Place of a flag in the order from worst to mildest; one that is not known ranks first of its letter."""
    order = [*FLAGS, "--"]
    return (
        order.index(name)
        if name in order
        else next((place for place, known in enumerate(order) if known[0] == name[0]), 0)
    )


def flag(name: str) -> Flag:
    """The flag in words; an unknown one counts as what its first letter says: F fault, W warning, N note."""
    if name == "--":
        return Flag("nothing to report", Effect.NONE, "")
    if name in FLAGS:
        return FLAGS[name]
    effect = Effect.LOST if name.startswith("F") else Effect.NOTE
    return Flag(
        "a flag this version does not know", effect, "look it up in the device's manual, then home the rig"
    )
