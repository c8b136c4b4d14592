"""Where a GRBL rig may be sent, and when two statements of a place are the same: configuration and controller together.

Places are work coordinates, degrees, one number an axis.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from hardware.errors import LimitError
from hardware.grbl.config import GrblConfig
from hardware.grbl.path import Place
from hardware.interfaces import Angles, Axis

NAMES = ("pan", "tilt")
TURNS = 100  # beyond, the single-precision numbers of GRBL are coarser than its steps


@dataclass(frozen=True, slots=True)
class Found:
    """What the controller said of itself when the port was opened."""

    version: str
    settings: Mapping[int, float]
    notes: tuple[str, ...] = ()  # what a person should know


@dataclass(frozen=True, slots=True)
class Travel:
    """The travel of one rig."""

    config: GrblConfig
    settings: Mapping[int, float]  # `$` settings, as far as the controller tells them

    def axes(self) -> tuple[Axis, ...]:
        found = []
        for axis, name in enumerate(NAMES[: len(self.config.axes)]):
            low, high = self._configured(axis)
            fastest = min(self.config.feed_deg_min, self.settings.get(110 + axis, math.inf)) / 60
            found.append(Axis(name, low, high, self._resolution(axis), fastest))
        return tuple(found)

    def _configured(self, axis: int) -> tuple[float | None, float | None]:
        """Angles that may be asked for; the lowest leaves room for the approach from below."""
        travel = self.config.pan if axis == 0 else self.config.tilt
        if travel is None:
            return None, None
        return travel[0] + self.config.backlash_deg[axis], travel[1]

    def reachable(self, angles: Angles, offset_deg: Place | None, port: str) -> Place:
        """The place that these angles mean.

        Args:
            offset_deg: WCO of the homed rig; None while it is not known.

        Raises:
            LimitError: out of travel, no number, or an axis that the rig lacks.
        """
        wanted = (angles.pan_deg, angles.tilt_deg)
        for axis, (name, angle) in enumerate(zip(NAMES, wanted, strict=True)):
            if axis >= len(self.config.axes):
                if angle != 0.0:
                    raise LimitError(
                        f"{port}: {name} {angle:g} deg: this rig has no {name} axis; leave it at 0"
                    )
                continue
            low, high = self._configured(axis)
            if low is None or high is None:
                low, high = -360.0 * TURNS, 360.0 * TURNS
            if offset_deg is not None:
                low, high = self._within_controller(axis, low, high, offset_deg[axis])
            if not low <= angle <= high:
                raise LimitError(
                    f"{port}: {name} {angle:g} deg is outside its travel, {low:g} to {high:g} deg;"
                    " nothing moved; choose an angle within it"
                )
        return wanted[: len(self.config.axes)]

    def _within_controller(self, axis: int, low: float, high: float, shift: float) -> tuple[float, float]:
        """Also within GRBL's own soft limits, -$130 to 0 in machine coordinates, where they are switched on."""
        room = self.settings.get(130 + axis)
        if not self.settings.get(20) or room is None:
            return low, high
        return max(low, -room - shift + self.config.backlash_deg[axis]), min(high, -shift)

    def _resolution(self, axis: int) -> float:
        """Reports have three decimals; the motor may be coarser."""
        return max(0.001, 1 / self.settings.get(100 + axis, 1000.0))

    def slack(self, axis: int, angle: float) -> float:
        """By how much two statements of one place may differ: steps, printed decimals, single precision."""
        return 1.5 * self._resolution(axis) + 0.001 + 2.4e-7 * abs(angle)

    def differ(self, place: Place, other: Place) -> bool:
        return any(
            abs(a - b) > self.slack(axis, b) for axis, (a, b) in enumerate(zip(place, other, strict=True))
        )

    def homing_s(self) -> float:
        """Twice what the search over the whole travel takes at the controller's own rates."""
        axes, settings = len(self.config.axes), self.settings
        travel = max(settings.get(130 + axis, 360.0) for axis in range(axes))
        seek, locate, pulloff = settings.get(25, 200.0), settings.get(24, 25.0), settings.get(27, 5.0)
        cycle_s = 60 * (1.5 * travel / max(seek, 1.0) + 7 * pulloff / max(min(seek, locate), 1.0))
        return 30.0 + 2 * (axes + 1) * cycle_s
