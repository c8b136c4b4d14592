"""Masks and poses of upright pictures come in as those of the sensor's would, and sizes tell which they are."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from engine import importing
from engine.errors import PoseError, RoomlightError
from engine.io import session as sessions
from engine.io.poses import developed
from engine.io.poses.pose_files import GivenPoses, write_colmap, write_transforms
from engine.orientation import size as turned_size
from engine.orientation import turn_camera, turn_picture, turn_poses, turned
from engine.types import Camera, Poses
from tests.engine import folders
from tests.engine.results.test_metrics import ring

SIZE = (folders.WIDTH, folders.HEIGHT)
EXIF = {3: 3, 5: 8, 6: 6}  # the tag of each flip
CAMERA = Camera(*SIZE, 50.0, 52.0, 23.0, 17.0, 0.02, 0.01, 0.003, -0.002)
POINTS = np.random.default_rng(1).normal(size=(9, 3))
NAMES = tuple(f"IMG_{3 * i:04d}.DNG" for i in range(folders.VIEWS))
PLACED = Poses(CAMERA, ring(folders.VIEWS), np.ones(folders.VIEWS, bool), POINTS, "given", 0.1)
TURNS = pytest.mark.parametrize("flip", [3, 5, 6])


def card(tmp_path: Path, flip: int) -> Path:
    raw = folders.write_raw(tmp_path / "card")
    folders.tag(raw.iterdir(), EXIF[flip])
    return raw


def painted(path: Path, flip: int) -> Path:
    """The mask of `folders`, on a picture turned so."""
    mask = cv2.imread(str(folders.write_mask(path)), 0)
    cv2.imwrite(str(path), turn_picture(mask, flip))
    return path


def kept_mask(session: sessions.Session) -> np.ndarray:
    return cv2.imread(str(session.folder / "edits" / "mask.png"), 0) > 127


def as_painted(tmp_path: Path) -> np.ndarray:
    return cv2.imread(str(folders.write_mask(tmp_path / "plain.png")), 0) > 127


@TURNS
def test_a_mask_painted_on_the_upright_picture_lies_on_the_object(tmp_path: Path, flip: int) -> None:
    raw = card(tmp_path, flip)
    session = importing.make_session(raw, tmp_path / "s", mask=painted(tmp_path / "m.png", flip))
    np.testing.assert_array_equal(kept_mask(session), as_painted(tmp_path))
    assert session.orientation == flip
    said = " ".join(sessions.notes(session))
    assert ("which their size cannot tell" in said) is (flip == 3)


def test_a_mask_of_the_sensors_size_is_left_as_it_is_and_said(tmp_path: Path) -> None:
    raw = card(tmp_path, 6)
    session = importing.make_session(raw, tmp_path / "s", mask=painted(tmp_path / "m.png", 0))
    np.testing.assert_array_equal(kept_mask(session), as_painted(tmp_path))
    assert "as the sensor lies, and not turned" in " ".join(sessions.notes(session))


def test_a_mask_of_another_size_is_refused_with_the_upright_pictures_size(tmp_path: Path) -> None:
    raw, mask = card(tmp_path, 6), folders.write_mask(tmp_path / "m.png", 40, 40)
    with pytest.raises(RoomlightError, match=r"m\.png: the mask is 40 x 40, the photographs are 32 x 48"):
        importing.make_session(raw, tmp_path / "s", mask=mask)
    assert not (tmp_path / "s").exists()


def test_untagged_photographs_are_imported_as_ever(tmp_path: Path) -> None:
    raw, mask = folders.write_raw(tmp_path / "card"), folders.write_mask(tmp_path / "m.png")
    session = importing.make_session(raw, tmp_path / "s", mask=mask)
    assert (session.folder / "edits" / "mask.png").read_bytes() == mask.read_bytes()
    assert set(session.facts) == {"schema", "kind", "camera", "rig"}
    assert set(session.facts["camera"]) == {"model", "width", "height"}
    assert sessions.notes(session) == ()


@TURNS
@pytest.mark.parametrize("write", [write_colmap, write_transforms])
@pytest.mark.parametrize("of_sensor", [False, True])
def test_poses_of_upright_pictures_are_kept_as_those_of_the_sensors(
    tmp_path: Path, flip: int, write, of_sensor: bool
) -> None:
    if of_sensor and flip == 3:
        return  # no size tells; upright is taken
    raw = card(tmp_path, flip)
    shown = PLACED if of_sensor else turned(PLACED, flip)
    given = tmp_path / ("model" if write is write_colmap else "transforms.json")
    write(given, shown, NAMES)
    session = importing.make_session(raw, tmp_path / "s", given)
    kept = json.loads((session.folder / "edits" / "poses.json").read_text())
    for term in ("width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"):
        assert kept["camera"][term] == pytest.approx(getattr(CAMERA, term), abs=1e-9), term
    found = np.array([kept["views"][Path(name).stem] for name in NAMES])
    np.testing.assert_allclose(found, PLACED.cam_from_world, atol=1e-9)
    assert ("The poses were" in " ".join(sessions.notes(session))) is (of_sensor or flip == 3)


MIXED = [6, 0, 6, 3, 6, 5, 6, 6]
CENTRED = replace(CAMERA, cx=24.0, cy=16.0, p1=0.0, p2=0.0)
"""Pictures of one size that were turned otherwise share a camera in a pose file: no other can be right for all."""


def reader(flips: list[int], longer: float = 1.0):
    """A pose file of pictures turned so, with a camera for each size (of upright pictures, `longer` focal lengths)."""

    def read(views, size) -> GivenPoses:
        if {turned_size(SIZE, flips[i]) for i in views} != {size}:
            raise PoseError(f"other pictures than of {size}")
        camera = turn_camera(CENTRED, flips[views[0]])
        if size != SIZE:
            camera = replace(camera, fx=camera.fx * longer, fy=camera.fy * longer)
        poses = np.stack([turn_poses(PLACED.cam_from_world[i], flips[i]) for i in views])
        return GivenPoses(camera, poses, np.ones(len(views), bool), POINTS, "given", ("a note",))

    return read


@pytest.mark.parametrize("made_on", [MIXED, [6] * 8, [0] * 8], ids=["own tags", "all alike", "sensor"])
def test_where_tags_differ_sizes_tell_how_the_pictures_were_turned(made_on: list[int]) -> None:
    given, notes = developed.poses(reader(made_on), MIXED, SIZE)
    np.testing.assert_allclose(given.cam_from_world, PLACED.cam_from_world, atol=1e-12)
    assert given.camera == CENTRED
    assert given.notes == ("a note",)
    assert (given.registered.all(), len(notes)) == (True, 0 if made_on == [6] * 8 else 1)


def test_two_cameras_that_are_not_one_turned_are_refused() -> None:
    with pytest.raises(
        PoseError, match=r"turned not at all and .* differ by 10\.8 % of the picture.*turned alike"
    ):
        developed.poses(reader(MIXED, longer=1.1), MIXED, SIZE)


def test_the_objects_orientation_is_the_most_frequent_and_differences_are_said(tmp_path: Path) -> None:
    raw = folders.write_raw(tmp_path / "card")
    files = sorted(raw.iterdir())
    folders.tag(files[:15], 6)
    folders.tag(files[15:18], 8)
    session = importing.make_session(raw, tmp_path / "s")
    assert session.orientation == 6
    assert [shot.exposures[0]["orientation"] for shot in sessions.shots(session)] == [6] * 5 + [5, 0, 0]
    (said,) = sessions.notes(session)
    assert "9 of 24 photographs differ" in said
    assert "turned by 90 degrees to the right" in said


def test_a_mirrored_photograph_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    raw = folders.write_raw(tmp_path / "card")
    folders.tag([raw / "IMG_0009.DNG"], 2)
    with pytest.raises(RoomlightError, match=r"IMG_0009\.DNG: its Orientation tag \(2\) .* mirrored"):
        importing.make_session(raw, tmp_path / "s")
    assert sorted(tmp_path.iterdir()) == [raw]


@pytest.mark.parametrize("told", [7, "6", None, [3], 1.5])
def test_a_session_with_no_such_orientation_is_damaged(tmp_path: Path, told: object) -> None:
    sessions.create(tmp_path / "s", "raw", {"width": 4, "height": 3, "orientation": told})
    with pytest.raises(
        RoomlightError, match=r"session\.json: damaged \(camera .*import the photographs again"
    ):
        sessions.open_session(tmp_path / "s")
