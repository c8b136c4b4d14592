"""The live checks as a capture wants them: each shot goes in, sentences come out; what they know stays to be asked.

A capture calls `Watching` in a thread of its own, shot by shot; a resumed one shows it the earlier shots first, so
nothing is kept on disk.
"""

import threading
from collections.abc import Mapping, Sequence

from engine.live.finding import Finding, Severity
from engine.live.watch import Watch, plan_findings
from engine.session import Shot
from hardware.interfaces import Angles, Geometry


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
        self.watch = Watch(None if geometry is None else _axes(geometry))
        self._by_hand = by_hand
        self._findings: tuple[Finding, ...] = ()
        self._looking = threading.Lock()  # shots come in the capture's own thread, questions from any

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Everything found so far."""
        return self._findings

    def __call__(self, shot: Shot) -> Sequence[str]:
        angles = None
        if shot.rig is not None:
            angles = (float(shot.rig["pan_deg"]), float(shot.rig["tilt_deg"]))
        with self._looking:
            found = self.watch.see(shot.name, shot.files, angles)
        self._findings += found
        advice = [self.next_pose()] if self._by_hand else []
        return [told(finding, shot.name) for finding in found] + [words for words in advice if words]

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


def of_plan(geometry: Geometry | None, planned: Sequence[Angles]) -> tuple[str, ...]:
    """What a person should know of a rig's plan before it starts; without a geometry, of a level rig's."""
    axes = _axes(geometry) if geometry is not None else LEVEL
    found = plan_findings(axes, [(place.pan_deg, place.tilt_deg) for place in planned])
    return tuple(told(finding) for finding in found)


def told(finding: Finding, shot: str = "") -> str:
    """One line; it names the shot where that is not the one asked about, and says what calls for action."""
    about = f"{finding.shot}: " if finding.shot not in ("", shot) else ""
    urgent = "STOP: " if finding.severity is Severity.STOP else ""
    return f"{urgent}{about}{finding.sentence}"


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
