import dataclasses

import numpy as np
import pytest

from app.capture import checks as watching
from engine.capture_checks.finding import Finding, Severity
from engine.errors import PoseError
from engine.io import session as sessions
from hardware import plan
from hardware.interfaces import Angles, Geometry
from tests.end_to_end.bundled import DEMO

RIG = Geometry((0.0, -1.0, 0.0), (0.0, 0.0, 0.2), (1.0, 0.0, 0.0), (0.0, 0.0, 0.2))


def shots(count: int) -> list[sessions.Shot]:
    return list(sessions.shots(sessions.open_session(DEMO))[:count])


def angles(places: plan.Plan) -> list[Angles]:
    return [place.angles for place in places if place.angles is not None]


def test_a_shot_goes_in_and_nothing_comes_out_while_all_is_well():
    watch = watching.Watching()
    assert watch.next_pose() == ""
    assert [watch(shot) for shot in shots(2)] == [[], []]
    assert "of the sphere" in watch.next_pose()
    assert watch.findings == ()


def test_the_rigs_angles_are_believed():
    watch = watching.Watching(RIG)
    for number, shot in enumerate(shots(2)):
        watch(dataclasses.replace(shot, rig={"kind": "gimbal", "pan_deg": 90.0 * number, "tilt_deg": 0.0}))
    turned = watch.watch.turned
    assert turned.logged.all()
    # A quarter turn about the vertical: what was to the left is ahead now.
    np.testing.assert_allclose(turned.cam_from_world[1] @ [-1, 0, 0], [0, 0, 1], atol=1e-9)
    left = [Angles(0.0), Angles(90.0, 20.0), Angles(90.0)]
    assert watch.order(left)[0] == 1
    assert watch.next_pose(left).startswith("the next pose adds")


def test_a_file_that_went_bad_is_a_sentence_and_no_crash(tmp_path):
    (shot,) = shots(1)
    bad = tmp_path / "bad.dng"
    bad.write_bytes(b"no photograph")
    watch = watching.Watching()
    (line,) = watch(dataclasses.replace(shot, files=(bad,)))
    assert (line.pose, line.severity) == (shot.name, Severity.STOP)
    assert line.text.startswith("the photographs cannot be read")
    assert len(watch.findings) == 1


def test_a_plan_about_one_axis_is_warned_of_before_it_starts():
    (line,) = watching.of_plan(None, angles(plan.turntable(36)))
    assert "less certain" in line
    assert watching.of_plan(RIG, angles(plan.gimbal(36))) == ()
    assert watching.of_plan(RIG, []) == ()


def test_a_rig_without_directions_is_refused():
    with pytest.raises(PoseError, match="pan_axis is zero"):
        watching.Watching(dataclasses.replace(RIG, pan_axis=(0.0, 0.0, 0.0)))


def test_lines_name_another_shot():
    finding = Finding("pose0003", "moved", Severity.STOP, 3.0, "px", "the object moved by 3 px", "fix it")
    assert watching.told(finding, "pose0009") == "pose0003: the object moved by 3 px; fix it"
    assert watching.told(finding, "pose0003") == "the object moved by 3 px; fix it"
