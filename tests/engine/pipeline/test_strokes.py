"""Hand-painted strokes in a session: they correct a given mask, and the plan says that they will."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from engine.errors import MaskError
from engine.io import session as sessions
from engine.pipeline import run, stage_functions, stage_table, stages
from engine.pipeline.settings import Settings
from engine.segmentation.segment import SegmentReport
from engine.types import Masks
from tests.app import sessions as small


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    """With a given mask: rows 8 to 15, columns 10 to 19."""
    return sessions.open_session(small.small(tmp_path))


def paint(session: sessions.Session, add: tuple[slice, slice], remove: tuple[slice, slice]) -> None:
    image = np.zeros((small.HEIGHT, small.WIDTH, 3), np.uint8)
    image[add], image[remove] = (0, 255, 0), (0, 0, 255)
    sessions.write_edit(session, "strokes.png", cv2.imencode(".png", image)[1].tobytes())


def segment_step(session: sessions.Session) -> stages.Step:
    return stages.plan(session, stage_table.stages(), Settings())[1]


def found(session: sessions.Session) -> np.ndarray:
    steps = run.process(session, stage_table.stages(), Settings(), "cpu", "segment")
    return run.loader(steps)("segment", "masks", Masks).object


def test_strokes_correct_a_given_mask_where_they_are_painted(session: sessions.Session) -> None:
    expected = found(session).copy()
    assert expected.sum() == 80
    paint(session, (slice(4, 8), slice(10, 14)), (slice(14, 16), slice(10, 20)))
    expected[4:8, 10:14], expected[14:16, 10:20] = True, False
    np.testing.assert_array_equal(found(session), expected)


def test_what_the_photographs_say_of_a_given_mask_is_reported(session: sessions.Session) -> None:
    steps = run.process(session, stage_table.stages(), Settings(), "cpu", "segment")
    report = run.loader(steps)("segment", "report", SegmentReport)
    assert 0 <= report.border_alike <= 1
    assert math.isnan(report.stands_out)


def test_the_plan_says_that_strokes_came_changed_and_went(session: sessions.Session) -> None:
    found(session)
    before = segment_step(session).fingerprint
    one = (slice(0, 2), slice(0, 2)), (slice(9, 10), slice(11, 12))
    paint(session, *one)
    assert segment_step(session).tell() == "will run because input edits/strokes.png added"
    assert segment_step(session).fingerprint != before
    found(session)
    paint(session, one[1], one[0])
    assert segment_step(session).tell() == "will run because input edits/strokes.png changed"
    paint(session, *one)
    assert segment_step(session).done
    sessions.drop_edit(session, "strokes.png")
    assert segment_step(session).fingerprint == before
    sessions.drop_edit(session, "strokes.png")


def test_strokes_of_another_size_are_refused_with_a_remedy(session: sessions.Session) -> None:
    sessions.write_edit(
        session, "strokes.png", cv2.imencode(".png", np.zeros((3, 4, 3), np.uint8))[1].tobytes()
    )
    with pytest.raises(MaskError, match="must be a colour PNG of 32 x 24"):
        found(session)


def test_green_adds_red_takes_with_blue_exactly_and_all_else_says_nothing(tmp_path: Path) -> None:
    image = np.zeros((1, 7, 3), np.uint8)  # blue, green, red
    image[0] = [
        (0, 255, 0),
        (0, 0, 255),
        (255, 255, 0),
        (255, 0, 255),
        (0, 255, 255),
        (255, 0, 0),
        (0, 127, 0),
    ]
    cv2.imwrite(str(tmp_path / "strokes.png"), image)
    strokes = stage_functions.read_strokes(tmp_path / "strokes.png", 1, 7, (1, 7))
    assert strokes.exact is not None
    assert np.flatnonzero(strokes.add).tolist() == [0, 2]
    assert np.flatnonzero(strokes.remove).tolist() == [1, 3]
    hints = strokes.hints()
    assert hints is not None
    assert np.flatnonzero(hints.add | hints.remove).tolist() == [0, 1]
