"""A pose is taken again: its shot is put aside, never deleted, and comes back unless another has taken its place."""

from pathlib import Path

import pytest

from app import photographs
from app.capture import aside, wanted
from app.capture import order as capture_order
from engine.errors import SessionError
from engine.io import left_out
from engine.io import session as sessions
from tests.app.capture import captures


def test_a_shot_put_aside_is_missing_until_it_is_brought_back_or_taken_again(tmp_path: Path) -> None:
    session = sessions.create(tmp_path / "a.session", "raw", {"model": None})
    wanted_order = captures.order(3)
    (session.folder / "capture").mkdir()
    capture_order.write(session.folder, wanted_order)
    source = tmp_path / "a.dng"
    source.write_bytes(b"light")
    for pose in wanted_order.poses:
        sessions.add_shot(session, pose.name, [source], [{"shutter_s": 0.1}])
    left_out.write(session, {"pose0001"}, ())
    listing = photographs.read(session.folder)
    assert listing.captured
    kept = photographs.take_again(listing, listing.photographs[1])
    captured = wanted.captured(session.folder)
    assert captured is not None
    assert captured.done == {"pose0000", "pose0002"}
    assert left_out.read(session) == set()  # that was said of the photograph, not of the pose
    photographs.bring_back(listing, listing.photographs[1], kept)
    assert [shot.name for shot in sessions.shots(session)] == ["pose0000", "pose0001", "pose0002"]
    kept = aside.take_again(session, "0001")
    sessions.add_shot(session, "pose0001", [source], [{"shutter_s": 0.1}])
    with pytest.raises(SessionError, match="pose0001 has been taken again; the earlier one stays in"):
        aside.bring_back(session, kept, "0001")
    assert (kept / "shot.json").exists()
