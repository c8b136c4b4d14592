"""Which poses of a plan are done, under way, missing and to come: what the sphere of the Capture page shows.

The desk tells which pose is under way, how many are taken and which are missing; which one was taken follows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from app.capture.panel_state import Going, PanelState, PlannedPose
from app.capture.status import Phase
from app.capture.wanted import Captured

DotState = Literal["done", "current", "missing", "todo"]


@dataclass(frozen=True, slots=True)
class Dot:
    """One pose; angles in degrees as the rig counts them."""

    name: str
    pan_deg: float
    tilt_deg: float
    state: DotState = "todo"


def done_after(done: frozenset[str], before: Going | None, now: Going) -> frozenset[str]:
    """The poses that are done, after one more status of a capture."""
    grown = now.taken - (before.taken if before is not None else 0)
    pose = (before.pose if before is not None else None) or now.pose
    # More at once are those of earlier runs, which the session knows.
    return done | {pose} if grown == 1 and pose is not None else done


def planned(captured: Captured) -> tuple[PlannedPose, ...]:
    """The poses of a session's order."""
    return tuple(
        PlannedPose(
            pose.name,
            None if pose.angles is None else pose.angles.pan_deg,
            None if pose.angles is None else pose.angles.tilt_deg,
        )
        for pose in captured.order.poses
    )


def dots(poses: Sequence[PlannedPose], done: frozenset[str], going: Going | None) -> tuple[Dot, ...]:
    """A dot for each pose that has a place; none for those held by hand."""
    missing = frozenset(item.pose for item in going.missing) if going is not None else frozenset()
    current = going.pose if going is not None and going.phase is not Phase.ENDED else None

    def state(name: str) -> DotState:
        if name == current:
            return "current"
        if name in done:
            return "done"
        return "missing" if name in missing else "todo"

    return tuple(
        Dot(pose.name, pose.pan_deg, pose.tilt_deg or 0.0, state(pose.name))
        for pose in poses
        if pose.pan_deg is not None
    )


class Course:
    """The poses of one capture after another, as the panel's states tell of them."""

    def __init__(self) -> None:
        self.poses: tuple[PlannedPose, ...] = ()
        self.done: frozenset[str] = frozenset()

    def follow(self, before: PanelState, now: PanelState, captured: Captured | None) -> None:
        """
        Args:
            captured: the open session's; where it is the one that goes on, its order tells the poses.
        """
        if now.capturing and not before.capturing:
            own = captured is not None and captured.session == now.session
            self.poses = planned(captured) if captured is not None and own else ()
            self.done = captured.done if captured is not None and own else frozenset()
        # The plan that was shown stands in for the capture's own until the desk tells that.
        told = now.planned is not before.planned
        if now.capturing and (told or not self.poses) and now.planned is not None:
            self.poses = now.planned.poses
        if now.going is not None and now.going is not before.going:
            self.done = done_after(self.done, before.going, now.going)
