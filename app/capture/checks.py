"""The live checks as a capture wants them: each shot goes in, findings come out; what they know stays to be asked.

A capture calls `Watching` in a thread of its own, shot by shot; a resumed one shows it the earlier shots first, so
nothing is kept on disk.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from app.capture.order import Order, Pose
from app.capture.status import Finding
from engine.capture_checks import finding as looked
from engine.capture_checks.checker import ShotChecker, plan_findings
from engine.io.session import Shot
from hardware.interfaces import Angles, Geometry

if TYPE_CHECKING:
    import numpy as np

    from engine.capture_checks.planning.coverage import Coverage


class Watching:
    """Give it to `Capture` as `watch`."""

    def __init__(self, geometry: Geometry | None = None, by_hand: bool = False) -> None:
        """
        Args:
            geometry: the rig's; None: how the camera stood is told from the photographs.
            by_hand: say after every shot which way to point next.

        Raises:
            PoseError: an axis of the geometry has no direction.
        """
        self.watch = ShotChecker(None if geometry is None else _axes(geometry))
        self._by_hand = by_hand
        self._findings: tuple[looked.Finding, ...] = ()
        self._looking = threading.Lock()  # shots come in the capture's own thread, questions from any

    @property
    def findings(self) -> tuple[looked.Finding, ...]:
        """Everything found so far, with what was measured."""
        return self._findings

    def __call__(self, shot: Shot) -> Sequence[Finding]:
        angles = None
        if shot.rig is not None:
            angles = (float(shot.rig["pan_deg"]), float(shot.rig["tilt_deg"]))
        with self._looking:
            found = self.watch.add(shot.name, shot.files, angles)
        self._findings += found
        told_now = [Finding(shot.name, told(finding, shot.name), finding.severity) for finding in found]
        advice = self.next_pose() if self._by_hand else ""
        return [*told_now, Finding(shot.name, advice)] if advice else told_now

    def seen(self, height: int) -> "tuple[Coverage, np.ndarray] | None":
        """How much of the room was seen, and a panorama of it (8-bit RGB, `height` rows); None before the first shot."""
        with self._looking:
            covered, picture = self.watch.coverage(), self.watch.panorama(height)
        return None if covered is None or picture is None else (covered, picture)

    def order(self, left: Sequence[Angles]) -> list[int] | None:
        """The poses still to take, by index, the most helpful first; None where the geometry is not known."""
        with self._looking:
            return self.watch.order([(place.pan_deg, place.tilt_deg) for place in left])

    def next_pose(self, left: Sequence[Angles] = ()) -> str:
        """Which pose would help most now, in words; "" before the first shot."""
        offered = [(place.pan_deg, place.tilt_deg) for place in left]
        with self._looking:
            best = self.watch.next_by_rig(offered) or (None if offered else self.watch.next_by_hand())
        return "" if best is None else best.sentence


def watching(order: Order, by_hand: bool = True) -> Watching | None:
    """The checks of a capture; they read RAW files, so that a capture of any format does without.

    Args:
        by_hand: where nothing turns, say after every shot which way to point next.
    """
    if order.any_format:
        return None
    turns = any(pose.angles is not None for pose in order.poses)
    return Watching(order.geometry if turns else None, by_hand=by_hand and not turns)


Reorder = Callable[[Sequence[Pose]], Sequence[Pose]]


def reordering(live: Watching | None, helpful_first: bool) -> Reorder:
    """The order of the poses that are left: as planned, or first what shows most of what no shot has shown yet."""
    if live is None or not helpful_first:
        return lambda left: left

    def order(left: Sequence[Pose]) -> Sequence[Pose]:
        places = [pose.angles for pose in left if pose.angles is not None]
        best = live.order(places) if len(places) == len(left) else None
        return left if best is None else [left[i] for i in best]

    return order


def of_plan(geometry: Geometry | None, planned: Sequence[Angles]) -> tuple[str, ...]:
    """What a person should know of a rig's plan before it starts; without a geometry, of a level rig's."""
    axes = _axes(geometry) if geometry is not None else LEVEL
    found = plan_findings(axes, [(place.pan_deg, place.tilt_deg) for place in planned])
    return tuple(told(finding) for finding in found)


def of_order(order: Order) -> tuple[str, ...]:
    """`of_plan` of an order's poses; of those that a person holds, nothing."""
    places = [pose.angles for pose in order.poses if pose.angles is not None]
    return of_plan(order.geometry, places) if places else ()


def told(finding: looked.Finding, shot: str = "") -> str:
    """One line; it names the shot where that is not the one asked about."""
    about = f"{finding.shot}: " if finding.shot not in ("", shot) else ""
    return f"{about}{finding.sentence}"


# A table that turns a level camera about the vertical, a head that tilts it.
LEVEL: Mapping[str, Sequence[float]] = {
    "pan_axis": (0.0, -1.0, 0.0),
    "pan_point": (0.0, 0.0, 0.0),
    "tilt_axis": (1.0, 0.0, 0.0),
    "tilt_point": (0.0, 0.0, 0.0),
}


def _axes(geometry: Geometry) -> Mapping[str, Sequence[float]]:
    return {
        "pan_axis": geometry.pan_axis,
        "pan_point": geometry.pan_point,
        "tilt_axis": geometry.tilt_axis,
        "tilt_point": geometry.tilt_point,
    }
