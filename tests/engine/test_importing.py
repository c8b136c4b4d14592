"""What fits is imported whole; what does not is refused with file, cause and remedy, and leaves nothing."""

import dataclasses
import datetime
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from engine import importing
from engine import session as sessions
from engine.errors import RoomlightError
from hardware.virtual import dng
from hardware.virtual.sensor import Sensor, bracket

WIDTH, HEIGHT, VIEWS = 48, 32, 8
START = datetime.datetime(2024, 5, 1, 10, 0, 0)


def write_exr(path: Path, image: np.ndarray) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(image, np.float32)}) as file:
        file.write(str(path))


def write_raw_view(folder: Path, number: int, radiance: np.ndarray, shutter_s: float = 0.01) -> None:
    rng = np.random.default_rng(number)
    start = START + datetime.timedelta(seconds=20 * number)
    for i, photograph in enumerate(bracket(radiance, shutter_s, Sensor(), start, rng)):
        dng.write(folder / f"IMG_{3 * number + i:04d}.DNG", photograph)


def scene(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    return np.random.default_rng(number).uniform(0.1, 2.0, (height, width, 3))


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    folder = tmp_path / "card"
    folder.mkdir()
    for number in range(VIEWS):
        write_raw_view(folder, number, scene(number))
    return folder


@pytest.fixture
def linear(tmp_path: Path) -> Path:
    folder = tmp_path / "renders"
    folder.mkdir()
    for number in range(VIEWS):
        write_exr(folder / f"{number:04d}.exr", scene(number))
    return folder


def write_poses(path: Path, count: int = VIEWS, stretch: float = 1.0, name: str = "{:04d}.exr") -> Path:
    matrix = np.eye(4)
    matrix[0, 0] = stretch
    frames = [{"file_path": name.format(i), "transform_matrix": matrix.tolist()} for i in range(count)]
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": 50, "fl_y": 50, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    path.write_text(json.dumps({**lens, "frames": frames}))
    return path


def write_mask(path: Path, width: int = WIDTH, height: int = HEIGHT, white: bool = True) -> Path:
    mask = np.zeros((height, width), np.uint8)
    mask[8:20, 10:30] = 255 if white else 0
    cv2.imwrite(str(path), mask)
    return path


def test_raw_brackets_become_views_with_their_facts(raw: Path, tmp_path: Path) -> None:
    session = importing.make_session(raw, tmp_path / "new.session")
    views = sessions.shots(session)
    assert session.kind == "raw"
    assert [view.name for view in views] == [f"IMG_{3 * i:04d}" for i in range(VIEWS)]
    assert all(len(view.files) == 3 for view in views)
    shutters = [facts["shutter_s"] for facts in views[0].exposures]
    np.testing.assert_allclose(np.divide(shutters[1:], shutters[:-1]), 8, rtol=0.01)
    assert views[0].files[0].read_bytes() == (raw / "IMG_0000.DNG").read_bytes()
    assert session.facts["camera"]["width"] == WIDTH


def test_linear_images_poses_and_mask_are_kept_as_given(linear: Path, tmp_path: Path) -> None:
    poses = write_poses(tmp_path / "transforms.json")
    mask = write_mask(tmp_path / "mask.png")
    session = importing.make_session(linear, tmp_path / "new.session", poses, mask)
    assert session.kind == "linear"
    assert set(sessions.edits(session)) == {"poses.json", "mask.png"}
    kept = json.loads((session.folder / "edits" / "poses.json").read_text())
    assert set(kept["views"]) == {f"{i:04d}" for i in range(VIEWS)}
    # OpenGL's identity looks along -z with y up: turned half about x in our camera frame.
    np.testing.assert_allclose(np.array(kept["views"]["0000"])[:, :3], np.diag([1, -1, -1]))


def test_images_in_a_folder_below_are_found_and_matched_to_their_poses(linear: Path, tmp_path: Path) -> None:
    outer = tmp_path / "outer"
    outer.mkdir()
    linear.rename(outer / "images")
    poses = write_poses(outer / "transforms.json", name="images/{:04d}.exr")
    session = importing.make_session(outer, tmp_path / "new.session", poses)
    assert sessions.shots(session)[3].name == "0003"


def test_poses_may_name_any_exposure_of_the_bracket(raw: Path, tmp_path: Path) -> None:
    poses = tmp_path / "transforms.json"
    write_poses(poses)
    content = json.loads(poses.read_text())
    for i, frame in enumerate(content["frames"]):
        frame["file_path"] = f"developed/IMG_{3 * i + 1:04d}.tif"
    poses.write_text(json.dumps(content))
    session = importing.make_session(raw, tmp_path / "new.session", poses)
    assert "poses.json" in sessions.edits(session)


Breaking = Callable[[Path], None]


def _truncate(folder: Path) -> None:
    path = folder / "IMG_0007.DNG"
    path.write_bytes(path.read_bytes()[:-500])


def _garbage(folder: Path) -> None:
    (folder / "IMG_0004.DNG").write_bytes(b"not a photograph" * 100)


def _other_size(folder: Path) -> None:
    write_raw_view(folder, VIEWS, scene(0, WIDTH + 2))


def _clipped(folder: Path) -> None:
    write_raw_view(folder, VIEWS, np.full((HEIGHT, WIDTH, 3), 1e5))


def _few(folder: Path) -> None:
    for path in sorted(folder.iterdir())[15:]:
        path.unlink()


def _empty(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def _other_camera(folder: Path) -> None:
    path = folder / "IMG_0012.DNG"
    photograph = bracket(scene(4), 0.01, Sensor(), START, np.random.default_rng(0))[0]
    dng.write(path, dataclasses.replace(photograph, model="Roomlight Virtual Two"))


def _mixed(folder: Path) -> None:
    write_exr(folder / "render.exr", scene(0))


@pytest.mark.parametrize(
    ("breaking", "message"),
    [
        (_empty, r"card: no photographs"),
        (_truncate, r"IMG_0007\.DNG: .*(cut off|decoded)"),
        (_garbage, r"IMG_0004\.DNG: "),
        (_other_camera, r"IMG_0012\.DNG: two cameras are mixed: .*Two here but .*One in IMG_0000\.DNG"),
        (_other_size, r"IMG_0024\.DNG: two sizes are mixed"),
        (lambda folder: (folder / "IMG_0010.DNG").unlink(), r"IMG_0009\.DNG: incomplete bracket"),
        (_clipped, r"IMG_0024\.DNG: 100% of the pixels are clipped"),
        (_few, r"5 views of 15 files; at least 8"),
        (_mixed, r"render\.exr: linear images \(1\) and RAW files \(24\) are mixed"),
    ],
)
def test_bad_raw_folders_are_refused(raw: Path, tmp_path: Path, breaking: Breaking, message: str) -> None:
    breaking(raw)
    _refused(message, raw, tmp_path / "new.session")


def _poison(value: float) -> Breaking:
    def breaking(folder: Path) -> None:
        image = scene(3)
        image[5, 7, 1] = value
        write_exr(folder / "0003.exr", image)

    return breaking


@pytest.mark.parametrize(
    ("breaking", "message"),
    [
        (_poison(np.nan), r"0003\.exr: 1 of \d+ values are NaN, the first at x 7, y 5"),
        (_poison(np.inf), r"0003\.exr: 1 of \d+ values are Inf"),
        (_poison(-0.5), r"0003\.exr: 1 of \d+ values are negative"),
        (lambda folder: write_exr(folder / "0005.exr", scene(0, 20, 20)), r"0005\.exr: two sizes are mixed"),
        (lambda folder: (folder / "0002.exr").write_bytes(b"v/1\x01"), r"0002\.exr: "),
    ],
)
def test_bad_linear_folders_are_refused(
    linear: Path, tmp_path: Path, breaking: Breaking, message: str
) -> None:
    breaking(linear)
    _refused(message, linear, tmp_path / "new.session")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "other_{}.exr"}, r"transforms\.json: no pose for"),
        ({"stretch": 1.2}, r"transforms\.json: .*not orthonormal"),
        ({"count": 5}, r"transforms\.json: no pose for 3 of 8"),
    ],
)
def test_bad_poses_are_refused(linear: Path, tmp_path: Path, arguments: dict, message: str) -> None:
    poses = write_poses(tmp_path / "transforms.json", **arguments)
    _refused(message, linear, tmp_path / "new.session", poses)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": WIDTH + 1}, r"mask\.png: the mask is 49 x 32"),
        ({"white": False}, r"mask\.png: the mask is no object"),
    ],
)
def test_bad_masks_are_refused(linear: Path, tmp_path: Path, arguments: dict, message: str) -> None:
    mask = write_mask(tmp_path / "mask.png", **arguments)
    _refused(message, linear, tmp_path / "new.session", None, mask)


def test_an_existing_session_is_never_touched(linear: Path, tmp_path: Path) -> None:
    session = importing.make_session(linear, tmp_path / "new.session")
    before = (session.folder / "session.json").stat().st_mtime_ns
    with pytest.raises(RoomlightError, match="exists already"):
        importing.make_session(linear, tmp_path / "new.session")
    assert (session.folder / "session.json").stat().st_mtime_ns == before


def _refused(message: str, folder: Path, to: Path, *given: Path | None) -> None:
    """One line, and neither a session nor a part of one."""
    before = set(to.parent.iterdir())
    with pytest.raises(RoomlightError, match=message) as fault:
        importing.make_session(folder, to, *given)
    assert "\n" not in str(fault.value)
    assert set(to.parent.iterdir()) == before
