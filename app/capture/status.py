"""Where a capture stands, as frozen facts: the terminal prints them, the window shows them."""

import enum
from dataclasses import dataclass

from app.capture.order import Pose
from engine.capture_checks.finding import Severity


class Phase(enum.Enum):
    """What a capture is doing."""

    PREPARING = "preparing"
    HOMING = "homing"
    MOVING = "moving"  # and settling
    EXPOSING = "exposing"
    DOWNLOADING = "downloading"
    FILING = "checking and keeping"
    RECOVERING = "recovering"
    PAUSED = "paused"
    LOOKING = "looking at the last photographs"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Finding:
    """Something a person should see; `pose` is "" where it is about the whole capture."""

    pose: str
    text: str
    severity: Severity = Severity.NOTE


@dataclass(frozen=True, slots=True)
class Missing:
    """A pose that was tried and not taken, and why."""

    pose: Pose
    reason: str


@dataclass(frozen=True, slots=True)
class Status:
    """One moment of a capture."""

    phase: Phase = Phase.PREPARING
    pose: Pose | None = None  # the one under way
    taken: int = 0  # poses finished, earlier runs' included
    total: int = 0
    left_s: float | None = None  # until the end at the present pace; None: not known yet
    message: str = ""  # what is being tried again, or waited for, and why
    findings: tuple[Finding, ...] = ()  # of this run, in order
    missing: tuple[Missing, ...] = ()  # left for the end so far; at the end: what is missing


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a capture ended that did not end with an error."""

    taken: int
    total: int
    missing: tuple[Missing, ...]
    cancelled: bool
    findings: tuple[Finding, ...]
