"""One or two Zaber stages as a rig: homed, moved and stopped, and never believed once they may have lost their place.

That a stage has settled is known by its own IDLE, not by waiting. Flags and rejections are judged as
`hardware.zaber.messages` lists them. Angles are degrees, positions on the wire microsteps, times seconds.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from hardware.errors import (
    DisconnectedError,
    HardwareError,
    LimitError,
    PositionLostError,
    RefusedError,
    ReplyError,
    StoppedError,
)
from hardware.interfaces import Angles, Axis, Motion, MotionFeatures, MotionStatus, State
from hardware.zaber import messages
from hardware.zaber.link import Link
from hardware.zaber.messages import Effect

POLL_S = 0.01  # between two questions whether it still moves
ENDLESS_DEG = 3600.0  # a rotary stage that may turn further than this has no ends worth telling
REST_S = 10.0  # longest that a stage may take to come to rest after `stop`
OFF_TARGET = 2.0  # microsteps between where it was sent and where it says it stands
DRIVER_OFF = {"FH", "FO", "FD", "FV", "FC", "FM"}  # flags of an axis whose motor has no current


@dataclass(frozen=True, slots=True)
class Stage:
    """An axis as it was found: its place, its scale and its travel as the rig counts."""

    name: str
    address: int
    number: int
    steps_per_deg: float
    zero_deg: float
    lowest_deg: float
    highest_deg: float
    fastest_deg_s: float

    def steps(self, angle_deg: float) -> int:
        return round((angle_deg + self.zero_deg) * self.steps_per_deg)

    def wanted_deg(self, angles: Angles) -> float:
        return angles.pan_deg if self.name == "pan" else angles.tilt_deg

    def angle_deg(self, steps: float) -> float:
        return steps / self.steps_per_deg - self.zero_deg


class Zaber(Motion):
    """See `hardware.zaber.opening.open_zaber`; `stages` are the axes as they were found."""

    def __init__(self, name: str, link: Link, stages: Sequence[Stage], homes: bool, home_s: float,
                 clock: Callable[[], float], sleep: Callable[[float], None]):  # fmt: skip
        self._name, self._link, self._stages = name, link, tuple(stages)
        self._homes, self._home_s = homes, home_s
        self._clock, self._sleep = clock, sleep
        self._addresses = tuple(dict.fromkeys(stage.address for stage in stages))
        self._stops = 0  # how often `stop` was called
        self._lost = ""  # why the position is not known, as far as the devices do not say so themselves
        self._doing: State | None = None
        self._closed = False
        self._last = MotionStatus(State.UNHOMED, None)

    @property
    def name(self) -> str:
        return self._name

    @property
    def features(self) -> MotionFeatures:
        axes = []
        for stage in self._stages:
            endless = stage.highest_deg - stage.lowest_deg > ENDLESS_DEG
            ends = (None, None) if endless else (stage.lowest_deg, stage.highest_deg)
            axes.append(Axis(stage.name, *ends, 1 / abs(stage.steps_per_deg), stage.fastest_deg_s))
        return MotionFeatures(
            tuple(axes), automatic=True, homes=self._homes, holds=False, reports_angles=True
        )

    def status(self) -> MotionStatus:
        doing, last = self._doing, self._last
        if self._closed:
            return MotionStatus(State.OFFLINE, None, "the port is closed")
        if doing is not None:  # the thread that gave the order asks all the time
            return MotionStatus(doing, last.angles, last.message)
        try:
            read = [self._link.peek(stage.address, stage.number, "get pos", 0.2) for stage in self._stages]
            told = [reply for reply in read if reply is not None]
            return self._judged(told) if len(told) == len(self._stages) else last
        except HardwareError as error:
            return MotionStatus(State.OFFLINE, None, str(error))

    # ---- orders

    def home(self) -> Angles:
        began = self._stops
        with self._order(State.HOMING):
            self._lost = "homing did not end"
            for stage in self._stages:
                self._prepare(stage)
            for stage in self._stages:
                self._start(stage, "home" if self._homes else f"set pos {stage.steps(0.0)}", began)
            self._settle(began, self._home_s)
            for stage in self._stages:
                self._must_be_sure(stage)
            self._lost = ""
            return self._stands()

    def move(self, angles: Angles) -> Angles:
        self._must_be_in_reach(angles)
        began = self._stops
        with self._order(State.MOVING):
            if self._lost:
                raise PositionLostError(
                    f"{self._link.port}: the position is unknown: {self._lost}; home the rig"
                )
            for stage in self._stages:
                self._must_be_sure(stage)
            patience_s = 10.0
            for stage, count in zip(self._stages, self._counts(), strict=True):
                way_deg = abs(stage.angle_deg(count) - stage.wanted_deg(angles))
                patience_s = max(patience_s, 10.0 + 3 * way_deg / stage.fastest_deg_s)
            for stage in self._stages:
                self._start(stage, f"move abs {stage.steps(stage.wanted_deg(angles))}", began)
            self._settle(began, patience_s)
            for stage in self._stages:
                self._must_be_sure(stage)
                self._must_be_there(stage, stage.steps(stage.wanted_deg(angles)))
            return self._stands()

    def stop(self) -> None:
        self._stops += 1
        self._link.stop(self._addresses)

    def hold(self) -> None:
        """Zaber's protocol has no pause; `features.holds` says so."""

    def resume(self) -> None:
        """See `hold`."""

    def close(self) -> None:
        if not self._closed:
            with contextlib.suppress(DisconnectedError):
                self.stop()
        self._closed = True
        self._link.line.close()

    # ---- parts of orders

    @contextlib.contextmanager
    def _order(self, doing: State) -> Iterator[None]:
        """Say what is being done; an order that fails leaves nothing in motion, and what it lost is remembered."""
        self._doing, self._started, ended = doing, False, False
        try:
            yield
            ended = True
        except HardwareError as error:
            if isinstance(error, PositionLostError) or doing is State.HOMING:
                self._lost = str(error)
            raise
        finally:
            if self._started and not ended:
                with contextlib.suppress(DisconnectedError):
                    self._link.stop(self._addresses)
            self._doing = None

    def _prepare(self, stage: Stage) -> None:
        """Clear what an earlier fault left, and give the motor its current back."""
        self._ask(stage, "warnings clear")
        if self._flags(stage) & DRIVER_OFF:
            self._ask(stage, "driver enable")
        for name in self._flags(stage):
            if name != "WR" and messages.flag(name).effect in (Effect.LOST, Effect.BLOCKED):
                raise self._fault(stage, name)

    def _start(self, stage: Stage, text: str, began: int) -> None:
        """Set a stage in motion, unless `stop` was called since the order began."""
        if self._stops != began:
            self._rest()
        self._started = True
        self._ask(stage, text, tries=1)
        if self._stops != began:
            self._link.stop(self._addresses)  # the first may have gone out just before the order did
            self._rest()

    def _rest(self) -> None:
        """After a stop: wait until everything stands, then say so."""
        self._idle(REST_S)
        raise StoppedError(f"{self._link.port}: stopped on request; move again to go on")

    def _settle(self, began: int, patience_s: float) -> None:
        """Until every stage is IDLE.

        Raises:
            StoppedError: `stop` was called since the order began; everything stands.
        """
        if not self._idle(patience_s, lambda: self._stops != began):
            self._rest()

    def _idle(self, patience_s: float, leave: Callable[[], bool] = lambda: False) -> bool:
        """Wait until every stage is IDLE; False as soon as `leave` says so."""
        give_up = self._clock() + patience_s
        while True:
            replies = [self._ask(stage, "get pos") for stage in self._stages]
            self._last = self._judged(replies)
            if leave():
                return False
            if not any(reply.busy for reply in replies):
                return True
            if self._clock() > give_up:
                raise ReplyError(
                    f"{self._link.port}: still moving after {patience_s:.0f} s; see what holds it up and try again"
                )
            self._sleep(POLL_S)

    def _must_be_sure(self, stage: Stage) -> None:
        """Of where it stands, and able to move."""
        for name in sorted(self._flags(stage), key=messages.severity):
            if messages.flag(name).effect in (Effect.LOST, Effect.BLOCKED):
                raise self._fault(stage, name)

    def _must_be_there(self, stage: Stage, target: int) -> None:
        off = count(self._ask(stage, "get pos")) - target
        if abs(off) <= OFF_TARGET:
            return
        flags = sorted(self._flags(stage), key=messages.severity)
        why = "".join(f", {messages.flag(name).means} ({name})" for name in flags)
        message = f"{self._where(stage)}: stands {off / stage.steps_per_deg:.3f} degrees from where it was sent{why}"
        if any(messages.flag(name).effect is Effect.INTERRUPTED for name in flags):
            raise StoppedError(f"{message}; leave its knob and other programs alone, then move again")
        raise ReplyError(f"{message}; move again")

    def _must_be_in_reach(self, angles: Angles) -> None:
        for stage in self._stages:
            angle, slack = stage.wanted_deg(angles), 0.5 / abs(stage.steps_per_deg)
            if not stage.lowest_deg - slack <= angle <= stage.highest_deg + slack:  # nor is NaN
                raise LimitError(
                    f"{stage.name} {angle:g} degrees is beyond {round(stage.lowest_deg, 3):g} to "
                    f"{round(stage.highest_deg, 3):g}; "
                    "nothing was moved; change the plan or the rig's travel"
                )
        if len(self._stages) == 1 and not abs(angles.tilt_deg) < 1e-6:
            raise LimitError(
                f"tilt {angles.tilt_deg:g} degrees: this rig has no tilt axis; nothing was moved"
            )

    def _fault(self, stage: Stage, name: str) -> HardwareError:
        flag = messages.flag(name)
        kind = PositionLostError if flag.effect is Effect.LOST else RefusedError
        return kind(f"{self._where(stage)}: {flag.means} ({name}); {flag.remedy}")

    # ---- questions

    def _ask(self, stage: Stage, text: str, tries: int = 3) -> messages.Message:
        return self._link.ask(stage.address, stage.number, text, tries)

    def _flags(self, stage: Stage) -> set[str]:
        return set(messages.flags_in(self._ask(stage, "warnings").data))

    def _counts(self) -> list[float]:
        return [count(self._ask(stage, "get pos")) for stage in self._stages]

    def _stands(self) -> Angles:
        self._last = MotionStatus(State.IDLE, self._angles(self._counts()))
        assert self._last.angles is not None
        return self._last.angles

    def _angles(self, counts: Sequence[float]) -> Angles:
        return Angles(*(stage.angle_deg(count) for stage, count in zip(self._stages, counts, strict=True)))

    def _judged(self, replies: Sequence[messages.Message]) -> MotionStatus:
        """What the answers to `get pos` say of the rig as a whole."""
        angles = self._angles([count(reply) for reply in replies])
        worst = min((reply.warning for reply in replies), key=messages.severity)
        flag = messages.flag(worst)
        if worst != "WR" and flag.effect in (Effect.LOST, Effect.BLOCKED):
            where = angles if flag.effect is Effect.BLOCKED else None
            return MotionStatus(State.FAULT, where, f"{flag.means} ({worst}); {flag.remedy}")
        if worst == "WR" or self._lost:
            return MotionStatus(State.UNHOMED, None, self._lost or f"{flag.means} ({worst}); {flag.remedy}")
        state = State.MOVING if any(reply.busy for reply in replies) else State.IDLE
        return MotionStatus(state, angles, "" if flag.effect is Effect.NONE else flag.means)

    def _where(self, stage: Stage) -> str:
        return f"{self._link.port}, {stage.name}"


def count(reply: messages.Message) -> float:
    """The position or setting that a device answered."""
    return messages.number(reply.data)
