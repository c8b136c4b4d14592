"""Words of the Capture page mean what they say, and a session's capture is counted by its shots."""

from pathlib import Path

import pytest

from app.capture import order as capture_order
from app.capture import wanted
from app.capture.order import CaptureError, Order, Pose
from hardware.interfaces import Angles, Bracket, Exposure


def test_a_bracket_is_read_as_it_is_written() -> None:
    for stops in ((-3.0, 0.0, 3.0), (0.0,), (-1.5, 0.5)):
        assert wanted.parse_stops(wanted.told_stops(stops)) == stops
    assert wanted.parse_stops("-2,0, 2 EV") == (-2.0, 0.0, 2.0)


@pytest.mark.parametrize("text", ["", "many", "0 0", "-3 13", "nan", "-3,0,three", "inf"])
def test_what_is_no_bracket_is_refused_with_what_one_looks_like(text: str) -> None:
    with pytest.raises(CaptureError, match=";"):
        wanted.parse_stops(text)


@pytest.mark.parametrize(
    ("shutter_s", "told"),
    [(1 / 60, "1/60 s"), (0.5, "0.5 s"), (2.0, "2 s"), (1 / 8000, "1/8000 s"), (0.0001220703125, "1/8192 s")],
)
def test_shutters_are_told_as_on_a_camera(shutter_s: float, told: str) -> None:
    assert wanted.told_shutter(shutter_s) == told


def test_angles_are_told_without_a_negative_zero() -> None:
    assert wanted.told_angle(-0.01) == "0.0°"
    assert wanted.told_angle(-12.46) == f"{wanted.MINUS}12.5°"
    assert wanted.told_angle(None) == "\N{EN DASH}"


def test_a_free_place_is_the_first_that_is_not_there(tmp_path: Path) -> None:
    for number in (1, 2, 4):
        (tmp_path / f"capture-{number}.session").mkdir()
    assert wanted.free_place(tmp_path).name == "capture-3.session"


def test_rigs_on_a_port_of_unknown_kind_are_offered_as_each_kind() -> None:
    examples = ["grbl:///dev/ttyUSB0?axes=xy", "zaber:///dev/ttyUSB0?axes=1.1", "none:", "virtual:"]
    port = {"path": "/dev/ttyS9", "description": "a port", "likely": ""}
    urls = [choice.url for choice in wanted.rig_choices(examples, [port])]
    assert urls == ["virtual:", "grbl:///dev/ttyS9?axes=xy", "zaber:///dev/ttyS9?axes=1.1", "none:"]
    assert len(wanted.rig_choices(examples, [{**port, "likely": "zaber"}])) == 3
    assert [choice.kind for choice in wanted.rig_choices(examples, [])] == [
        "virtual",
        "grbl",
        "zaber",
        "none",
    ]
    assert [choice.kind for choice in wanted.camera_choices([])] == ["virtual", "folder"]


def test_what_is_left_is_counted_by_the_shots_that_can_be_read(tmp_path: Path) -> None:
    session = tmp_path / "a.session"
    assert wanted.captured(session) is None
    poses = tuple(Pose(i, Angles(10.0 * i)) for i in range(4))
    capture_order.write(session, Order("none:", "virtual:", "turntable", poses, Bracket(Exposure(None))))
    for i, text in enumerate(('{"name": "pose0002"}', '{"name": "pose00', '{"name": "other"}')):
        (session / "shots" / str(i)).mkdir(parents=True)
        (session / "shots" / str(i) / "shot.json").write_text(text)
    found = wanted.captured(session)
    assert found is not None
    assert found.done == {"pose0002"}
    assert found.left == 3
    capture_order.folder(session).joinpath("order.json").write_text("{")
    assert wanted.captured(session) is None
