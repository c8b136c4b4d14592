"""A whole rig without hardware: an emulated controller on a pseudo-terminal behind the driver that real ones get.

The code above cannot tell the difference; `angles` says where the mechanics truly stand, for a virtual camera and for
tests. In a device URL, where everything may be left out:

    virtual:grbl?kind=gimbal&speed=1&faults=20&seed=0

`virtual:zaber` is the other controller, `virtual:hands` a person who holds camera and object every way.
"""

import math
import random
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hardware.errors import SettingsError
from hardware.interfaces import Angles, Geometry, Motion, MotionFeatures, MotionStatus
from hardware.manual import Handheld
from hardware.urls import Word, number, one_of, read_words, whole
from hardware.virtual.faults import Faulty
from hardware.virtual.studio import motion
from hardware.virtual.wire import Firmware, Wire

CONTROLLERS = ("grbl", "zaber", "hands")
PAN = (-5.0, 365.0)
TILT = (-75.0, 75.0)
LATE_S = 3.0  # of real time: longer than any driver waits for an answer
_SWITCH_DEG = 2.0  # from the end of the travel to the switch behind it
_PULL_OFF_DEG = 3.0  # from the switch to where homing leaves the rig, which is within its travel


@dataclass(frozen=True, slots=True)
class VirtualConfig:
    """Which controller, and how it behaves."""

    firmware: str = "grbl"  # or "zaber", or "hands" for none
    kind: str = "gimbal"  # or "turntable"
    speed: float = 1.0  # seconds that pass for the controller in one second
    faults: float | None = None  # moves from one fault to the next, on average; None: none
    seed: int = 0  # of the faults

    @classmethod
    def from_query(cls, place: str, query: Mapping[str, str]) -> "VirtualConfig":
        """From a device URL; `place` is what stands between `virtual:` and `?`.

        Raises:
            SettingsError: a word that is not known, or a value that cannot be meant.
        """
        if place and place not in CONTROLLERS:
            raise SettingsError(
                f"virtual:{place}: there is none; possible are virtual:{', virtual:'.join(CONTROLLERS)}"
            )
        firmware: dict[str, Any] = {"firmware": place} if place else {}
        return cls(**firmware, **read_words("virtual", query, WORDS))


WORDS = {
    "faults": Word(number(1.0, 1e9), "20 (moves from one fault to the next, on average)"),
    "kind": Word(one_of(*motion.PITCHES_DEG), " or kind=".join(motion.PITCHES_DEG)),
    "seed": Word(whole(0, 2**31), "0"),
    "speed": Word(number(0.01, 1000.0), "10 (times faster than real)"),
}


def open_virtual(config: VirtualConfig) -> "VirtualRig | VirtualHands":
    """Power the controller up and open it; nothing moves, and it is not homed."""
    if config.firmware == "hands":
        return VirtualHands(config)
    device, opener = (_grbl if config.firmware == "grbl" else _zaber)(config)
    faulty = Faulty(device, config.seed)
    happenings = Happenings(faulty)
    wire = Wire(happenings, lambda: config.speed * time.monotonic())
    try:
        return VirtualRig(config, opener(wire.port), device, happenings, wire)
    except BaseException:
        wire.close()
        raise


class Happenings:
    """A firmware to which things happen at given times; they are done in its own thread."""

    def __init__(self, faulty: Faulty):
        self.faulty = faulty
        self._lock = threading.Lock()
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._now = 0.0

    def later(self, seconds: float, happening: Callable[[], None]) -> None:
        """`seconds` of the controller's time from now."""
        with self._lock:
            self._due.append((self._now + seconds, happening))

    def call_off(self) -> None:
        """What has not happened yet will not."""
        with self._lock:
            self._due = []

    def receive(self, data: bytes, now: float) -> None:
        self.faulty.receive(data, now)

    def advance(self, now: float) -> bytes:
        with self._lock:
            self._now = now
            ready = [happening for due, happening in self._due if due <= now]
            self._due = [(due, happening) for due, happening in self._due if due > now]
            for happening in ready:
                happening()
        return self.faulty.advance(now)


class VirtualRig(Motion):
    """The driver's rig, and what is behind its cable."""

    def __init__(
        self, config: VirtualConfig, driver: Motion, device: Any, happenings: Happenings, wire: Wire
    ) -> None:
        self.config, self.device, self.faulty = config, device, happenings.faulty
        self._driver, self._happenings, self._wire = driver, happenings, wire
        self._random = random.Random(config.seed)

    @property
    def geometry(self) -> Geometry:
        """Where its axes truly are."""
        return motion.geometry_of(self.config.kind)

    def angles(self) -> Angles:
        """Where the mechanics truly stand, whatever the controller believes."""
        return self.device.angles()

    def pull(self) -> None:
        """Pull the cable."""
        self._wire.pull()

    @property
    def name(self) -> str:
        return f"virtual {self.config.kind}, {self._driver.name}"

    @property
    def features(self) -> MotionFeatures:
        return self._driver.features

    def status(self) -> MotionStatus:
        return self._driver.status()

    def home(self) -> Angles:
        return self._driver.home()

    def move(self, angles: Angles) -> Angles:
        if self.config.faults is None or self._random.random() >= 1 / self.config.faults:
            return self._driver.move(angles)
        end = self._disturb()
        try:
            return self._driver.move(angles)
        finally:
            end()

    def stop(self) -> None:
        self._driver.stop()

    def hold(self) -> None:
        self._driver.hold()

    def resume(self) -> None:
        self._driver.resume()

    def close(self) -> None:
        self._driver.close()
        self._wire.close()

    def _disturb(self) -> Callable[[], None]:
        """Let something go wrong during the next move; returns what puts it right again."""
        faulty, device, rng = self.faulty, self.device, self._random
        on_line: list[Callable[[], None]] = [
            lambda: faulty.garbage(rng.randbytes(rng.randrange(1, 60))),
            lambda: faulty.garbage(b"\r\n"),
            lambda: faulty.lose_line(rng.randrange(1, 4)),
            lambda: faulty.delay(LATE_S * self.config.speed),
            faulty.split,
            faulty.silence,
            faulty.deafen,
        ]
        in_device: list[Callable[[], None]] = [device.brown_out]
        if self.config.firmware == "grbl":
            in_device += [device.hit_limit, device.emergency_stop]
        else:
            in_device += [device.stall, device.encoder_error, device.turn_knob, device.press_estop]
        fault = rng.choice(on_line + in_device)
        if fault in in_device:
            self._happenings.later(rng.uniform(0.0, 1.5), fault)
        else:
            fault()

        def end() -> None:
            self._happenings.call_off()
            faulty.heal()
            if self.config.firmware == "zaber":
                device.release_estop()

        return end


class VirtualHands(Handheld):
    """A person who holds camera and object another way for every pose, evenly over all directions."""

    geometry = None  # nobody knows where hands turn

    def __init__(self, config: VirtualConfig) -> None:
        super().__init__()
        self.config, self._place = config, 0

    @property
    def name(self) -> str:
        return "virtual hands"

    def angles(self) -> Angles:
        """How it is held, as the angles of a gimbal."""
        # The R2 sequence (M. Roberts, 2018): evenly over the unit square, however many places there will be.
        pan, height = ((0.5 + self._place * step) % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
        return Angles(360.0 * pan, math.degrees(math.asin(1.9 * height - 0.95)))

    def move(self, angles: Angles) -> Angles:
        super().move(angles)
        self._place += 1
        return angles


Opener = Callable[[str], Motion]


def _grbl(config: VirtualConfig) -> tuple[Firmware, Opener]:
    from hardware.grbl.opening import GrblConfig, open_grbl
    from hardware.virtual.grbl.firmware import GrblFirmware
    from hardware.virtual.grbl.motion import Mechanics

    two = config.kind == "gimbal"
    low, high = (
        [end - _SWITCH_DEG for end in (PAN[0], TILT[0])],
        [end + _SWITCH_DEG for end in (PAN[1], TILT[1])],
    )
    axes = 2 if two else 1
    mechanics = Mechanics(
        tuple(low[:axes]) + (None,) * (3 - axes),
        tuple(high[:axes]) + (None,) * (3 - axes),
        start=(4.0, -60.0 * two, 0.0),
    )
    settings = {
        20: 1, 21: 1, 22: 1, 23: 3, 24: 300.0, 25: 2400.0, 26: 25, 27: _PULL_OFF_DEG, 100: 200.0, 101: 200.0,
        110: 3600.0, 111: 3600.0, 120: 250.0, 121: 250.0, 130: high[0] - low[0], 131: high[1] - low[1],
    }  # fmt: skip
    firmware = GrblFirmware(settings, mechanics, homes=tuple(range(axes)))
    home = (low[0] + _PULL_OFF_DEG, low[1] + _PULL_OFF_DEG)

    def opener(port: str) -> Motion:
        return open_grbl(
            GrblConfig(
                port, axes="xy" if two else "x", pan=PAN, tilt=TILT, feed_deg_min=3600.0, home_deg=home
            )
        )

    return firmware, opener


def _zaber(config: VirtualConfig) -> tuple[Firmware, Opener]:
    from hardware.virtual.zaber.axis import Stage
    from hardware.virtual.zaber.firmware import ZaberFirmware
    from hardware.zaber.opening import ZaberAxis, ZaberConfig, open_zaber

    two = config.kind == "gimbal"
    stages = [
        Stage(lowest_deg=low, highest_deg=high, fastest_deg_s=60.0, accel_deg_s2=250.0)
        for low, high in (PAN, TILT)
    ]
    firmware = ZaberFirmware(stages[: 1 + two])

    def opener(port: str) -> Motion:
        return open_zaber(ZaberConfig(port, tilt=ZaberAxis(1, 2) if two else None))

    return firmware, opener
