"""One stepper axis as a Zaber controller drives it: counts of microsteps, a trapezoid of speed, and what may go wrong.

The controller knows `position`, a count; the stage truly stands at `position + slip` microsteps from its home sensor.
A motor that loses steps, or a controller that loses power, changes the difference. Times are seconds of the
clock that `go` and `at` are given; positions microsteps, speeds and accelerations microsteps per second (squared).
"""

import re
from dataclasses import dataclass, field

SPEED_UNIT = 1.6384  # a speed setting is this many per microstep/s (manual, "Speed and Acceleration Units")
ACCEL_UNIT = 1.6384e-4  # an acceleration setting, per microstep/s^2
SETTLE_S = 0.3  # of homing: off the sensor and slowly on again
RANGES = {"limit.min": (-2_000_000_000, 2_000_000_000), "resolution": (1, 256), "knob.enable": (0, 1),
          "peripheral.id": (0, 99999), "peripheralid": (0, 99999), "peripheral.serial": (0, 0)}  # fmt: skip


class Refused(Exception):
    """A command that gets RJ and this reason."""


@dataclass(frozen=True, slots=True)
class Stage:
    """The stage on one axis as it leaves the works; degrees, the angle it stands at when it is first switched on."""

    steps_per_deg: float = 1_536_000 / 360
    lowest_deg: float = -100_000.0
    highest_deg: float = 100_000.0
    fastest_deg_s: float = 40.0
    accel_deg_s2: float = 120.0
    stands_deg: float = 0.0
    overtravel_deg: float = 5.0  # from a limit to the wall behind it, where the motor stalls


@dataclass(slots=True)
class Axis:
    """Mechanics and warning flags of one axis; `settings` are the values that `get` and `set` name."""

    stage: Stage
    settings: dict[str, int]
    position: float = 0.0
    slip: float = 0.0
    speed: float = 0.0
    flags: set[str] = field(default_factory=set)
    driver: bool = True  # the motor has current
    homing: bool = False
    stuck: bool = False  # something is in the way of the next step it takes
    _legs: list[tuple[float, float]] = field(
        default_factory=list
    )  # seconds and acceleration, one after the other
    _now: float = 0.0

    @property
    def busy(self) -> bool:
        return bool(self._legs)

    @property
    def angle_deg(self) -> float:
        """Where the stage truly stands."""
        return (self.position + self.slip) / self.stage.steps_per_deg

    def get(self, name: str) -> int | str:
        """The value of a setting of this axis, as `get` answers it.

        Raises:
            Refused: there is no such setting.
        """
        if name in ("pos", "encoder.pos"):
            return round(self.position if name == "pos" else self.position + self.slip)
        if name == "driver.enabled":
            return int(self.driver)
        if name not in self.settings:
            raise Refused("BADCOMMAND")
        return self.settings[name]

    def set(self, name: str, value: int) -> None:
        """Change a setting of this axis.

        Raises:
            Refused: there is no such setting, it cannot be changed now, or not to this.
        """
        if name == "pos":  # the manual: this sets the reference, and needs no motion
            if self.busy:
                raise Refused("STATUSBUSY")
            self.slip += self.position - value
            self.position = float(value)
            self.flags.discard("WR")
            return
        if name not in self.settings:
            raise Refused("BADCOMMAND")
        if name == "resolution" and self.busy:
            raise Refused("STATUSBUSY")
        low, high = RANGES.get(name, (1, 2_000_000_000))
        if not low <= value <= high:
            raise Refused("BADDATA")
        self.settings[name] = value

    def power_up(self) -> None:
        """Forget everything that is not in the permanent memory; the stage stands where it stood."""
        self.slip, self.position, self.speed = self.position + self.slip, 0.0, 0.0
        self.flags = {"WR", "WH"}
        self.driver, self.homing = True, False
        self._legs = []

    def advance(self, now: float) -> bool:
        """Move on to `now`; True if a motion came to its end."""
        left, self._now = now - self._now, now
        ended = False
        while self._legs and left > 0:
            seconds, accel = self._legs[0]
            step = min(seconds, left)
            self.position += self.speed * step + accel * step * step / 2
            self.speed += accel * step
            left -= step
            if step < seconds:
                self._legs[0] = (seconds - step, accel)
            else:
                self._legs.pop(0)
                ended = not self._legs
        if self.stuck and self.speed:
            self.stuck, ended = False, True
            self.stall()
        ended = self._against_wall() or ended
        if ended:
            self._arrive()
        return ended

    def _against_wall(self) -> bool:
        """Beyond the end of its travel the stage stops and the motor slips: a stall."""
        low = (self.stage.lowest_deg - self.stage.overtravel_deg) * self.stage.steps_per_deg
        high = (self.stage.highest_deg + self.stage.overtravel_deg) * self.stage.steps_per_deg
        true = self.position + self.slip
        if not self._legs or low <= true <= high:
            return False
        self.slip += min(max(true, low), high) - true
        self.stall()
        return True

    def _arrive(self) -> None:
        self.speed = 0.0
        self._legs = []
        if self.homing and "FS" not in self.flags:
            self.position, self.slip = 0.0, 0.0
            self.flags -= {"WR", "WH"}
        elif "FS" not in self.flags:
            self.position = float(round(self.position))  # a motor stands on whole microsteps
        self.homing = False

    def go(self, target: float, top: float | None = None) -> None:
        """Towards `target` at the axis' own speed or `top`, from whatever speed it has now."""
        self._interrupt()
        accel = max(1.0, self.settings["accel"] / ACCEL_UNIT)
        top = top or max(1.0, self.settings["maxspeed"] / SPEED_UNIT)
        self._legs = legs(target - self.position, self.speed, top, accel)

    def home(self) -> None:
        """Towards the home sensor, which is where the stage truly stands at zero."""
        self.go(-self.slip, self.settings["limit.approach.maxspeed"] / SPEED_UNIT)
        self._legs.append((SETTLE_S, 0.0))  # on the sensor, also for a stage that stands there already
        self.homing = True

    def stop(self) -> None:
        self._interrupt()
        accel = max(1.0, self.settings["accel"] / ACCEL_UNIT)
        self._legs = [(abs(self.speed) / accel, -accel if self.speed > 0 else accel)] if self.speed else []

    def halt(self) -> None:
        """Stop between two microsteps, as an `estop` does."""
        self._interrupt()
        self.speed, self._legs = 0.0, []

    def _interrupt(self) -> None:
        self.flags.discard("NI")
        if self._legs:
            self.flags.add("NI")
        self.homing = False

    def stall(self) -> None:
        """The stage is stuck: it stops here, and the count is a little ahead of it."""
        if self._legs:
            self.position += 0.05 * self.speed
            self.slip -= 0.05 * self.speed
        self.speed, self._legs, self.homing = 0.0, [], False
        self.flags.add("FS")

    def driver_off(self, why: str) -> None:
        """The motor loses its current: what moves coasts to where it is."""
        self.speed, self._legs, self.homing = 0.0, [], False
        self.driver = False
        self.flags |= {why, "WR"}


def works_settings(stage: Stage) -> dict[str, int]:
    """The settings that can be read and set, as they leave the works."""
    steps = stage.steps_per_deg
    speed = round(stage.fastest_deg_s * steps * SPEED_UNIT)
    accel = max(1, round(stage.accel_deg_s2 * steps * ACCEL_UNIT))
    return {
        "accel": accel, "motion.accelonly": accel, "motion.decelonly": accel, "maxspeed": speed,
        "limit.approach.maxspeed": speed, "limit.min": round(stage.lowest_deg * steps),
        "limit.max": round(stage.highest_deg * steps), "limit.cycle.dist": round(360 * steps),
        "resolution": 64, "peripheral.id": 70193, "peripheralid": 70193, "peripheral.serial": 0,
        "peripheral.hw.modified": 0, "knob.enable": 1,
    }  # fmt: skip


def whole(words: list[str]) -> int:
    """The one whole number that a command ends in.

    Raises:
        Refused: BADDATA if it does not.
    """
    if len(words) != 1 or not re.fullmatch(r"-?\d{1,10}", words[0]):
        raise Refused("BADDATA")
    return int(words[0])


def legs(distance: float, speed: float, top: float, accel: float) -> list[tuple[float, float]]:
    """Seconds and accelerations that cover `distance` and end at rest: brake if need be, then a trapezoid."""
    brake = speed * abs(speed) / (2 * accel)  # signed distance to come to rest
    if speed and (speed * distance <= 0 or abs(brake) > abs(distance)):
        first = [(abs(speed) / accel, -accel if speed > 0 else accel)]
        return first + legs(distance - brake, 0.0, top, accel)
    if not distance:
        return []
    sign, start, far = (1.0 if distance > 0 else -1.0), abs(speed), abs(distance)
    if start > top:
        slower = (start - top) / accel
        return [
            (slower, -sign * accel),
            *legs(distance - sign * (start + top) / 2 * slower, sign * top, top, accel),
        ]
    peak = min(top, (accel * far + start * start / 2) ** 0.5)
    cruise = (far - (2 * peak * peak - start * start) / (2 * accel)) / peak
    plan = [((peak - start) / accel, sign * accel), (cruise, 0.0), (peak / accel, -sign * accel)]
    return [(seconds, rate) for seconds, rate in plan if seconds > 1e-12]
