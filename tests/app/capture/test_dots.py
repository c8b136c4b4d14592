"""A pose is done once the count grew while it was under way, and never because another began."""

from app.capture.dots import done_after, dots
from app.capture.panel_state import Going, Missed, PlannedPose
from app.capture.status import Phase

NONE: frozenset[str] = frozenset()


def going(pose: str | None, taken: int, *missing: str) -> Going:
    return Going(Phase.MOVING, pose, taken=taken, missing=tuple(Missed(name, "why") for name in missing))


def test_the_pose_under_way_when_the_count_grows_is_done() -> None:
    assert done_after(NONE, going("a", 0), going("a", 1)) == {"a"}
    assert done_after(NONE, going("a", 0), going("b", 1)) == {"a"}  # the status between was not told
    assert done_after(NONE, None, going("a", 1)) == {"a"}


def test_a_pose_that_was_left_is_not_done() -> None:
    assert done_after(NONE, going("a", 0), going("b", 0, "a")) == NONE


def test_the_poses_of_earlier_runs_are_not_guessed() -> None:
    assert done_after(NONE, Going(), going("m", 12)) == NONE


def test_dots_tell_missing_from_done_and_leave_free_poses_out() -> None:
    poses = [PlannedPose(name, 10.0, None) for name in "abcd"] + [PlannedPose("free", None, None)]
    shown = dots(poses, frozenset("ab"), going("c", 2, "b", "d"))
    # One that was missing and was taken again at the end is done.
    assert [dot.state for dot in shown] == ["done", "done", "current", "missing"]
    assert {dot.tilt_deg for dot in shown} == {0.0}
