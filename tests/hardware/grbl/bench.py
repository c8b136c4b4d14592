"""A GRBL driver on a bench: emulator, bad connection, pseudo-terminal and driver, all within reach of a test."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from hardware.grbl.opening import GrblConfig, open_grbl
from hardware.interfaces import Angles, Motion
from hardware.line import Line
from hardware.virtual.faults import Faulty
from hardware.virtual.grbl.dialects import GRBL, Dialect
from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.grbl.motion import Mechanics
from hardware.virtual.wire import Wire
from tests.hardware.contracts.grbl_rigs import QUESTION, QUICK, SWITCHED
from tests.hardware.contracts.orders import Order, wait
from tests.hardware.contracts.pace import Heard

HURRY = 20.0  # device seconds in a second
BARE = {"pan": None, "homing": "none"}  # a turntable without switches
SWITCHES = {"home_deg": (-184.0, 0.0)}


@dataclass(frozen=True, slots=True)
class Bench:
    firmware: GrblFirmware
    faults: Faulty
    heard: Heard
    wire: Wire
    rig: Motion

    def order(self, order: Callable[[], Any]) -> Order:
        return Order(order)

    def truth(self) -> Angles:
        return self.firmware.angles()

    def under_way(self, target: Angles) -> Order:
        """A move that has begun to move."""
        stood = self.truth()
        order = Order(lambda: self.rig.move(target))
        wait(lambda: self.truth() != stood, "it never began to move")
        return order


def switched(start: float = -182.0, play: float = 0.0) -> Mechanics:
    return Mechanics((-185.0, None, None), (185.0, None, None), (play, 0.0, 0.0), (start, 0.0, 0.0))


def let_greet(wire: Wire) -> None:
    """Take its greeting away: from here on it has nothing to greet for."""
    line = Line(wire.port, 115200)
    line.write(b"?")
    while not line.read_line(time.monotonic() + 10).startswith(b"<"):
        pass
    line.close()


def fast() -> float:
    return HURRY * time.monotonic()


@contextlib.contextmanager
def powered(firmware: GrblFirmware, hurry: float = HURRY) -> Iterator[tuple[Wire, Heard, Faulty]]:
    faults = Faulty(firmware)
    heard = Heard(faults, QUESTION)
    wire = Wire(heard, lambda: hurry * time.monotonic())
    try:
        yield wire, heard, faults
    finally:
        wire.close()


@contextlib.contextmanager
def bench(
    settings: Mapping[int, float] = QUICK,
    mechanics: Mechanics | None = None,
    hurry: float = HURRY,
    dialect: Dialect = GRBL,
    clock: Callable[[], float] = time.monotonic,
    **facts: Any,
) -> Iterator[Bench]:
    """`facts` go into the configuration."""
    firmware = GrblFirmware(settings, mechanics, dialect=dialect, homes=(0,))
    with powered(firmware, hurry) as (wire, heard, faults):
        rig = open_grbl(GrblConfig(wire.port, **{"feed_deg_min": 3600.0, **facts}), clock)
        try:
            yield Bench(firmware, faults, heard, wire, rig)
        finally:
            rig.close()


def bare(settings: Mapping[int, float] = QUICK, **more: Any) -> contextlib.AbstractContextManager[Bench]:
    return bench(settings, **{**BARE, **more})


def with_switches(**more: Any) -> contextlib.AbstractContextManager[Bench]:
    return bench(SWITCHED, switched(), **{**SWITCHES, **more})
