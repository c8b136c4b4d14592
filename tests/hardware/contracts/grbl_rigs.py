"""GRBL rigs for the promises of `Motion`: the real driver, a real pseudo-terminal, the emulated controller behind it."""

import contextlib
import re
from collections.abc import Iterator
from dataclasses import replace

from hardware.grbl.opening import GrblConfig, open_grbl
from hardware.interfaces import Angles
from hardware.virtual.grbl.dialects import FLUIDNC, GRBLHAL, Dialect
from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.grbl.motion import Mechanics
from hardware.virtual.wire import Wire
from tests.hardware.contracts.motion import Made
from tests.hardware.contracts.pace import Heard, Pace

QUICK = {
    24: 1200.0, 25: 36000.0, 26: 5, 100: 200.0, 101: 200.0, 110: 3600.0, 111: 3600.0, 120: 600.0, 121: 600.0,
}  # fmt: skip
SWITCHED = {**QUICK, 20: 1, 21: 1, 22: 1, 23: 3, 130: 371.0, 131: 101.0}
PLAY = 0.4
QUESTION = re.compile(rb"\?")


def turntable() -> contextlib.AbstractContextManager[Made]:
    """One axis between limit switches, with play in its gears."""
    mechanics = Mechanics(
        (-185.0, None, None), (185.0, None, None), play=(PLAY, 0.0, 0.0), start=(-182.0, 0, 0)
    )
    firmware = GrblFirmware(SWITCHED, mechanics, homes=(0,))
    facts = {"backlash_deg": (0.5, 0.0), "home_deg": (-184.0 - PLAY, 0.0)}
    return _made(firmware, facts, Angles(-170.0), Angles(150.0), (Angles(180.1), Angles(-180.1), Angles(1e9)))


def gimbal() -> contextlib.AbstractContextManager[Made]:
    """Two axes between limit switches, reporting work positions."""
    mechanics = Mechanics((-185.0, -50.0, None), (185.0, 50.0, None), start=(-182.0, -46.0, 0))
    firmware = GrblFirmware({**SWITCHED, 10: 0}, mechanics)
    facts = {"axes": "xy", "tilt": (-45.0, 45.0), "home_deg": (-184.0, -49.0)}
    beyond = (Angles(0.0, 45.1), Angles(0.0, -45.1), Angles(180.1, 0.0))
    return _made(firmware, facts, Angles(-170.0, -40.0), Angles(150.0, 20.0), beyond)


def endless() -> contextlib.AbstractContextManager[Made]:
    """One axis without ends or switches, as cheap turntables have."""
    return _made(GrblFirmware(QUICK), {"pan": None, "homing": "none"}, Angles(10.0), Angles(300.0), ())


def fluidnc() -> contextlib.AbstractContextManager[Made]:
    """A FluidNC controller."""
    return _between_switches(FLUIDNC)


def grblhal() -> contextlib.AbstractContextManager[Made]:
    """A grblHAL controller of eight axes that tells all it can."""
    return _between_switches(replace(GRBLHAL, axes=8, fields="|SP1:0,,|FW:grblHAL|AR"))


def _between_switches(dialect: Dialect) -> contextlib.AbstractContextManager[Made]:
    mechanics = Mechanics((-185.0, None, None), (185.0, None, None), start=(-182.0, 0, 0))
    firmware = GrblFirmware(SWITCHED, mechanics, dialect=dialect, homes=(0,))
    facts = {"home_deg": (-184.0, 0.0)}
    return _made(firmware, facts, Angles(-170.0), Angles(150.0), (Angles(180.1), Angles(-180.1)))


@contextlib.contextmanager
def _made(
    firmware: GrblFirmware, facts: dict, near: Angles, far: Angles, beyond: tuple[Angles, ...]
) -> Iterator[Made]:
    heard = Heard(firmware, QUESTION)
    pace = Pace()
    wire = Wire(heard, pace)
    rig = open_grbl(GrblConfig(wire.port, feed_deg_min=3600.0, **facts))
    try:
        yield Made(
            rig,
            near,
            far,
            beyond,
            firmware.angles,
            heard.orders,
            wire.pull,
            pace.set,
        )
    finally:
        rig.close()
        wire.close()
