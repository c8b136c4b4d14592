"""The moving part of the GRBL emulator: planner, stepper and the mechanics that the motors turn.

Speeds follow trapezoids under GRBL's limits ($110 mm/min, $120 mm/s2), blocks join at the speed of the junction
deviation rule, and everything is computed at the exact times where something happens: no time step, no drift.
Sources: GRBL 1.1 documentation ("Configuring": $11, $110-$132); Sonny Jeon, "Improving Grbl: Cornering Algorithm".
Lengths are GRBL's millimetres (degrees for a rig), times seconds.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from hardware.virtual.grbl.settings import AXES, Memory

BLOCKS = 15  # of 16 in the ring one is always empty
_TINY = 1e-9
_SLOWEST_MM_MIN = 1.0


@dataclass(slots=True)
class Mechanics:
    """What the motors turn, degrees: where limit switches sit, how much the gears play, where it stands at power-on.

    The angle lags behind the motor by up to `play` when the motor turns downwards, and not at all upwards.
    """

    low: tuple[float | None, ...] = (None, None, None)  # pressed at and below
    high: tuple[float | None, ...] = (None, None, None)  # pressed at and above
    play: tuple[float, ...] = (0.0, 0.0, 0.0)
    start: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(slots=True)
class Block:
    """One straight line of the planner."""

    start: tuple[float, ...]
    delta: tuple[float, ...]
    length: float
    rapid: bool  # at the fastest the axes allow
    fed: float  # mm/s as programmed
    fastest: float  # mm/s that no axis exceeds
    acceleration: float  # mm/s2
    corner: float  # highest speed at which the junction before it may be passed
    fixed: bool  # overrides do not apply (jog)
    entry: float = 0.0  # mm/s, as planned
    done: float = 0.0  # mm
    locked: dict[int, float] = field(default_factory=dict)  # homing: axes held still since this `done`

    def unit(self, axis: int) -> float:
        return self.delta[axis] / self.length

    def at(self, done: float) -> tuple[float, ...]:
        """Machine position after `done` of its length."""
        if done >= self.length - _TINY and not self.locked:
            return tuple(s + d for s, d in zip(self.start, self.delta, strict=True))
        return tuple(
            self.start[axis] + self.unit(axis) * min(done, self.locked.get(axis, done))
            for axis in range(AXES)
        )


class Stepper:
    """Blocks in, position out. `ended` and `switched` are set when it happens; who sees them clears them."""

    def __init__(self, memory: Memory, mechanics: Mechanics):
        self._memory, self._mechanics = memory, mechanics
        self.position: tuple[float, ...] = (0.0,) * AXES  # machine position, mm
        self._offset = list(mechanics.start)  # motor angle minus machine position
        self._angles = list(mechanics.start)
        self.stalled = [False] * AXES
        self.blocks: deque[Block] = deque()
        self.speed = 0.0  # mm/s along the block
        self.running = self.holding = False
        self.ended = self.switched = False
        self.overrides = (1.0, 1.0)  # feed, rapid

    # -- planner

    @property
    def full(self) -> bool:
        return len(self.blocks) >= BLOCKS

    @property
    def planned_to(self) -> tuple[float, ...]:
        last = self.blocks[-1] if self.blocks else None
        return last.at(last.length) if last else self.position

    def append(
        self, target: Sequence[float], feed: float, rapid: bool, inverse_time: bool, fixed: bool
    ) -> None:
        """Queue a line to `target`, mm; `feed` in mm/min, or in 1/min when `inverse_time`."""
        steps = self._memory.per_axis(100)
        start = self.planned_to
        end = tuple(round(t * s) / s for t, s in zip(target, steps, strict=True))
        delta = tuple(e - s for e, s in zip(end, start, strict=True))
        length = math.hypot(*delta)
        if length < _TINY:
            return
        unit = [d / length for d in delta]
        rates, accelerations = self._memory.per_axis(110), self._memory.per_axis(120)
        fastest = min(r / 60 / abs(u) for r, u in zip(rates, unit, strict=True) if u)
        acceleration = min(a / abs(u) for a, u in zip(accelerations, unit, strict=True) if u)
        fed = max(feed * length if inverse_time else feed, _SLOWEST_MM_MIN) / 60
        corner = self._corner(unit, acceleration) if self.blocks else 0.0
        self.blocks.append(Block(start, delta, length, rapid, fed, fastest, acceleration, corner, fixed))
        self.plan()

    def _corner(self, unit: Sequence[float], acceleration: float) -> float:
        """Speed through the junction with the last block: that of a circle touching both lines."""
        before = self.blocks[-1]
        cosine = -sum(before.unit(axis) * unit[axis] for axis in range(AXES))
        if cosine > 0.999999:
            return 0.0
        if cosine < -0.999999:
            return math.inf
        half_sine = math.sqrt(0.5 * (1 - cosine))
        return math.sqrt(acceleration * self._memory.settings[11] * half_sine / (1 - half_sine))

    def nominal(self, block: Block) -> float:
        feed, rapid = (1.0, 1.0) if block.fixed else self.overrides
        return block.fastest * rapid if block.rapid else min(block.fed * feed, block.fastest)

    def plan(self) -> None:
        """Entry speeds: as fast as the corners, the way left for braking and the way for accelerating allow."""
        after = 0.0
        for index in range(len(self.blocks) - 1, 0, -1):
            block, before = self.blocks[index], self.blocks[index - 1]
            limit = min(block.corner, self.nominal(block), self.nominal(before))
            block.entry = min(limit, math.sqrt(after**2 + 2 * block.acceleration * block.length))
            after = block.entry
        speed = self.speed
        for before, block in zip(list(self.blocks)[:-1], list(self.blocks)[1:], strict=True):
            way = before.length - before.done
            block.entry = min(block.entry, math.sqrt(speed**2 + 2 * before.acceleration * way))
            speed = block.entry

    # -- stepper

    def begin(self) -> None:
        self.running, self.holding = bool(self.blocks), False
        self.plan()

    def seek(self, delta: Sequence[float], rate: float) -> None:
        """Begin a homing line of `delta` from here at `rate` mm/min, outside the planner's limits on length."""
        self.reset()
        length = math.hypot(*delta)
        accelerations = self._memory.per_axis(120)
        acceleration = min(a * length / abs(d) for a, d in zip(accelerations, delta, strict=True) if d)
        line = Block(self.position, tuple(delta), length, False, rate / 60, math.inf, acceleration, 0.0, True)
        self.blocks.append(line)
        self.running = True

    def lock(self, axis: int) -> None:
        self.blocks[0].locked.setdefault(axis, self.blocks[0].done)

    def reset(self) -> None:
        """Forget everything queued and stand still at once."""
        self.blocks.clear()
        self.speed = 0.0
        self.running = self.holding = self.ended = self.switched = False

    def set_position(self, position: Sequence[float]) -> None:
        """Call this place another name; the motors do not turn."""
        for axis in range(AXES):
            self._offset[axis] += self.position[axis] - position[axis]
        self.position = tuple(position)

    def slip(self, axis: int, degrees: float) -> None:
        """The motor was turned by hand, or by its own inertia, unnoticed."""
        self._offset[axis] += degrees
        self._follow()

    def advance(self, seconds: float) -> float:
        """Let up to `seconds` pass, less when something happens before; returns how much passed."""
        if not self.running:
            return seconds
        if not self.blocks:
            self.running, self.ended = False, True
            return 0.0
        block = self.blocks[0]
        acceleration, lasts, speed_then = self._phase(block)
        passed = min(seconds, lasts)
        # Of two pressed switches only a change can matter, and within one phase each axis turns one way.
        before = self.pressed()
        if self._pressed_at(block, self._way(acceleration, passed)) != before:
            passed = self._moment(block, acceleration, passed, before)
        self._go(block, block.done + self._way(acceleration, passed))
        if passed < lasts:
            self.speed = max(0.0, self.speed + acceleration * passed)
        else:
            self.speed = speed_then
        self.switched = self.switched or self.pressed() != before
        if block.length - block.done <= 2 * _TINY:
            self.blocks.popleft()
        if (self.holding and self.speed < _TINY) or not self.blocks:
            self.speed = 0.0
            self.running, self.ended = False, True
        return passed

    def _phase(self, block: Block) -> tuple[float, float, float]:
        """Acceleration now, how long it lasts, and the speed at its end."""
        limit, speed, left = block.acceleration, self.speed, block.length - block.done
        if self.holding:
            if speed**2 < 2 * limit * left:
                return -limit, speed / limit, 0.0
            end = math.sqrt(max(0.0, speed**2 - 2 * limit * left))
            return -limit, (speed - end) / limit, end
        nominal = self.nominal(block)
        end = min(self.blocks[1].entry, nominal) if len(self.blocks) > 1 else 0.0
        brake = max(0.0, speed**2 - end**2) / (2 * limit)
        if left <= brake + _TINY:
            lasts = 2 * left / (speed + end) if speed + end else 0.0
            return ((end - speed) / lasts if lasts else 0.0), lasts, end
        if speed > nominal + _TINY:
            return -limit, (speed - nominal) / limit, nominal
        if speed < nominal - _TINY:
            peak = min(nominal, math.sqrt((speed**2 + end**2) / 2 + limit * left))
            if peak > speed:
                return limit, (peak - speed) / limit, peak
        return 0.0, (left - brake) / speed, speed

    def _way(self, acceleration: float, seconds: float) -> float:
        return max(0.0, self.speed * seconds + 0.5 * acceleration * seconds**2)

    def _moment(self, block: Block, acceleration: float, until: float, before: frozenset[int]) -> float:
        """Just after the first switch changes, within the phase."""
        early, late = 0.0, until
        for _ in range(40):
            middle = (early + late) / 2
            if self._pressed_at(block, self._way(acceleration, middle)) == before:
                early = middle
            else:
                late = middle
        return late

    def _go(self, block: Block, done: float) -> None:
        block.done = min(done, block.length)
        now = block.at(block.done)
        for axis in range(AXES):
            if self.stalled[axis]:
                self._offset[axis] -= now[axis] - self.position[axis]
        self.position = now
        self._follow()

    # -- mechanics

    def _lagging(self, axis: int, motor: float) -> float:
        return min(max(self._angles[axis], motor), motor + self._mechanics.play[axis])

    def _follow(self) -> None:
        for axis in range(AXES):
            self._angles[axis] = self._lagging(axis, self.position[axis] + self._offset[axis])

    def _pressed_at(self, block: Block, way: float) -> frozenset[int]:
        there = block.at(min(block.done + way, block.length))
        motors = (
            (self.position if self.stalled[axis] else there)[axis] + self._offset[axis]
            for axis in range(AXES)
        )
        return self._switches([self._lagging(axis, motor) for axis, motor in enumerate(motors)])

    def _switches(self, angles: Sequence[float]) -> frozenset[int]:
        found = set()
        for axis, (low, high) in enumerate(zip(self._mechanics.low, self._mechanics.high, strict=True)):
            if (low is not None and angles[axis] <= low) or (high is not None and angles[axis] >= high):
                found.add(axis)
        return frozenset(found)

    def pressed(self) -> frozenset[int]:
        """Axes whose limit switch is pressed."""
        return self._switches(self._angles)

    @property
    def angles(self) -> tuple[float, ...]:
        """Where the mechanics really stand."""
        return tuple(self._angles)
