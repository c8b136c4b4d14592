"""The Zaber driver on a pseudo-terminal, the emulated controller behind it, and what disturbs them."""

import time
from collections.abc import Callable
from dataclasses import replace

from hardware.interfaces import Angles, Motion
from hardware.virtual.faults import Faulty
from hardware.virtual.wire import Wire
from hardware.virtual.zaber.axis import Stage
from hardware.virtual.zaber.firmware import ZaberFirmware
from hardware.zaber.opening import ZaberAxis, ZaberConfig, open_zaber
from tests.hardware.contracts.orders import Order, wait
from tests.hardware.contracts.pace import Heard
from tests.hardware.contracts.zaber_rigs import QUESTION

PAN = Stage(fastest_deg_s=60.0, accel_deg_s2=200.0, stands_deg=3.0)
TILT = Stage(lowest_deg=-60.0, highest_deg=80.0, fastest_deg_s=60.0, accel_deg_s2=200.0)
HURRY = 20
NEAR, FAR = Angles(10.0, 5.0), Angles(2000.0, 5.0)  # 1990 degrees take 1.7 s


class Bench:
    """A driver, the emulated controller it talks to, and what disturbs them."""

    def __init__(self) -> None:
        self.device = ZaberFirmware([PAN, TILT])
        self.heard = Heard(self.device, QUESTION)
        self.faults = Faulty(self.heard)
        self.wire = Wire(self.faults, lambda: HURRY * time.monotonic())
        self.config = ZaberConfig(self.wire.port, tilt=ZaberAxis(1, 2), reply_s=0.2)
        self.rigs: list[Motion] = []

    def open(self, clock: Callable[[], float] = time.monotonic, **changes: object) -> Motion:
        self.rigs.append(open_zaber(replace(self.config, **changes), clock))
        return self.rigs[-1]

    def homed(self) -> Motion:
        rig = self.open()
        rig.home()
        return rig

    def close(self) -> None:
        for rig in self.rigs:
            rig.close()
        self.wire.close()


def far(bench: Bench, rig: Motion) -> Order:
    """On its way, and truly moving."""
    order = Order(lambda: rig.move(FAR))
    wait(lambda: bench.device.angles().pan_deg > 50, "it never began to move")
    return order
