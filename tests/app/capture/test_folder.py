"""What a capture's photographs tell of the camera, the way it is held included."""

from pathlib import Path

import cv2
import pytest

from app.capture import folder as capture_folder
from app.capture import frames as capture_frames
from app.capture.desk.pictures import Pictures
from app.capture.order import CaptureError, Pose
from engine.io import session as sessions
from hardware.interfaces import Exposure, Frame, Taken
from tests.engine import folders

POSE = Pose(0, None)


class Wire:
    def __init__(self) -> None:
        self.told: list[dict] = []

    def emit(self, event: str, **facts) -> None:
        self.told.append(facts)

    def log(self, text: str) -> None:
        raise AssertionError(text)


def photograph(place: Path, tag: int) -> Path:
    place.mkdir()
    folders.write_raw_view(place, 0, folders.scene(0))
    file = place / "IMG_0001.DNG"
    if tag != 1:
        folders.tag([file], tag)
    return file


def checked(file: Path) -> list[capture_frames.Checked]:
    taken = Taken("/IMG_0001.DNG", 0.0, Exposure(None))
    frame = Frame(file, file.name, sessions.file_sha256(file), file.stat().st_size, taken)
    return capture_frames.check(POSE, [frame], 1, set(), False)


def test_the_first_photographs_orientation_is_the_sessions(tmp_path: Path) -> None:
    session = sessions.create(tmp_path / "s", "raw", {"model": None})
    for number, tag in enumerate((6, 1, 3)):
        (one,) = checked(photograph(tmp_path / str(number), tag))
        assert one.facts["orientation"] == {6: 6, 1: 0, 3: 3}[tag]
        session = capture_folder.with_camera(session, one.camera)
        assert sessions.open_session(tmp_path / "s").orientation == 6


def test_a_mirrored_photograph_ends_a_capture_that_would_take_more_of_them(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"pose0000: IMG_0001\.DNG: its Orientation tag \(4\) .* mirrored"):
        checked(photograph(tmp_path / "a", 4))


@pytest.mark.parametrize(("flip", "upright"), [(None, True), (5, True), (0, False), (3, False)])
def test_the_page_shows_a_photograph_upright(tmp_path: Path, flip: int | None, upright: bool) -> None:
    """By its own tag, or as its session stands."""
    wire = Wire()
    Pictures(wire, tmp_path).show([photograph(tmp_path / "a", 8)], "", flip)  # type: ignore[arg-type]
    for name in ("png", "clip_png"):
        height, width = cv2.imread(wire.told[0][name]).shape[:2]
        assert (height > width) is upright
