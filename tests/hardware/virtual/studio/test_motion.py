import numpy as np
import pytest

from hardware.errors import StudioError
from hardware.virtual.studio import motion

CENTRE = np.array([1.0, 2.0, 1.4])


@pytest.mark.parametrize("kind", ["turntable", "gimbal"])
@pytest.mark.parametrize("pan", [0.0, 90.0, 200.0])
def test_the_pan_axis_goes_through_the_centre(kind: str, pan: float):
    pose = motion.pose_of(kind, CENTRE, pan, 0.0)
    np.testing.assert_allclose(pose @ [*motion.geometry_of(kind).pan_point, 1.0], CENTRE, atol=1e-12)


def test_a_quarter_of_pan_turns_the_gaze_from_x_to_y():
    """Right-handed about the vertical; the turntable's camera looks 8 degrees down all the way round."""
    down, level = np.sin(np.radians(8)), np.cos(np.radians(8))
    np.testing.assert_allclose(
        motion.pose_of("turntable", CENTRE, 0.0, 0.0)[:, 2], [level, 0, -down], atol=1e-12
    )
    np.testing.assert_allclose(
        motion.pose_of("turntable", CENTRE, 90.0, 0.0)[:, 2], [0, level, -down], atol=1e-12
    )


def test_tilt_looks_up():
    gaze = motion.pose_of("gimbal", CENTRE, 0.0, 30.0)[:, 2]
    np.testing.assert_allclose(gaze, [np.cos(np.radians(30)), 0, 0.5], atol=1e-12)


def test_the_tilt_axis_stays_where_pan_carries_it():
    point = np.array([*motion.geometry_of("gimbal").tilt_point, 1.0])
    one, other = (motion.pose_of("gimbal", CENTRE, 40.0, tilt) @ point for tilt in (0.0, 55.0))
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_what_a_rig_reports_is_near_where_it_stands():
    journey = motion.travel("gimbal", 12, CENTRE, 3)
    assert journey.geometry is not None
    for report, pose in zip(journey.reports, journey.world_from_cam, strict=True):
        assert report is not None
        again = motion.pose_of("gimbal", CENTRE, float(report["pan_deg"]), float(report["tilt_deg"]))
        assert np.abs(again - pose).max() < 5e-3


def test_no_other_rig_is_known():
    with pytest.raises(StudioError, match="turntable, gimbal"):
        motion.pose_of("crane", CENTRE, 0.0, 0.0)
    with pytest.raises(StudioError, match="turntable, gimbal"):
        motion.geometry_of("crane")


def test_random_poses_are_uniform_over_rotations_and_a_ball():
    """Of uniform rotations each entry has mean 0 and variance 1/3, the trace mean 0 and variance 1; no direction is rarer."""
    journey = motion.travel("random", 20000, CENTRE, 5)
    turns = journey.world_from_cam[:, :, :3]
    np.testing.assert_allclose(np.linalg.det(turns), 1, atol=1e-9)
    assert np.abs(turns.mean(0)).max() < 0.02
    np.testing.assert_allclose((turns**2).mean(0), 1 / 3, atol=0.01)
    trace = np.trace(turns, axis1=1, axis2=2)
    assert abs(trace.mean()) < 0.03
    assert trace.var() == pytest.approx(1, abs=0.03)
    pivots = turns @ [0, 0, motion.PIVOT_M] + journey.world_from_cam[:, :, 3] - CENTRE
    share = np.linalg.norm(pivots, axis=1) / motion.WANDER_M
    assert share.max() <= 1
    assert (share < 0.5).mean() == pytest.approx(1 / 8, abs=0.01)
    assert np.abs(pivots.mean(0)).max() < 0.01
    assert journey.geometry is None
    assert set(journey.reports) == {None}


@pytest.mark.parametrize("kind", ["handheld", "random"])
def test_what_no_rig_carries_wanders_less_where_less_is_free(kind: str):
    reaches, told = [], []
    for journey, notes in motion.calmer(kind, 40, 3, 2.0):
        pivots = journey.world_from_cam @ [0, 0, 2 * motion.PIVOT_M, 1]
        reaches.append(np.linalg.norm(pivots, axis=1).max())
        told.append(notes)
    assert reaches[0] > 0.8 * 2 * motion.WANDER_M * (1 if kind == "random" else 3**-0.5)
    np.testing.assert_allclose(reaches, reaches[0] * np.array(motion.WANDERS), atol=1e-9)
    assert told[0] == ()
    assert told[1] == ("the rig wanders 28 cm about its place: no more is free",)


def test_a_rig_is_not_made_calmer():
    assert [notes for _, notes in motion.calmer("gimbal", 12, 0, 1.0)] == [()]
