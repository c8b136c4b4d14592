"""What a look at a shot found: how bad it is, the number measured, what was seen and what to do about it."""

import enum
from dataclasses import dataclass


class Severity(enum.Enum):
    """How much a finding matters."""

    NOTE = "note"  # good to know; nothing needs to be done
    WARNING = "warning"  # this shot will be of less use: better take it again
    STOP = "stop"  # what follows will be of no use until this is mended


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found in one shot, or in the plan."""

    shot: str  # its name; "" for the plan
    kind: str  # "exposure", "blur", "moved", "overlap", "turn", "plan" or "unreadable"
    severity: Severity
    value: float  # what was measured
    unit: str
    seen: str  # one sentence without its full stop
    remedy: str  # the same, what to do

    @property
    def sentence(self) -> str:
        return f"{self.seen}; {self.remedy}"
