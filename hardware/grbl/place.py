"""What is known of where a GRBL rig stands: the place last reported, the way it must lie on, or why it is lost.

Places are work coordinates, degrees, one number an axis; `home` is the zero that homing gives them.
"""

from typing import TypeVar

from hardware.errors import DisconnectedError, PositionLostError
from hardware.grbl.path import Place, distance_to
from hardware.grbl.status import unwrapped
from hardware.grbl.travel import Travel

Lost = TypeVar("Lost", PositionLostError, DisconnectedError)


class Whereabouts:
    """Nothing is known at first."""

    def __init__(self, travel: Travel, port: str):
        self._travel, self._port = travel, port
        self.lost = "it has not been homed since the port was opened"
        self.fault = False  # it was found lost; not merely never homed
        self.place: Place = (0.0,) * len(travel.config.axes)  # where it was last said to stand
        self.loaded = False  # every axis rests as after an approach from below
        self._way: list[Place] = []  # corners of the line on which it must stand

    def seen(self, place: Place) -> None:
        """A report said so."""
        self.place = self._counted(place, self.place)

    def _counted(self, place: Place, near: Place) -> Place:
        if not self._travel.config.wrap:
            return place
        return (unwrapped(place[0], near[0]), *place[1:])

    def arrived(self, target: Place) -> bool:
        """Is the place last seen the target?"""
        self.place = self._counted(self.place, target)
        return not self._travel.differ(self.place, target)

    def unsure(self) -> None:
        """Homing begins."""
        self.lost, self.fault, self.loaded, self._way = "homing did not end", False, False, []

    def homed(self, place: Place) -> None:
        self.lost, self.fault, self.place, self._way = "", False, place, [place]

    def departs(self, way: list[Place]) -> None:
        """From the first to the last of these, by straight lines."""
        self._way, self.loaded = way, False

    def stands(self, loaded: bool) -> None:
        """At the place last seen, for sure."""
        self._way, self.loaded = [self.place], loaded

    def must_be_on_way(self) -> None:
        """The place last seen lies where it was sent.

        Raises:
            PositionLostError: it does not.
        """
        slack = max(self._travel.slack(axis, angle) for axis, angle in enumerate(self.place))
        if self._way and distance_to(self.place, self._way) > 2 * slack:
            raise self.lose(
                f"the controller says it stands at {self.place}, where it was not sent; it was reset or moved"
            )

    def lose(self, why: str) -> PositionLostError:
        return self.lose_by(PositionLostError(f"{self._port}: {why}; home the rig before it moves again"))

    def lose_by(self, error: Lost) -> Lost:
        if not self.fault:  # what comes later only follows from it
            self.lost, self.fault, self._way = str(error), True, []
        return error
