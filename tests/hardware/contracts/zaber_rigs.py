"""Zaber rigs for the promises of `Motion`: the real driver, a real pseudo-terminal, the emulated controller behind it."""

import contextlib
import re
from collections.abc import Iterator, Sequence

from hardware.interfaces import Angles
from hardware.virtual.wire import Wire
from hardware.virtual.zaber.axis import Stage
from hardware.virtual.zaber.firmware import Chain, ZaberFirmware
from hardware.zaber.opening import ZaberAxis, ZaberConfig, open_zaber
from tests.hardware.contracts.motion import Made
from tests.hardware.contracts.pace import Heard, Pace

PAN = Stage(fastest_deg_s=60.0, accel_deg_s2=1000.0, stands_deg=3.0)
ENDED = Stage(lowest_deg=-200.0, highest_deg=320.0, fastest_deg_s=60.0, accel_deg_s2=1000.0, stands_deg=-2.0)
TILT = Stage(lowest_deg=-60.0, highest_deg=80.0, fastest_deg_s=60.0, accel_deg_s2=1000.0, stands_deg=2.0)
QUESTION = re.compile(rb"/\d+ \d+ \d+(?: (?:get [a-z.]+|warnings))?:[0-9A-F]{2}\n")


def zaber_turntable() -> contextlib.AbstractContextManager[Made]:
    """One endless axis."""
    return _made([ZaberFirmware([PAN])], Angles(10.0), Angles(290.0), ())


def zaber_ended() -> contextlib.AbstractContextManager[Made]:
    """One axis with ends."""
    beyond = (Angles(320.1), Angles(-200.1), Angles(1e9))
    return _made([ZaberFirmware([ENDED])], Angles(10.0), Angles(290.0), beyond)


def zaber_gimbal() -> contextlib.AbstractContextManager[Made]:
    """Two axes on one controller."""
    beyond = (Angles(0.0, 80.1), Angles(0.0, -60.1))
    return _made(
        [ZaberFirmware([PAN, TILT])], Angles(-10.0, 5.0), Angles(-290.0, 20.0), beyond, ZaberAxis(1, 2)
    )


def zaber_chain() -> contextlib.AbstractContextManager[Made]:
    """Two devices of one axis each on one cable."""
    devices = [ZaberFirmware([PAN]), ZaberFirmware([TILT], address=2, serial=81235)]
    return _made(devices, Angles(10.0, 5.0), Angles(290.0, 20.0), (Angles(0.0, 80.1),), ZaberAxis(2, 1))


@contextlib.contextmanager
def _made(
    devices: Sequence[ZaberFirmware], near: Angles, far: Angles, beyond: tuple[Angles, ...],
    tilt: ZaberAxis | None = None,
) -> Iterator[Made]:  # fmt: skip
    heard = Heard(devices[0] if len(devices) == 1 else Chain(devices), QUESTION)
    pace = Pace()
    wire = Wire(heard, pace)
    rig = open_zaber(ZaberConfig(wire.port, tilt=tilt))

    def truth() -> Angles:
        if len(devices) == 1:
            return devices[0].angles()
        return Angles(devices[0].angles().pan_deg, devices[1].angles().pan_deg)

    try:
        yield Made(rig, near, far, beyond, truth, heard.orders, wire.pull, pace.set)
    finally:
        rig.close()
        wire.close()
