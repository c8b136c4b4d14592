"""What a GRBL controller says, line by line: `parse` makes a reply of any bytes and never fails.

Source: GRBL 1.1 documentation, "Interface": response, push and feedback messages, real-time status reports (fields in
any order after state and position; MPos or WPos by $10; WCO only now and then); grblHAL, report.c and the wiki's page
on status reports (sub-states of every state, up to 8 axes, fields without a value); FluidNC, its boot log. Alarms and start-up messages are found
even in a damaged line, because overlooking one costs more than imagining one; `ok` and `error` must be exact.
"""

import re
from dataclasses import dataclass

LOCKED = ("Alarm", "Sleep", "ConfigAlarm", "Critical")  # wants a reset or `$X`; the position may be lost
STATES = ("Idle", "Run", "Hold", "Jog", "Door", "Check", "Home", "Tool", *LOCKED)

_ERROR = re.compile(rb"error:(\d{1,3})")
_ALARM = re.compile(rb"ALARM:(\d{1,3})")
_BANNER = re.compile(rb"Grbl(?:HAL)? (\d+\.\d+\w?)(?: \[(FluidNC v?[\w.+-]+))?", re.IGNORECASE)
_BOOT = re.compile(rb"\[MSG:INFO: (FluidNC v(\d+\.\d+)[\w.+-]*)")  # its greeting may be any text
_SETTING = re.compile(rb"\$(\d{1,3})=(-?\d{1,9}(?:\.\d{1,9})?)(?: .*)?")
_FEEDBACK = re.compile(rb"\[([\w ]{2,20}):(.*)\]", re.DOTALL)
_NUMBER = r"-?\d{1,9}\.\d{3,4}"  # mm, or inches
_REPORT = re.compile(
    rf"<(?P<state>{'|'.join(STATES)})(?::(?P<sub>\d{{1,3}}))?"
    rf"\|(?P<kind>[MW])Pos:(?P<place>{_NUMBER}(?:,{_NUMBER}){{0,7}})(?P<rest>(?:\|[A-Za-z]\w*(?::[^|<>]*)?)*)>"
)
_OFFSET = re.compile(rf"\|WCO:({_NUMBER}(?:,{_NUMBER}){{0,7}})(?=\||$)")


@dataclass(frozen=True, slots=True)
class Ok:
    """The oldest line not yet answered was accepted."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """The oldest line not yet answered was not executed."""

    code: int


@dataclass(frozen=True, slots=True)
class Alarm:
    code: int


@dataclass(frozen=True, slots=True)
class Banner:
    """It has just started, or was reset."""

    version: str  # "1.1h", or "FluidNC v3.7.8"
    protocol: str  # "1.1h", "3.7"


@dataclass(frozen=True, slots=True)
class Report:
    """One status report, in the units it reports in (mm, or inches by $13)."""

    state: str
    sub: int | None  # of an alarm its number, where the controller tells that
    machine: bool  # is `place` MPos, or WPos?
    place: tuple[float, ...]
    offset: tuple[float, ...] | None  # WCO, when it was told

    @property
    def paused(self) -> bool:
        """At rest in the middle of its work, until `~`."""
        return (self.state == "Hold" and self.sub in (None, 0)) or (
            self.state == "Door" and self.sub in (0, 1)
        )

    @property
    def moving(self) -> bool:
        """In motion, or coming to rest."""
        if self.state == "Hold":
            return self.sub == 1
        return self.state in ("Run", "Jog", "Home") or (self.state == "Door" and (self.sub or 0) > 1)


@dataclass(frozen=True, slots=True)
class Setting:
    number: int
    value: float


@dataclass(frozen=True, slots=True)
class Feedback:
    """[KIND:TEXT], among them [MSG:...], [GC:...], [VER:...]."""

    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Noise:
    """Anything else; `data` may be printed."""

    data: bytes


Reply = Ok | Refusal | Alarm | Banner | Report | Setting | Feedback | Noise


def parse(line: bytes) -> Reply:
    """One line without its end; whatever it is."""
    if line == b"ok":
        return Ok()
    if found := _ERROR.fullmatch(line):
        return Refusal(int(found[1]))
    if line.startswith(b"<"):
        report = _report(line)
        if report is not None:
            return report
    if found := _BOOT.match(line):
        return Banner(found[1].decode("ascii"), found[2].decode("ascii"))
    if found := _FEEDBACK.fullmatch(line):  # before alarms: FluidNC tells of each once more in [MSG:...]
        return Feedback(found[1].decode("ascii", "replace"), found[2].decode("ascii", "replace"))
    if found := _ALARM.search(line):
        return Alarm(int(found[1]))
    if found := _BANNER.search(line):
        protocol = found[1].decode("ascii")
        return Banner(found[2].decode("ascii") if found[2] else protocol, protocol)
    if found := _SETTING.fullmatch(line):
        return Setting(int(found[1]), float(found[2]))
    return Noise(line)


def _report(line: bytes) -> Report | None:
    try:
        found = _REPORT.fullmatch(line.decode("ascii"))
    except UnicodeDecodeError:
        return None
    if found is None:
        return None
    place, offset = _numbers(found["place"]), _OFFSET.search(found["rest"])
    told = _numbers(offset[1]) if offset else None
    if told is not None and len(told) != len(place):
        return None
    sub = found["sub"]
    return Report(found["state"], int(sub) if sub else None, found["kind"] == "M", place, told)


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(number) for number in text.split(","))


def work_place(report: Report, offset: tuple[float, ...]) -> tuple[float, ...]:
    """Work position: WPos = MPos - WCO, or as reported."""
    if not report.machine:
        return report.place
    return tuple(place - shift for place, shift in zip(report.place, offset, strict=False))


def unwrapped(reported: float, near: float, turn: float = 360.0) -> float:
    """The angle that looks like `reported` to a controller that counts modulo `turn`, closest to `near`."""
    return reported + turn * round((near - reported) / turn)


def heard(data: bytes) -> str:
    """Bytes as a person can read them, short."""
    text = data[:60].decode("latin-1")
    return repr(text) + ("..." if len(data) > 60 else "")
