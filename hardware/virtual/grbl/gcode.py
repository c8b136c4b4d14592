"""The G-code parser of the GRBL emulator: one line in, a checked command out, or the error code GRBL answers.

Sources: NIST RS274NGC version 3 (modal groups, order of execution, what excludes what); GRBL 1.1 documentation,
"Interface", table of error codes, and "Jogging". Checks are made in GRBL's order, because the first that fails names
the error. Lengths leave here in mm, feeds in mm/min.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from hardware.virtual.grbl.settings import AXES, LETTERS, SYSTEMS, Memory
from hardware.virtual.grbl.words import Modes, Refused, Words, single

MM_PER_INCH = 25.4
_PLANES = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}


@dataclass(slots=True)
class Command:
    """A line that may be executed."""

    modes: Modes  # in force afterwards
    jog: bool
    action: str = ""  # of those without mode: G4, G10, G28, G28.1, G30, G30.1, G53, G92, G92.1
    moves: bool = False  # go to `target` in `modes.motion`
    via: bool = False  # G28, G30: go to `target` first
    target: tuple[float, ...] = (0.0,) * AXES  # mm, machine position; for G92 the new offset
    stored: tuple[float, ...] = (0.0,) * AXES  # mm: offset to store (G10) or place to go to (G28, G30)
    system: int = 0  # which offset G10 stores
    dwell_s: float = 0.0
    tool_offset: float | None = None
    centre: tuple[float, ...] = (0.0,) * AXES  # of an arc, from where it begins, mm
    radius: float = 0.0
    flow: str = ""  # M0, M2, M30


@dataclass(slots=True)
class Parser:
    """State of the parser: modes, offsets, and the position the last line leads to (mm, machine)."""

    memory: Memory
    modes: Modes = field(default_factory=Modes)
    position: tuple[float, ...] = (0.0,) * AXES
    shift: tuple[float, ...] = (0.0,) * AXES  # G92
    tool_offset: float = 0.0

    def work_offset(self) -> tuple[float, ...]:
        """WCO: machine position minus work position."""
        return self._offset(self.modes.system)

    def _offset(self, system: int) -> tuple[float, ...]:
        stored = self.memory.offsets[SYSTEMS[system]]
        total = [a + b for a, b in zip(stored, self.shift, strict=True)]
        total[2] += self.tool_offset
        return tuple(total)

    def check(self, line: str, jog: bool) -> Command:
        """Read one line, without spaces and in capitals.

        Raises:
            Refused: with GRBL's error code; nothing has changed.
        """
        words = Words(line, self.modes, jog)
        command = Command(words.modes, jog, words.action, flow=words.flow)
        values, axes = words.values, words.axes
        axis_command = words.axis_command or ("motion" if axes else "")
        unused = set(values)
        self._feed(command, words, axis_command, jog)
        if command.action == "G4":
            if "P" not in values:
                raise Refused(28)
            command.dwell_s = values["P"]
            unused.discard("P")
        scale = MM_PER_INCH if command.modes.inches else 1.0
        given = {axis: single(values[LETTERS[axis]] * scale) for axis in axes}
        if axis_command == "tool":
            if words.dynamic_tool and axes != {2}:
                raise Refused(37)
            command.tool_offset = given[2] if words.dynamic_tool else 0.0
        axis_command = self._without_mode(command, words, given, axis_command, unused)
        if command.modes.motion == "G80":
            if axes:
                raise Refused(31)
        elif axis_command == "motion":
            axis_command = self._motion(command, words, axes, scale, unused)
        unused -= set("NF") if jog else set("NFST")
        if axis_command:
            unused -= set(LETTERS)
        if unused:
            raise Refused(36)
        if jog and (words.groups - {"distance", "units", "none"} or command.action not in ("", "G53")):
            raise Refused(16)
        command.moves = axis_command == "motion" and command.modes.motion != "G80"
        return command

    def _feed(self, command: Command, words: Words, axis_command: str, jog: bool) -> None:
        modes, feed = command.modes, words.values.get("F")
        scale = MM_PER_INCH if modes.inches else 1.0
        if jog:
            if feed is None:
                raise Refused(22)
            feed *= scale
        elif modes.inverse_time:
            if axis_command == "motion" and modes.motion not in ("G80", "G0") and feed is None:
                raise Refused(22)
        elif not self.modes.inverse_time:
            feed = self.modes.feed if feed is None else feed * scale
        command.modes = replace(
            modes, feed=single(feed or 0.0), speed=words.values.get("S", self.modes.speed),
            tool=int(words.values.get("T", 0)),
        )  # fmt: skip

    def _without_mode(
        self, command: Command, words: Words, given: dict[int, float], axis_command: str, unused: set[str]
    ) -> str:
        """Actions of modal group 0, and the target of everything that moves."""
        values, action, modes = words.values, command.action, command.modes
        if action == "G10":
            if not given:
                raise Refused(26)
            if "P" not in values and "L" not in values:
                raise Refused(28)
            which, how = int(values.get("P", 0)), int(values.get("L", 0))
            if which > 6:
                raise Refused(29)
            if how not in (2, 20) or (how == 2 and "R" in values):
                raise Refused(20)
            unused -= {"L", "P"}
            command.system = which - 1 if which else modes.system
            stored = list(self.memory.offsets[SYSTEMS[command.system]])
            for axis, value in given.items():
                if how == 20:
                    tool = self.tool_offset if axis == 2 else 0.0
                    value = self.position[axis] - self.shift[axis] - value - tool
                stored[axis] = single(value)
            command.stored = tuple(stored)
            return axis_command
        if action == "G92":
            if not given:
                raise Refused(26)
            shift = list(self.shift)
            for axis, value in given.items():
                tool = self.tool_offset if axis == 2 else 0.0
                stored = self.memory.offsets[SYSTEMS[modes.system]][axis]
                shift[axis] = single(self.position[axis] - stored - value - tool)
            command.target = tuple(shift)
            return axis_command
        if axis_command != "tool":
            command.target = self._target(given, modes, action)
        if action in ("G28", "G30"):
            place = self.memory.offsets[action]
            if not given:
                command.stored = tuple(place)
                return ""
            command.via = True
            command.stored = tuple(
                place[axis] if axis in given else self.position[axis] for axis in range(AXES)
            )
        if action == "G53" and modes.motion not in ("G0", "G1"):
            raise Refused(30)
        return axis_command

    def _target(self, given: dict[int, float], modes: Modes, action: str) -> tuple[float, ...]:
        target, offset = list(self.position), self._offset(modes.system)
        for axis, value in given.items():
            if action == "G53":
                target[axis] = value
            elif modes.relative:
                target[axis] = single(self.position[axis] + value)
            else:
                target[axis] = single(value + offset[axis])
        return tuple(target)

    def _motion(self, command: Command, words: Words, axes: set[int], scale: float, unused: set[str]) -> str:
        motion = command.modes.motion
        if motion == "G0":
            return "motion" if axes else ""
        if command.modes.feed == 0.0:
            raise Refused(22)
        if motion == "G1":
            return "motion" if axes else ""
        if not axes:
            raise Refused(26)
        if motion.startswith("G38"):
            if command.target == self.position:
                raise Refused(33)
            return "motion"
        self._arc(command, words, axes, scale, unused)
        return "motion"

    def _arc(self, command: Command, words: Words, axes: set[int], scale: float, unused: set[str]) -> None:
        first, second, _ = _PLANES[command.modes.plane]
        if not axes & {first, second}:
            raise Refused(32)
        x = command.target[first] - self.position[first]
        y = command.target[second] - self.position[second]
        centre = [0.0] * AXES
        values = words.values
        if "R" in values:
            unused.discard("R")
            if command.target == self.position:
                raise Refused(33)
            radius = values["R"] * scale
            # Centre: from the middle of the chord at right angles, h long, h^2 = r^2 - (d/2)^2.
            rest = 4 * radius**2 - x**2 - y**2
            if rest < 0 or not (x or y):
                raise Refused(34)
            aside = math.sqrt(rest) / math.hypot(x, y)
            if (command.modes.motion == "G2") == (radius > 0):
                aside = -aside
            centre[first], centre[second] = 0.5 * (x - y * aside), 0.5 * (y + x * aside)
            command.radius = abs(radius)
        else:
            offsets = {"IJK".index(letter): values[letter] * scale for letter in "IJK" if letter in values}
            if not offsets.keys() & {first, second}:
                raise Refused(35)
            unused -= set("IJK")
            for axis, value in offsets.items():
                centre[axis] = value
            command.radius = math.hypot(centre[first], centre[second])
            missed = abs(math.hypot(x - centre[first], y - centre[second]) - command.radius)
            if missed > 0.5 or missed > max(0.005, 0.001 * command.radius):
                raise Refused(33)
        command.centre = tuple(centre)


def arc_points(command: Command, begin: Sequence[float], tolerance: float) -> list[tuple[float, ...]]:
    """Corners of the polyline that GRBL runs instead of an arc; `tolerance` is $12, mm."""
    first, second, along = _PLANES[command.modes.plane]
    middle = [b + c for b, c in zip(begin, command.centre, strict=True)]
    start = math.atan2(begin[second] - middle[second], begin[first] - middle[first])
    end = math.atan2(command.target[second] - middle[second], command.target[first] - middle[first])
    turn = end - start
    if command.modes.motion == "G2" and turn >= -5e-7:
        turn -= 2 * math.pi
    if command.modes.motion == "G3" and turn <= 5e-7:
        turn += 2 * math.pi
    chord = math.sqrt(max(1e-12, tolerance * (2 * command.radius - tolerance)))
    count = int(abs(0.5 * turn * command.radius) / chord)
    points = []
    for index in range(1, count):
        angle = start + turn * index / count
        point = list(begin)
        point[first] = middle[first] + command.radius * math.cos(angle)
        point[second] = middle[second] + command.radius * math.sin(angle)
        point[along] += (command.target[along] - begin[along]) * index / count
        points.append(tuple(point))
    return [*points, command.target]
