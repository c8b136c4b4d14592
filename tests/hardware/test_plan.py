from pathlib import Path

import numpy as np
import pytest

from hardware.errors import LimitError, SettingsError
from hardware.interfaces import Angles, Axis, MotionFeatures
from hardware.plan import Place, fitted, free, gimbal, read_plan, suited, turntable
from hardware.virtual.studio import motion

ROOT = Path(__file__).parents[2]
PAN, ENDED = Axis("pan", None, None, 0.01, 30.0), Axis("pan", -180.0, 180.0, 0.01, 30.0)
TILT = Axis("tilt", -40.0, 60.0, 0.01, 10.0)


def features(*axes: Axis) -> MotionFeatures:
    return MotionFeatures(axes, True, True, True, True)


def angles(plan: tuple[Place, ...]) -> list[tuple[float, float]]:
    return [(place.angles.pan_deg, place.angles.tilt_deg) for place in plan if place.angles]


def test_a_turntable_takes_even_steps():
    assert angles(turntable(4)) == [(0, 0), (90, 0), (180, 0), (270, 0)]


@pytest.mark.parametrize("poses", [1, 2, 3, 7, 12, 50, 96, 500])
def test_a_gimbal_has_so_many_poses_between_its_tilts(poses: int):
    places = angles(gimbal(poses, -30.0, 50.0))
    assert len(set(places)) == poses
    assert all(0 <= pan < 360 and -30 <= tilt <= 50 for pan, tilt in places)


def test_a_gimbal_goes_back_and_forth_with_fewer_poses_near_the_poles():
    rows: dict[float, list[float]] = {}
    for pan, tilt in angles(gimbal(96)):
        rows.setdefault(round(tilt, 6), []).append(pan)
    pans = list(rows.values())
    assert list(rows) == sorted(rows)
    assert len(pans[0]) < len(pans[len(pans) // 2])
    for i, row in enumerate(pans):
        assert row == sorted(row, reverse=bool(i % 2))


def test_plans_are_those_of_the_virtual_studio():
    for kind, plan in (("turntable", turntable(20)), ("gimbal", gimbal(20))):
        journey = motion.travel(kind, 20, np.zeros(3), 0)
        for pose, (pan, tilt) in zip(journey.world_from_cam, angles(plan), strict=True):
            np.testing.assert_array_equal(pose, motion.pose_of(kind, np.zeros(3), pan, tilt))


@pytest.mark.parametrize("poses", [0, -1, 10_001])
def test_a_number_that_cannot_be_meant_is_told(poses: int):
    for make in (turntable, gimbal, free):
        with pytest.raises(SettingsError, match=f"{poses} poses"):
            make(poses)


@pytest.mark.parametrize("tilts", [(10.0, 10.0), (20.0, 10.0), (-91.0, 10.0), (0.0, float("nan"))])
def test_tilts_that_are_no_range_are_told(tilts: tuple[float, float]):
    with pytest.raises(SettingsError, match="tilts from"):
        gimbal(12, *tilts)


def test_the_plan_suits_the_rig():
    assert suited(12, features()) == free(12)
    assert suited(12, features(PAN)) == turntable(12)
    assert suited(12, features(PAN, TILT)) == gimbal(12, -40.0, 60.0)


# ---- plan files


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "plan.csv"
    path.write_text(text)
    return path


def test_a_plan_file_is_read(tmp_path: Path):
    path = write(
        tmp_path,
        "\ufeff# made by hand\n\npan_deg, tilt_deg,name\n0,-10.5,first\n # a comment\n 90.25 , 5 ,\r\n",
    )
    assert read_plan(path) == (Place(Angles(0.0, -10.5), "first"), Place(Angles(90.25, 5.0)))
    assert read_plan(write(tmp_path, "pan_deg,tilt_deg\n1e1,-0\n")) == (Place(Angles(10.0, 0.0)),)


def test_the_plan_that_the_docs_show_can_be_read(tmp_path: Path):
    docs = (ROOT / "docs" / "capture.md").read_text()
    (shown,) = [block for block in docs.split("```")[1::2] if "pan_deg,tilt_deg,name" in block]
    assert read_plan(write(tmp_path, shown)) == (
        Place(Angles(0.0, -30.0), "front low"),
        Place(Angles(45.0, -30.0)),
    )


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("0,0\n", 1, "should be pan_deg,tilt_deg"),
        ("# hello\npan,tilt\n0,0\n", 2, "should be pan_deg,tilt_deg"),
        ("pan_deg;tilt_deg\n0;0\n", 1, "commas"),
        ("pan_deg,tilt_deg\n0,0\n5\n", 3, "1 values where the header names 2"),
        ("pan_deg,tilt_deg\n0,0,x\n", 2, "3 values"),
        ("pan_deg,tilt_deg\n0,1o\n", 2, "tilt_deg '1o' is no number"),
        ("pan_deg,tilt_deg\n\n# x\nnan,0\n", 4, "pan_deg 'nan' is no number"),
        ("pan_deg,tilt_deg\ninf,0\n", 2, "no number"),
        ("pan_deg,tilt_deg\n0,5\u00b0\n", 2, "no number"),
        ("pan_deg,tilt_deg,name\n0,0,a\n1,0,a\n", 3, "'a' was given in line 2"),
        ("pan_deg,tilt_deg,name\n0,0,../x\n", 2, "'../x' is no name"),
        ('pan_deg,tilt_deg\n"0,0\n', 2, ""),
    ],
)
def test_an_error_in_a_plan_file_is_told_with_line_and_reason(
    tmp_path: Path, text: str, line: int, reason: str
):
    with pytest.raises(SettingsError) as caught:
        read_plan(write(tmp_path, text))
    assert f"plan.csv, line {line}: " in str(caught.value)
    assert reason in str(caught.value)


def test_files_that_are_no_plan_are_told(tmp_path: Path):
    with pytest.raises(SettingsError, match="is empty"):
        read_plan(write(tmp_path, "# nothing\n\n"))
    with pytest.raises(SettingsError, match="has 0 poses"):
        read_plan(write(tmp_path, "pan_deg,tilt_deg\n"))
    with pytest.raises(SettingsError, match="10001 poses"):
        read_plan(write(tmp_path, "pan_deg,tilt_deg\n" + 10_001 * "0,0\n"))
    with pytest.raises(SettingsError, match="cannot be read"):
        read_plan(tmp_path / "missing.csv")
    with pytest.raises(SettingsError, match="cannot be read"):
        read_plan(tmp_path)
    (tmp_path / "photo.csv").write_bytes(b"\xff\xd8\xff\xe0\x00\x10JFIF")
    with pytest.raises(SettingsError, match="no text file"):
        read_plan(tmp_path / "photo.csv")


# ---- fitting a plan to a rig


def test_a_pan_beyond_the_travel_is_said_a_turn_back():
    plan = fitted(turntable(4), features(ENDED))
    assert angles(plan) == [(0, 0), (90, 0), (180, 0), (-90, 0)]
    assert angles(fitted(turntable(4), features(PAN))) == angles(turntable(4))


def test_places_out_of_reach_are_all_told_before_anything_moves():
    plan = tuple(Place(Angles(0.0, tilt)) for tilt in (0, 61, 70, 80, 85, -41))
    with pytest.raises(LimitError) as caught:
        fitted(plan, features(PAN, TILT))
    message = str(caught.value)
    assert "pose 1 has tilt 61, beyond -40 to 60 degrees" in message
    assert "and 2 more" in message
    with pytest.raises(LimitError, match="pose 1 has tilt 61, and this rig has no tilt axis"):
        fitted(plan, features(PAN))
    with pytest.raises(LimitError, match="pose 0 has pan 400"):
        fitted((Place(Angles(400.0)),), features(Axis("pan", -10.0, 30.0, 0.01, 1.0)))
    with pytest.raises(LimitError, match="pose 1 needs a rig that turns"):
        fitted(plan, features())


def test_free_places_fit_every_rig_and_names_are_kept():
    assert fitted(free(3), features(PAN, TILT)) == free(3) == fitted(free(3), features())
    assert fitted((Place(Angles(350.0), "x"),), features(ENDED)) == (Place(Angles(-10.0), "x"),)


def test_a_place_half_a_step_beyond_the_end_is_the_end():
    fitted((Place(Angles(0.0, 60.004)),), features(PAN, TILT))
    with pytest.raises(LimitError):
        fitted((Place(Angles(0.0, 60.006)),), features(PAN, TILT))
