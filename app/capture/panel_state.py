"""What the capture page shows, as frozen facts, and how each event of the desk changes them: `heard`, a pure function.

Events are those of `app/capture/desk/serving.py`; angles are degrees as the rig counts them, times seconds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from app.capture.status import Phase, Severity
from app.state import Trouble, trouble
from hardware.find import Port
from hardware.interfaces import CameraStatus, State

CAPTURES = frozenset({"start", "resume"})  # the orders that are captures
PAUSES = {"pause": True, "go_on": False}


@dataclass(frozen=True, slots=True)
class Found:
    """What is plugged in."""

    ports: tuple[Port, ...] = ()
    cameras: tuple[tuple[str, str], ...] = ()  # (device URL, name)
    rigs: tuple[str, ...] = ()  # an example of each kind of rig's URL


@dataclass(frozen=True, slots=True)
class AxisFacts:
    """One axis; None: turns endlessly."""

    name: str
    lowest_deg: float | None
    highest_deg: float | None
    fastest_deg_s: float


@dataclass(frozen=True, slots=True)
class RigFacts:
    """The rig that is open."""

    name: str
    axes: tuple[AxisFacts, ...]
    automatic: bool
    homes: bool
    holds: bool
    reports_angles: bool


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """The camera that is open; empty where it does not tell."""

    name: str
    model: str
    shutters_s: tuple[float, ...]
    isos: tuple[int, ...]
    apertures: tuple[float, ...]
    sets_exposure: bool
    suffix: str


@dataclass(frozen=True, slots=True)
class Where:
    """What the rig last said of itself; None: nobody knows."""

    state: State = State.OFFLINE
    pan_deg: float | None = None
    tilt_deg: float | None = None
    message: str = ""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Counts of pixels in even steps of log2 light, in the exposure shown; above bin `white` the sensor is full."""

    red: tuple[int, ...]
    green: tuple[int, ...]
    blue: tuple[int, ...]
    white: int
    per_ev: int  # bins of one EV


@dataclass(frozen=True, slots=True)
class Picture:
    """The newest photograph; `pose` "" for one that was not kept. Shares of its pixels."""

    png: Path
    clip_png: Path | None  # what is clipped, to lay over it; None where that cannot be told
    pose: str
    clipped: float  # in every exposure
    clipped_here: float  # in the one shown
    dark: float  # lost in noise in the longest exposure
    histogram: Histogram | None
    shutter_s: float | None


@dataclass(frozen=True, slots=True)
class PlannedPose:
    """None: wherever a person holds it."""

    name: str
    pan_deg: float | None
    tilt_deg: float | None


@dataclass(frozen=True, slots=True)
class Planned:
    """What a plan would be, and what a person should know of it."""

    poses: tuple[PlannedPose, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Missed:
    """A pose that was tried and not taken, and why."""

    pose: str
    reason: str


@dataclass(frozen=True, slots=True)
class Going:
    """Where the capture stands."""

    phase: Phase = Phase.PREPARING
    pose: str | None = None  # under way
    pan_deg: float | None = None  # where that pose is
    tilt_deg: float | None = None
    taken: int = 0
    total: int = 0
    left_s: float | None = None
    message: str = ""
    missing: tuple[Missed, ...] = ()
    paused: bool = False  # asked for; until the phase is PAUSED too, the step under way goes on


@dataclass(frozen=True, slots=True)
class Noticed:
    """Something a person should see; `pose` "" for the whole capture."""

    pose: str
    text: str
    severity: Severity


@dataclass(frozen=True, slots=True)
class Covered:
    """How much of the room's directions was seen, and a panorama of them."""

    png: Path
    share: float
    share_unclipped: float
    next: str  # what would help most, "" if nothing


@dataclass(frozen=True, slots=True)
class Ask:
    """What a person shall do now; `confirm`: and then say so, else it is noticed."""

    text: str
    confirm: bool


@dataclass(frozen=True, slots=True)
class Ended:
    """How a capture ended; with a trouble, resuming goes on from there."""

    session: Path
    taken: int
    total: int
    cancelled: bool
    missing: tuple[Missed, ...]
    trouble: Trouble | None


@dataclass(frozen=True, slots=True)
class Told:
    """A trouble that calls for attention; `number` grows, so that one told twice is seen twice."""

    command: str  # that it answers, "" for none
    trouble: Trouble
    number: int


@dataclass(frozen=True, slots=True)
class PanelState:
    """Everything the page shows."""

    alive: bool = False  # the desk's child runs
    order: str = ""  # the command under way, "" for none; others are refused meanwhile
    asked: str = ""  # pause, go_on, end or stop, while the desk has not answered it
    working: tuple[float, str] | None = None  # a room is baked: share done, words
    found: Found = field(default_factory=Found)
    rig: RigFacts | None = None  # None: no devices are open
    camera: CameraFacts | None = None
    where: Where = field(default_factory=Where)
    camera_now: CameraStatus | None = None
    picture: Picture | None = None
    planned: Planned | None = None
    plan_fault: Trouble | None = None  # why the newest plan that was asked for is none
    session: Path | None = None  # of the capture under way, or of the last one
    going: Going | None = None  # likewise
    findings: tuple[Noticed, ...] = ()  # likewise
    coverage: Covered | None = None  # likewise
    ended: Ended | None = None  # of the last one; None while one is under way
    ask: Ask | None = None
    told: Told | None = None  # until the next order: whoever gives one has read it
    troubles: int = 0  # told so far

    @property
    def open(self) -> bool:
        """Rig and camera are open."""
        return self.rig is not None

    @property
    def capturing(self) -> bool:
        return self.order in CAPTURES

    @property
    def paused(self) -> bool:
        """A capture stands still, or will once the step under way is done."""
        if self.asked in PAUSES:
            return self.capturing and PAUSES[self.asked]
        return self.capturing and self.going is not None and self.going.paused

    @property
    def rig_well(self) -> bool:
        """One that is being stopped may be silent meanwhile: its controller starts anew."""
        return self.asked == "stop" or self.where.state not in (State.FAULT, State.OFFLINE)

    @property
    def ending(self) -> bool:
        """What is under way was asked to end."""
        return self.asked in ("end", "stop")


def asked(state: PanelState, command: str) -> PanelState:
    """The state after a person asked the order under way to pause, go_on, end or stop; its end is never taken back."""
    if not state.order or state.asked == "stop" or (state.ending and command in PAUSES):
        return state
    return replace(state, asked=command)


def heard(state: PanelState, event: Mapping[str, Any]) -> PanelState:
    """The state after one event of the desk's child; what is not known changes nothing."""
    if event.get("event") == "progress" and "left_s" not in event:
        if not state.order:
            return state  # a room goes on being baked when nobody waits for it any more
        share = float(event["fraction"])
        return replace(state, working=(share, str(event.get("note", ""))) if share < 1 else None)
    if event.get("event") != "data":
        return state
    facts = {name: value for name, value in event.items() if name not in ("event", "kind")}
    change = _CHANGES.get(str(event.get("kind")))
    return state if change is None else change(state, facts)


def lost(state: PanelState, what: Trouble | None) -> PanelState:
    """The state after the desk's child ended; with a trouble if nobody asked it to. A capture under way is resumable."""
    ended = state.ended
    if state.capturing and state.session is not None:
        going = state.going or Going()
        ended = Ended(state.session, going.taken, going.total, what is None, going.missing, what)
    state = replace(
        state, alive=False, order="", asked="", working=None, rig=None, camera=None, where=Where(), camera_now=None,
        ask=None, ended=ended,
    )  # fmt: skip
    return state if what is None else _trouble(state, "", what)


def _trouble(state: PanelState, command: str, what: Trouble) -> PanelState:
    if command == "plan":
        return replace(state, plan_fault=what)
    return replace(state, told=Told(command, what, state.troubles + 1), troubles=state.troubles + 1)


def _order(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    command = str(facts["command"])
    state = replace(state, order=command, asked="", working=None, told=None if command else state.told)
    if command not in CAPTURES:
        return state
    session = Path(facts["session"])
    return replace(state, session=session, going=Going(), findings=(), coverage=None, ended=None)


def _devices(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    ports = tuple(Port(**port) for port in facts["ports"])
    cameras = tuple((str(camera["url"]), str(camera["name"])) for camera in facts["cameras"])
    return replace(state, found=Found(ports, cameras, tuple(facts["rigs"])))


def _opened(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    rig, camera = facts["rig"], facts["camera"]
    axes: dict[str, Any] = {"axes": tuple(AxisFacts(**axis) for axis in rig["axes"])}
    lists: dict[str, Any] = {name: tuple(camera[name]) for name in ("shutters_s", "isos", "apertures")}
    return replace(
        state,
        rig=RigFacts(**{**rig, **axes}),
        camera=CameraFacts(**{**camera, **lists}),
        where=Where(State.IDLE),
        camera_now=None,
    )


def _closed(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    return replace(state, rig=None, camera=None, where=Where(), camera_now=None)


def _where(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    where = Where(State(facts["state"]), facts["pan"], facts["tilt"], facts["message"])
    return replace(state, where=where)


def _picture(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    counts, clip_png = facts["histogram"], facts["clip_png"]
    histogram = None
    if counts is not None:
        red, green, blue = (tuple(counts[channel]) for channel in "rgb")
        histogram = Histogram(red, green, blue, counts["white"], counts["per_ev"])
    picture = Picture(
        Path(facts["png"]), None if clip_png is None else Path(clip_png), facts["pose"], facts["clipped"],
        facts["clipped_here"], facts["dark"], histogram, facts["shutter_s"],
    )  # fmt: skip
    return replace(state, picture=picture)


def _planned(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    poses = tuple(PlannedPose(pose["name"], pose["pan"], pose["tilt"]) for pose in facts["poses"])
    return replace(state, planned=Planned(poses, tuple(facts["warnings"])), plan_fault=None)


def _status(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    going = Going(
        Phase(facts["phase"]), facts["pose"], facts["pan"], facts["tilt"], facts["taken"], facts["total"],
        facts["left_s"], facts["message"], _missed(facts), facts["paused"],
    )  # fmt: skip
    working = state.working if going.phase is Phase.EXPOSING else None
    answered = PAUSES.get(state.asked) is going.paused
    return replace(state, going=going, working=working, asked="" if answered else state.asked)


def _missed(facts: Mapping[str, Any]) -> tuple[Missed, ...]:
    return tuple(Missed(item["pose"], item["reason"]) for item in facts["missing"])


def _finding(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    noticed = Noticed(facts["pose"], facts["text"], Severity(facts["severity"]))
    return replace(state, findings=(*state.findings, noticed))


def _coverage(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    seen: dict[str, Any] = {**facts, "png": Path(facts["png"])}
    return replace(state, coverage=Covered(**seen))


def _ended(state: PanelState, facts: Mapping[str, Any]) -> PanelState:
    what = trouble(facts["trouble"]) if facts["trouble"] else None
    missing = _missed(facts)
    session, cancelled = Path(facts["session"]), bool(facts["cancelled"])
    return replace(state, ended=Ended(session, facts["taken"], facts["total"], cancelled, missing, what))


_CHANGES = {
    "order": _order,
    "devices": _devices,
    "opened": _opened,
    "closed": _closed,
    "where": _where,
    "camera": lambda state, facts: replace(state, camera_now=CameraStatus(**facts)),
    "picture": _picture,
    "planned": _planned,
    "status": _status,
    "finding": _finding,
    "coverage": _coverage,
    "ask": lambda state, facts: replace(state, ask=Ask(**facts)),
    "answered": lambda state, facts: replace(state, ask=None),
    "ended": _ended,
    "trouble": lambda state, facts: _trouble(state, facts["command"], trouble(facts["text"])),
}
