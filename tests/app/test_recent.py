"""The start page knows a session's state from its folder alone, and a folder that is gone is no error."""

import json
from pathlib import Path

import pytest

from app import recent
from engine.io import session as sessions
from tests.app.sessions import VIEWS, small


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return small(tmp_path)


def finish(session: Path, stage: str) -> Path:
    folder = session / "stages" / stage / "0123456789abcdef"
    folder.mkdir(parents=True)
    (folder / "record.json").write_text("{}")
    return folder


def test_an_imported_session_is_not_processed(session: Path, tmp_path: Path) -> None:
    glance = recent.look(session, tmp_path / "cache")
    assert (glance.there, glance.views, glance.planned, glance.finished, glance.picture) == (
        True,
        VIEWS,
        None,
        (),
        None,
    )
    assert glance.name == "a"
    assert glance.changed > 0


def test_finished_stages_are_seen_and_unfinished_ones_are_not(session: Path, tmp_path: Path) -> None:
    finish(session, "hdr")
    finish(session, "light").rename(session / "stages" / "light" / "0123456789abcdef.partial")
    assert recent.look(session, tmp_path).finished == ("hdr",)


def test_a_capture_that_was_broken_off_says_how_far_it_got(session: Path, tmp_path: Path) -> None:
    (session / "capture").mkdir()
    (session / "capture" / "order.json").write_text(json.dumps({"poses": [None] * 12}))
    glance = recent.look(session, tmp_path)
    assert (glance.planned, glance.capture_unfinished) == (12, True)
    (session / "capture" / "order.json").write_text("damaged")
    assert not recent.look(session, tmp_path).capture_unfinished


def test_the_exported_photograph_is_the_picture_before_the_one_kept_in_the_cache(
    session: Path, tmp_path: Path
) -> None:
    kept = recent.thumbnail_file(session, tmp_path / "cache")
    kept.parent.mkdir(parents=True)
    kept.write_bytes(b"")
    assert recent.look(session, tmp_path / "cache").picture == kept
    (session / "exports" / "latest").mkdir()
    (session / "exports" / "latest" / "photograph.png").write_bytes(b"")
    picture = recent.look(session, tmp_path / "cache").picture
    assert picture == session / "exports" / "latest" / "photograph.png"


def test_new_photographs_make_a_kept_picture_stale(session: Path, tmp_path: Path) -> None:
    before = recent.thumbnail_file(session, tmp_path)
    file = tmp_path / "renders" / "0000.exr"
    sessions.add_shot(sessions.open_session(session), "new", [file], [{}])
    assert recent.thumbnail_file(session, tmp_path) != before


def test_a_folder_that_is_gone_or_no_session_is_not_there(tmp_path: Path) -> None:
    assert not recent.look(tmp_path / "gone").there
    assert not recent.look(tmp_path).there


def test_a_simulated_session_is_known_by_its_set(tmp_path: Path) -> None:
    assert recent.Glance(tmp_path / "study-blob" / "session", True).name == "study-blob"
