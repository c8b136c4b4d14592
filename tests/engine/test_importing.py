"""What fits is imported whole; what does not is refused with file, cause and remedy, and leaves nothing."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from engine import importing
from engine.errors import RoomlightError
from engine.io import session as sessions
from tests.engine import folders


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    return folders.write_raw(tmp_path / "card")


@pytest.fixture
def linear(tmp_path: Path) -> Path:
    return folders.write_linear(tmp_path / "renders")


def test_raw_brackets_become_views_with_their_facts(raw: Path, tmp_path: Path) -> None:
    session = importing.make_session(raw, tmp_path / "new.session")
    views = sessions.shots(session)
    assert session.kind == "raw"
    assert [view.name for view in views] == [f"IMG_{3 * i:04d}" for i in range(folders.VIEWS)]
    assert all(len(view.files) == 3 for view in views)
    shutters = [facts["shutter_s"] for facts in views[0].exposures]
    np.testing.assert_allclose(np.divide(shutters[1:], shutters[:-1]), 8, rtol=0.01)
    assert views[0].files[0].read_bytes() == (raw / "IMG_0000.DNG").read_bytes()
    assert session.facts["camera"]["width"] == folders.WIDTH


def test_linear_images_poses_and_mask_are_kept_as_given(linear: Path, tmp_path: Path) -> None:
    poses = folders.write_poses(tmp_path / "transforms.json")
    mask = folders.write_mask(tmp_path / "mask.png")
    session = importing.make_session(linear, tmp_path / "new.session", poses, mask)
    assert session.kind == "linear"
    assert set(sessions.edits(session)) == {"poses.json", "mask.png"}
    kept = json.loads((session.folder / "edits" / "poses.json").read_text())
    assert set(kept["views"]) == {f"{i:04d}" for i in range(folders.VIEWS)}
    # OpenGL's identity looks along -z with y up: turned half about x in our camera frame.
    np.testing.assert_allclose(np.array(kept["views"]["0000"])[:, :3], np.diag([1, -1, -1]))


def test_negative_values_that_are_kept_are_counted_aloud(linear: Path, tmp_path: Path) -> None:
    folders.poisoned(-0.01)(linear)
    (note,) = sessions.notes(importing.make_session(linear, tmp_path / "new.session"))
    values = 3 * folders.WIDTH * folders.HEIGHT
    assert f"1 of {folders.VIEWS} pictures hold negative values, most 0003.exr: 1 of {values}" in note


def test_images_in_a_folder_below_are_found_and_matched_to_their_poses(linear: Path, tmp_path: Path) -> None:
    outer = tmp_path / "outer"
    outer.mkdir()
    linear.rename(outer / "images")
    poses = folders.write_poses(outer / "transforms.json", name="images/{:04d}.exr")
    session = importing.make_session(outer, tmp_path / "new.session", poses)
    assert sessions.shots(session)[3].name == "0003"


def test_poses_may_name_any_exposure_of_the_bracket(raw: Path, tmp_path: Path) -> None:
    poses = tmp_path / "transforms.json"
    folders.write_poses(poses)
    content = json.loads(poses.read_text())
    for i, frame in enumerate(content["frames"]):
        frame["file_path"] = f"developed/IMG_{3 * i + 1:04d}.tif"
    poses.write_text(json.dumps(content))
    session = importing.make_session(raw, tmp_path / "new.session", poses)
    assert "poses.json" in sessions.edits(session)


def test_how_many_views_were_given_a_pose_is_told_and_kept(linear: Path, tmp_path: Path) -> None:
    poses = folders.write_poses(tmp_path / "transforms.json", count=7)
    session = importing.make_session(linear, tmp_path / "new.session", poses)
    assert importing.describe_poses(session) == (
        "poses: 7 of 8 views have one; no pose for 1 of 8 photographs: 0007.exr"
    )
    kept = json.loads((session.folder / "edits" / "poses.json").read_text())
    assert kept["notes"] == ["no pose for 1 of 8 photographs: 0007.exr"]
    assert kept["views"]["0007"] is None
    without = importing.make_session(linear, tmp_path / "none.session")
    assert importing.describe_poses(without) == "poses: none given; `process` finds them"


@pytest.mark.parametrize(
    ("breaking", "message"),
    [
        (folders.emptied, r"card: no photographs"),
        (folders.truncated, r"IMG_0007\.DNG: .*(cut off|decoded)"),
        (folders.filled(b"not a photograph" * 100), r"IMG_0004\.DNG: "),
        (
            folders.other_camera,
            r"IMG_0012\.DNG: two cameras are mixed: .*Two here but .*One in IMG_0000\.DNG",
        ),
        (folders.other_size, r"IMG_0024\.DNG: two sizes are mixed"),
        (
            folders.incomplete,
            r"7 views of 23 files; .*IMG_0009\.DNG and IMG_0011\.DNG belong to no whole bracket",
        ),
        (folders.clipped, r"IMG_0024\.DNG: 100% of the pixels are clipped"),
        (folders.few, r"5 views of 15 files; at least 8"),
        (folders.mixed, r"render\.exr: linear images \(1\) and RAW files \(24\) are mixed"),
    ],
)
def test_bad_raw_folders_are_refused(
    raw: Path, tmp_path: Path, breaking: folders.Breaking, message: str
) -> None:
    breaking(raw)
    _refused(message, raw, tmp_path / "new.session")


@pytest.mark.parametrize(
    ("breaking", "message"),
    [
        (folders.poisoned(np.nan), r"0003\.exr: 1 of \d+ values are NaN, the first at x 7, y 5"),
        (folders.poisoned(np.inf), r"0003\.exr: 1 of \d+ values are Inf"),
        (folders.poisoned(-5.0), r"0003\.exr: 1 of \d+ values are negative"),
        (folders.other_image, r"0005\.exr: two sizes are mixed"),
        (folders.cut_image, r"0002\.exr: "),
    ],
)
def test_bad_linear_folders_are_refused(
    linear: Path, tmp_path: Path, breaking: folders.Breaking, message: str
) -> None:
    breaking(linear)
    _refused(message, linear, tmp_path / "new.session")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "other_{}.exr"}, r"transforms\.json: no pose for"),
        ({"stretch": 1.2}, r"transforms\.json: .*not orthonormal"),
        ({"count": 4}, r"transforms\.json: no pose for 4 of 8"),
    ],
)
def test_bad_poses_are_refused(linear: Path, tmp_path: Path, arguments: dict, message: str) -> None:
    poses = folders.write_poses(tmp_path / "transforms.json", **arguments)
    _refused(message, linear, tmp_path / "new.session", poses)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": folders.WIDTH + 1}, r"mask\.png: the mask is 49 x 32"),
        ({"white": False}, r"mask\.png: the mask is no object"),
    ],
)
def test_bad_masks_are_refused(linear: Path, tmp_path: Path, arguments: dict, message: str) -> None:
    mask = folders.write_mask(tmp_path / "mask.png", **arguments)
    _refused(message, linear, tmp_path / "new.session", None, mask)


def test_an_existing_session_is_never_touched(linear: Path, tmp_path: Path) -> None:
    session = importing.make_session(linear, tmp_path / "new.session")
    before = (session.folder / "session.json").stat().st_mtime_ns
    with pytest.raises(RoomlightError, match="exists already"):
        importing.make_session(linear, tmp_path / "new.session")
    assert (session.folder / "session.json").stat().st_mtime_ns == before


def test_what_belongs_to_no_whole_bracket_is_left_out_and_kept_in_the_session(
    raw: Path, tmp_path: Path
) -> None:
    folders.write_raw_view(raw, folders.VIEWS, folders.scene(folders.VIEWS))
    (raw / "IMG_0000.DNG").unlink()
    session = importing.make_session(raw, tmp_path / "new.session")
    assert [view.name for view in sessions.shots(session)] == [f"IMG_{3 * i:04d}" for i in range(1, 9)]
    note = "IMG_0001.DNG and IMG_0002.DNG belong to no whole bracket of 3 exposures and are left out."
    assert sessions.notes(session) == (note,)


def test_folders_behind_links_are_entered_once(linear: Path, tmp_path: Path) -> None:
    outer = tmp_path / "outer"
    outer.mkdir()
    (outer / "card").symlink_to(linear)
    (outer / "again").symlink_to(linear)
    (linear / "round").symlink_to(outer)
    session = importing.make_session(outer, tmp_path / "new.session")
    assert [view.name for view in sessions.shots(session)] == [f"{i:04d}" for i in range(folders.VIEWS)]
    (tmp_path / "link").symlink_to(linear)
    assert importing.find_photographs(tmp_path / "link")[1][0].name == "0000.exr"


def test_one_photograph_in_two_formats_is_refused(raw: Path, linear: Path, tmp_path: Path) -> None:
    shutil.copy(linear / "0003.exr", linear / "0003.HDR")
    _refused(r"0003\.(HDR|exr): the same photograph as 0003\.", linear, tmp_path / "new.session")
    for path in sorted(raw.iterdir())[:5]:
        shutil.copy(path, path.with_suffix(".nef"))
    _refused(
        r"the same photograph as IMG_0000.*, and 4 more such pairs; put one", raw, tmp_path / "new.session"
    )


def test_the_same_file_in_two_folders_is_refused_but_not_two_of_one_name(
    linear: Path, tmp_path: Path
) -> None:
    outer = tmp_path / "outer"
    outer.mkdir()
    linear.rename(outer / "a")
    (outer / "b").mkdir()
    folders.write_exr(outer / "b" / "0000.exr", folders.scene(99))
    assert len(importing.find_photographs(outer)[1]) == folders.VIEWS + 1
    shutil.copy(outer / "a" / "0001.exr", outer / "b")
    _refused(r"b/0001\.exr: the same photograph as 0001\.exr in .*a; put", outer, tmp_path / "new.session")


def test_a_copy_under_another_name_is_refused_and_empty_files_are_no_copies(
    raw: Path, tmp_path: Path
) -> None:
    first, *others = sorted(raw.iterdir())
    shutil.copy(first, first.with_stem(f"{first.stem} (1)"))
    _refused(rf"{first.stem}.*: the same photograph as {first.stem}", raw, tmp_path / "new.session")
    first.with_stem(f"{first.stem} (1)").unlink()
    for path in others[:2]:
        path.write_bytes(b"")
    _refused(f"{others[0].name}: it cannot be read or is cut off", raw, tmp_path / "new.session")


def test_names_that_are_not_utf8_are_refused_by_name(linear: Path, tmp_path: Path) -> None:
    (linear / "0003.exr").rename(linear / os.fsdecode(b"\xff3.exr"))
    _refused(r"udcff3\.exr'?: its name is not written in UTF-8; rename it", linear, tmp_path / "new.session")


def test_jpegs_beside_their_raw_files_are_not_views(raw: Path) -> None:
    for path in list(raw.iterdir()):
        path.with_suffix(".JPG").write_bytes(b"\xff\xd8")
    assert {path.suffix for path in importing.find_photographs(raw)[1]} == {".DNG"}


def _refused(message: str, folder: Path, to: Path, *given: Path | None) -> None:
    """One line, and neither a session nor a part of one."""
    before = set(to.parent.iterdir())
    with pytest.raises(RoomlightError, match=message) as fault:
        importing.make_session(folder, to, *given)
    assert "\n" not in str(fault.value)
    assert set(to.parent.iterdir()) == before
