"""What the mask page reads and writes: strokes survive everything, and never change under a run."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from app import mask_files
from app.mask_files import STROKES, WAITING, Keeper
from app.masking import ADD, EXACT, TAKE
from engine.errors import MaskError, SessionError
from engine.io import session as sessions
from engine.orientation import turn_picture
from engine.pipeline import run, stage_functions, stage_table, stages
from engine.pipeline.settings import Settings, with_changes
from tests.app import sessions as small


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return small.small(tmp_path)


def labels(height: int = small.HEIGHT, width: int = small.WIDTH) -> np.ndarray:
    made = np.zeros((height, width), np.uint8)
    made[2:9, 3:8], made[10:14, 9:20] = ADD, TAKE
    made[2:4], made[10:12] = made[2:4] + EXACT * (made[2:4] > 0), made[10:12] + EXACT * (made[10:12] > 0)
    return made


def folders(session: Path, *changes: str) -> tuple[Path, Path]:
    settings = with_changes(Settings(), None, None, list(changes))
    hdr, segment = stages.plan(sessions.open_session(session), stage_table.stages(), settings)[:2]
    return hdr.folder, segment.folder


def process(session: Path, *changes: str) -> None:
    settings = with_changes(Settings(), None, None, list(changes))
    run.process(sessions.open_session(session), stage_table.stages(), settings, "cpu", "segment")


def test_strokes_come_back_as_they_were_painted(session: Path) -> None:
    assert not mask_files.read_labels(session, (small.HEIGHT, small.WIDTH)).any()
    assert Keeper().keep(session, labels(), 1) == ""
    np.testing.assert_array_equal(mask_files.read_labels(session, (small.HEIGHT, small.WIDTH)), labels())
    assert set(sessions.edits(sessions.open_session(session))) == {"mask.png", STROKES}


def test_the_engine_reads_what_was_painted(session: Path) -> None:
    Keeper().keep(session, labels(), 1)
    size = small.HEIGHT, small.WIDTH
    strokes = stage_functions.read_strokes(session / "edits" / STROKES, *size, size)
    np.testing.assert_array_equal(strokes.add, np.isin(labels(), (ADD, ADD + EXACT)))
    np.testing.assert_array_equal(strokes.remove, np.isin(labels(), (TAKE, TAKE + EXACT)))
    np.testing.assert_array_equal(strokes.exact, labels() > EXACT)


@pytest.mark.parametrize("channels", [3, 4])
def test_pictures_of_other_programs_are_read_as_the_engine_reads_them(session: Path, channels: int) -> None:
    rng = np.random.default_rng(0)
    image = rng.choice([0, 100, 127, 128, 255], (small.HEIGHT, small.WIDTH, channels)).astype(np.uint8)
    path = session / "edits" / STROKES
    cv2.imwrite(str(path), image)
    size = small.HEIGHT, small.WIDTH
    strokes, read = stage_functions.read_strokes(path, *size, size), mask_files.read_labels(session, size)
    np.testing.assert_array_equal(np.isin(read, (ADD, ADD + EXACT)), strokes.add)
    np.testing.assert_array_equal(np.isin(read, (TAKE, TAKE + EXACT)), strokes.remove)
    assert strokes.exact is not None
    np.testing.assert_array_equal(read > EXACT, strokes.exact & (strokes.add | strokes.remove))


def test_photographs_averaged_down_are_painted_on_their_own_grid(session: Path) -> None:
    """32 x 24 photographs by three: the last two columns belong to no pixel."""
    coarse = np.zeros((8, 10), np.uint8)
    coarse[2:5, 3:6], coarse[6, 9] = ADD, TAKE
    Keeper().keep(session, coarse, 1)
    np.testing.assert_array_equal(mask_files.read_labels(session, (8, 10)), coarse)
    process(session, "hdr.long_edge_px=11")
    shown = mask_files.load(session, *folders(session, "hdr.long_edge_px=11"), None)
    assert shown is not None
    assert shown.shape == (8, 10)
    assert shown.object is not None
    assert shown.object[2:5, 3:6].all()


def test_strokes_wait_while_another_process_works_on_the_session(session: Path) -> None:
    opened, keeper = sessions.open_session(session), Keeper()
    keeper.keep(session, labels(), 1)
    before = sessions.edits(opened)
    fewer = np.where(labels() == ADD, ADD, 0).astype(np.uint8)
    with sessions.lock(opened):
        told = keeper.keep(session, fewer, 2)
        assert "is working on this session" in told
        assert sessions.edits(opened) == before  # the run's inputs stay
        # A window that opens now finds the newest strokes.
        np.testing.assert_array_equal(mask_files.read_labels(session, (small.HEIGHT, small.WIDTH)), fewer)
        assert mask_files.waiting(session)
    assert Keeper().settle(session) == ""
    assert not mask_files.waiting(session)
    assert sessions.edits(opened) != before
    np.testing.assert_array_equal(mask_files.read_labels(session, (small.HEIGHT, small.WIDTH)), fewer)


def test_clearing_waits_too_and_then_leaves_no_file(session: Path) -> None:
    opened, keeper = sessions.open_session(session), Keeper()
    none = np.zeros_like(labels())
    keeper.keep(session, labels(), 1)
    with sessions.lock(opened):
        assert keeper.keep(session, none, 2)
        assert not mask_files.read_labels(session, (small.HEIGHT, small.WIDTH)).any()
    assert keeper.settle(session) == ""
    assert set(sessions.edits(opened)) == {"mask.png"}
    assert not (session / "edits" / WAITING).exists()


def test_the_same_strokes_are_the_same_file(session: Path) -> None:
    camera = (small.HEIGHT, small.WIDTH)
    assert mask_files.encoded(labels(), camera) == mask_files.encoded(labels(), camera)


def test_older_strokes_never_replace_newer_ones(session: Path) -> None:
    keeper = Keeper()
    keeper.keep(session, labels(), 2)
    keeper.keep(session, np.zeros_like(labels()), 1)
    np.testing.assert_array_equal(mask_files.read_labels(session, (small.HEIGHT, small.WIDTH)), labels())


def test_a_file_that_is_no_picture_of_that_size_is_told(session: Path) -> None:
    path = session / "edits" / STROKES
    cv2.imwrite(str(path), np.zeros((5, 6, 3), np.uint8))
    with pytest.raises(MaskError, match="is 6 x 5, the photographs are 32 x 24"):
        mask_files.read_labels(session, (small.HEIGHT, small.WIDTH))
    path.write_bytes(b"no picture")
    with pytest.raises(MaskError, match="cannot be read"):
        mask_files.read_labels(session, (small.HEIGHT, small.WIDTH))


def test_what_is_no_session_is_not_written_to(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="not a session"):
        Keeper().keep(tmp_path, labels(), 1)


def test_the_newest_result_stands_in_for_one_that_is_not_there(session: Path) -> None:
    assert mask_files.load(session, *folders(session), None) is None
    process(session)
    first = mask_files.load(session, *folders(session), None)
    assert first is not None
    assert first.object is not None
    assert mask_files.object_box(first.object) == (10, 8, 20, 16)
    assert first.area == 80
    assert {tuple(piece) for piece in first.border.tolist()} >= {(10, 8, 20, 8), (20, 8, 20, 16)}
    assert mask_files.load(session, *folders(session), first) is first
    Keeper().keep(session, labels(), 1)
    hdr, segment = folders(session)
    assert not segment.exists()
    assert mask_files.load(session, hdr, segment, first) is first
    process(session)
    second = mask_files.load(session, hdr, segment, first)
    assert second is not None
    assert second.segment == segment
    # Strokes that were taken back, and others: the outline stays, and not the newest's is shown.
    assert mask_files.load(session, hdr, segment.with_name("another"), first) is first


def test_the_mean_is_that_of_the_views(session: Path) -> None:
    process(session)
    shown = mask_files.load(session, *folders(session), None)
    assert shown is not None
    expected = np.minimum(shown.frames.radiance, shown.white).mean(axis=0)
    np.testing.assert_allclose(mask_files.mean(shown), expected, rtol=1e-5)
    one, brighter = (mask_files.picture(shown, None, ev)[0].astype(int) for ev in (0.0, 1.0))
    assert brighter.sum() > one.sum()
    assert mask_files.picture(shown, 3, 0.0)[0].shape == (small.HEIGHT, small.WIDTH, 4)


@pytest.mark.parametrize("flip", [3, 5, 6])
def test_what_is_painted_on_upright_photographs_is_kept_as_the_sensor_lies(session: Path, flip: int) -> None:
    opened = sessions.open_session(session)
    sessions.describe(opened, {**opened.facts["camera"], "orientation": flip})
    process(session, "hdr.long_edge_px=16")
    shown = mask_files.load(session, *folders(session, "hdr.long_edge_px=16"), None)
    assert shown is not None
    assert shown.object is not None
    before = cv2.imread(str(session / "edits" / "mask.png"), 0)[::2, ::2] > 127
    np.testing.assert_array_equal(shown.object, turn_picture(before, flip))
    painted = np.zeros(shown.shape, np.uint8)
    painted[1:4, 2:5], painted[6, 7:9] = ADD, TAKE
    Keeper().keep(session, painted, 1)
    np.testing.assert_array_equal(mask_files.read_labels(session, shown.shape), painted)
    size = small.HEIGHT, small.WIDTH
    strokes = stage_functions.read_strokes(session / "edits" / STROKES, *size, size)
    np.testing.assert_array_equal(turn_picture(strokes.add, flip)[::2, ::2], painted == ADD)
    np.testing.assert_array_equal(turn_picture(strokes.remove, flip)[::2, ::2], painted == TAKE)
