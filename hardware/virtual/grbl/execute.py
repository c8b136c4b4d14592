"""What the GRBL emulator does with one line: `$` commands, G-code, jogs, homing.

Source: GRBL 1.1 documentation, "Commands" (which states allow which `$` command), "Interface" (their answers),
"Jogging", "Configuring" ($22-$27, the homing cycle). Each part returns GRBL's error code, 0 for `ok`.
"""

import math
import re

from hardware.virtual.grbl.core import (
    ALARM,
    CHECK,
    HOLD,
    HOME,
    HOMING_APPROACH,
    HOMING_PULLOFF,
    HOMING_REQUIRED,
    IDLE,
    JOG,
    RUN,
    Core,
    Steps,
)
from hardware.virtual.grbl.gcode import Command, arc_points
from hardware.virtual.grbl.settings import AXES, LETTERS, STARTUP_LINES, SYSTEMS, placed
from hardware.virtual.grbl.words import Modes, Refused

LOCKED = 9
_NOT_IDLE, _DISABLED, _INVALID, _NUMBER, _TRAVEL, _UNHOMED = 8, 5, 3, 2, 15, 46
_SETTING = re.compile(r"(N?)([+-]?(?:\d+\.?\d*|\.\d+))=(.*)")
_FLOAT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
_SEARCH, _LOCATE = 1.5, 5.0  # of the travel, of the pull-off
_HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"
PROBE_NO_CONTACT = 5


def line(core: Core, text: str) -> Steps[int]:
    """Execute one line, spaces and comments removed, in capitals."""
    if text.startswith("$"):
        return (yield from system(core, text))
    if core.state in (ALARM, JOG):
        return LOCKED
    return (yield from gcode(core, text))


def system(core: Core, text: str) -> Steps[int]:
    rest = text[1:]
    if not rest:
        core.say(_HELP)
        return 0
    if rest[0] == "J":
        if core.state not in (IDLE, JOG):
            return _NOT_IDLE
        if not rest.startswith("J="):
            return _INVALID
        return (yield from gcode(core, rest[2:], jog=True))
    if rest[0] in "$GCX":
        if len(rest) > 1:
            return _INVALID
        return _any_state(core, rest)
    if core.state not in (IDLE, ALARM):
        return _NOT_IDLE
    return (yield from _at_rest(core, rest))


def _any_state(core: Core, letter: str) -> int:
    if letter == "$":
        if core.state in (RUN, HOLD):
            return _NOT_IDLE
        for printed in core.memory.printed():
            core.say(printed)
    elif letter == "G":
        core.say(f"[GC:{_modes(core.parser.modes)}]")
    elif letter == "C":
        if core.state == CHECK:
            core.abort()
            core.message("Disabled")
        elif core.state != IDLE:
            return _NOT_IDLE
        else:
            core.state = CHECK
            core.message("Enabled")
    elif core.state == ALARM and core.stands == HOMING_REQUIRED:
        return _UNHOMED
    elif core.state == ALARM:
        core.message("Caution: Unlocked")
        core.state = IDLE
    return 0


def _modes(modes: Modes) -> str:
    return (
        f"{modes.motion} G{54 + modes.system} {modes.plane} {'G20' if modes.inches else 'G21'}"
        f" {'G91' if modes.relative else 'G90'} {'G93' if modes.inverse_time else 'G94'} {modes.spindle}"
        f" {modes.coolant} T{modes.tool} F{modes.feed / (25.4 if modes.inches else 1):.0f} S{modes.speed:.0f}"
    )


def _at_rest(core: Core, rest: str) -> Steps[int]:
    """Commands that want Idle or Alarm."""
    if rest == "#":
        _parameters(core)
    elif rest[0] == "H":
        return (yield from _home_command(core, rest))
    elif rest == "SLP":
        core.flags.add("sleep")
    elif rest == "I":
        _build(core)
    elif rest.startswith("I="):
        core.memory.build = rest[2:]
    elif re.fullmatch(r"RST=[$#*]", rest):
        core.memory.restore(rest[4])
        core.message("Restoring defaults")
        core.abort()
    elif rest == "N":
        for index, stored in enumerate(core.memory.startup):
            core.say(f"$N{index}={stored}")
    elif rest[0] in "#SIR":
        return _INVALID
    else:
        return (yield from _store(core, rest))
    return 0


def _store(core: Core, rest: str) -> Steps[int]:
    if rest[0] == "N" and core.state != IDLE:
        return _NOT_IDLE
    found = _SETTING.fullmatch(rest)
    if found is None:
        return _INVALID if _FLOAT.match(rest.removeprefix("N")) else _NUMBER
    number = int(float(found[2]))
    if found[1]:
        code = (yield from gcode(core, found[3])) if found[3] else 0
        if code == 0 and 0 <= number < STARTUP_LINES:
            core.memory.startup[number] = found[3]
        return code
    value = _FLOAT.match(found[3])
    if value is None:
        return _NUMBER
    if value.end() != len(found[3]) or not 0 <= number <= 255:
        return _INVALID
    code = core.memory.store(number, float(value[0]))
    if number in (10, 13):
        core.refresh_offset()
    return code


def _parameters(core: Core) -> None:
    inches = core.memory.flag(13)
    for name in SYSTEMS:
        core.say(f"[{name}:{placed(core.memory.offsets[name], inches)}]")
    core.say(f"[G92:{placed(core.parser.shift, inches)}]")
    core.say(f"[TLO:{placed([core.parser.tool_offset], inches)}]")
    core.say(f"[PRB:{placed([0.0] * AXES, inches)}:0]")


def _build(core: Core) -> None:
    for told in core.dialect.build:
        core.say(told.format(core.memory.build))


# -- homing


def _home_command(core: Core, rest: str) -> Steps[int]:
    if not core.memory.flag(22):
        return _DISABLED
    axes = core.homes if rest == "H" else tuple(a for a, letter in enumerate(LETTERS) if rest == f"H{letter}")
    if not axes or (rest != "H" and not core.dialect.homes_each):
        return _INVALID
    core.state = HOME
    yield from _go_home(core, axes)
    yield from core.checkpoint()
    core.parser.position = core.placed()
    core.state, core.homed = IDLE, True
    if rest == "H":
        yield from startup(core)
    return 0


def _go_home(core: Core, axes: tuple[int, ...]) -> Steps[None]:
    """Towards the switches fast, off, towards them slowly, off; the place then gets its number."""
    settings = core.memory.settings
    downwards, pulloff = int(settings[23]), settings[27]
    travel = core.memory.per_axis(130)
    cycle = (
        (True, _SEARCH * max(travel[axis] for axis in axes), settings[25]),
        (False, pulloff, settings[25]),
        (True, _LOCATE * pulloff, settings[24]),
        (False, pulloff, settings[25]),
    )
    for approach, way, rate in cycle:
        sign = [-1.0 if (downwards >> axis & 1) == approach else 1.0 for axis in range(AXES)]
        delta = [sign[axis] * way if axis in axes else 0.0 for axis in range(AXES)]
        core.stepper.seek(delta, rate * math.sqrt(len(axes)))
        yield from _follow(core, axes, approach)
        core.stepper.reset()
        yield from core.delay(settings[26] / 1000)
    position = list(core.stepper.position)
    for axis in axes:
        position[axis] = -travel[axis] + pulloff if downwards >> axis & 1 else -pulloff
    core.stepper.set_position(position)


def _follow(core: Core, axes: tuple[int, ...], approach: bool) -> Steps[None]:
    """One line of the homing cycle, to its end; only a reset interrupts it."""
    left = set(axes)
    while True:
        if approach:
            for axis in left & core.stepper.pressed():
                core.stepper.lock(axis)
            left -= core.stepper.pressed()
            if not left:
                return
        if "stop" in core.flags:
            core.flags.discard("stop")
            if approach:
                core.alarm = HOMING_APPROACH
            elif core.stepper.pressed() & set(axes):
                core.alarm = HOMING_PULLOFF
            else:
                return
            core.abort()
        if "reset" in core.flags:
            yield from core.checkpoint()
        if core.dialect.tells_homing and "status" in core.flags:
            core.flags.discard("status")
            core.report()
        yield None


def startup(core: Core) -> Steps[None]:
    """Run the stored start-up lines; their answers are no answers to the host."""
    for stored in core.memory.startup:
        if stored:
            code = yield from gcode(core, stored)
            core.say(f">{stored}:{f'error:{code}' if code else 'ok'}")


# -- G-code


def gcode(core: Core, text: str, jog: bool = False) -> Steps[int]:
    try:
        command = core.parser.check(text, jog)
    except Refused as refused:
        return refused.code
    if jog:
        return (yield from _jog(core, command))
    yield from _execute(core, command)
    return 0


def _jog(core: Core, command: Command) -> Steps[int]:
    if core.memory.flag(20) and core.outside(command.target):
        return _TRAVEL
    yield from core.line_to(command.target, command.modes.feed, fixed=True)
    if core.state == IDLE and core.stepper.blocks:
        core.state = JOG
        core.stepper.begin()
    core.parser.position = command.target
    return 0


def _execute(core: Core, command: Command) -> Steps[None]:
    """In the order of RS274NGC, section 3.8."""
    parser, memory, before = core.parser, core.memory, core.parser.modes
    if command.modes.spindle != before.spindle or command.modes.coolant != before.coolant:
        yield from core.synchronize()
    parser.modes = command.modes
    if command.action == "G4" and core.state != CHECK:
        yield from core.dwell(command.dwell_s)
    moved = command.modes.system != before.system
    if command.tool_offset is not None:
        parser.tool_offset, moved = command.tool_offset, True
    if command.action == "G10":
        yield from core.synchronize()
        memory.offsets[SYSTEMS[command.system]] = list(command.stored)
        moved = moved or command.system == command.modes.system
    elif command.action in ("G28", "G30"):
        if command.via:
            yield from core.line_to(command.target, 0.0, rapid=True)
        yield from core.line_to(command.stored, 0.0, rapid=True)
        parser.position = command.stored
    elif command.action in ("G28.1", "G30.1"):
        memory.offsets[command.action[:3]] = list(parser.position)
    elif command.action in ("G92", "G92.1"):
        parser.shift = command.target if command.action == "G92" else (0.0,) * AXES
        moved = True
    if moved:
        yield from core.synchronize()
        core.refresh_offset()
    if command.moves:
        yield from _move(core, command)
    if command.flow:
        yield from _flow(core, command.flow)


def _move(core: Core, command: Command) -> Steps[None]:
    modes = command.modes
    points = [command.target]
    if modes.motion in ("G2", "G3"):
        points = arc_points(command, core.parser.position, core.memory.settings[12])
    if modes.motion.startswith("G38"):
        yield from core.synchronize()
    feed = modes.feed * (len(points) if modes.inverse_time else 1)
    for point in points:
        yield from core.line_to(point, feed, modes.motion == "G0", modes.inverse_time)
    core.parser.position = command.target
    if modes.motion.startswith("G38") and core.state != CHECK:
        yield from core.synchronize()  # no probe is fitted: it never makes contact
        if modes.motion in ("G38.2", "G38.4"):
            core.alarm = PROBE_NO_CONTACT
            yield from core.checkpoint()


def _flow(core: Core, flow: str) -> Steps[None]:
    yield from core.synchronize()
    if flow == "M0":
        if core.state != CHECK:
            core.flags.add("hold")
            yield from core.checkpoint()
        return
    kept = core.parser.modes
    core.parser.modes = Modes("G1", inches=kept.inches, feed=kept.feed, speed=kept.speed, tool=kept.tool)
    core.refresh_offset()
    core.message(core.dialect.program_end)
