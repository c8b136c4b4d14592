"""A session keeps what it was given, and says what is wrong with it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from engine.errors import SessionError
from engine.io import session as sessions


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    return sessions.create(
        tmp_path / "lion.session", "raw", {"model": "none"}, {"kind": "gimbal", "geometry": {}}
    )


def add(session: sessions.Session, name: str, *contents: bytes) -> sessions.Shot:
    sources = []
    for i, content in enumerate(contents):
        source = session.folder.parent / f"{name}_{i}.DNG"
        source.write_bytes(content)
        sources.append(source)
    return sessions.add_shot(session, name, sources, [{"shutter_s": 0.5}] * len(contents), {"pan_deg": 3.0})


def test_what_goes_in_comes_out_in_order(session: sessions.Session) -> None:
    for name in ("b", "a", "c"):
        add(session, name, name.encode(), b"second")
    again = sessions.open_session(session.folder)
    assert again.facts["rig"] == {"kind": "gimbal", "geometry": {}}
    shots = sessions.shots(again)
    assert [shot.name for shot in shots] == ["b", "a", "c"]
    assert [path.name for path in shots[1].files] == ["e0.dng", "e1.dng"]
    assert shots[1].files[0].read_bytes() == b"a"
    assert shots[1].exposures[0]["source"] == "a_0.DNG"
    assert shots[1].rig == {"pan_deg": 3.0}
    for shot in shots:
        sessions.verify(shot)


def test_a_shot_cut_off_by_a_crash_does_not_exist_and_its_place_is_used_again(
    session: sessions.Session,
) -> None:
    add(session, "one", b"1")
    (add(session, "two", b"2").folder / "shot.json").unlink()
    assert [shot.name for shot in sessions.shots(session)] == ["one"]
    add(session, "three", b"3")
    assert [shot.folder.name for shot in sessions.shots(session)] == ["0000", "0001"]


def test_a_changed_shot_is_told(session: sessions.Session) -> None:
    shot = add(session, "one", b"photograph")
    shot.files[0].write_bytes(b"photoGraph")
    with pytest.raises(SessionError, match=r"e0\.dng: its bytes changed"):
        sessions.verify(shot)
    shot.files[0].write_bytes(b"photo")
    with pytest.raises(SessionError, match="has 5 bytes, 10 were taken"):
        sessions.shots(session)
    shot.files[0].unlink()
    with pytest.raises(SessionError, match="missing"):
        sessions.shots(session)


def test_a_newer_schema_asks_for_a_newer_roomlight(session: sessions.Session) -> None:
    path = session.folder / "session.json"
    path.write_text(json.dumps({**session.facts, "schema": sessions.SCHEMA + 1}))
    with pytest.raises(SessionError, match="install a newer roomlight"):
        sessions.open_session(session.folder)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b'{"schema": 1}', b"\xff\xfe"])
def test_a_damaged_session_is_told(session: sessions.Session, content: bytes) -> None:
    (session.folder / "session.json").write_bytes(content)
    with pytest.raises(SessionError, match=r"session\.json: damaged"):
        sessions.open_session(session.folder)


def test_a_folder_that_is_no_session_is_told(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="not a session"):
        sessions.open_session(tmp_path)


def test_a_session_is_never_made_over_something_else(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(SessionError, match="exists already"):
        sessions.create(tmp_path, "raw", {})
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_edits_are_hashed_by_content(session: sessions.Session) -> None:
    sessions.write_edit(session, "mask.png", b"one")
    before = sessions.edits(session)
    sessions.write_edit(session, "mask.png", b"two")
    assert before.keys() == sessions.edits(session).keys() == {"mask.png"}
    assert before != sessions.edits(session)


def test_a_folder_that_vanished_is_told(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    with (
        pytest.raises(SessionError, match=r"gone.*no such file or folder.*check the path"),
        sessions.told(gone),
    ):
        sessions.write_atomic(gone / "session.json", b"")


def test_a_folder_without_write_permission_is_told(session: sessions.Session) -> None:
    """Without root's power to write anywhere."""
    code = (
        "import sys; from pathlib import Path; from engine.io import session as s\n"
        "try:\n"
        "    with s.lock(s.open_session(Path(sys.argv[1]))): pass\n"
        "except s.SessionError as error: print(error)\n"
    )
    powerless = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.getuid() == 0 else []
    session.folder.chmod(0o555)
    try:
        root = Path(__file__).parents[3]
        answer = subprocess.run(
            [*powerless, sys.executable, "-c", code, str(session.folder)],
            cwd=root,
            capture_output=True,
            text=True,
        )
    finally:
        session.folder.chmod(0o755)
    assert "no permission to write here; change the folder's permissions" in answer.stdout, answer.stderr


def test_a_refusal_names_the_file_that_was_asked_for(tmp_path: Path) -> None:
    partial = str(tmp_path / ".strokes.png.partial")
    for code, first, second in ((30, partial, None), (28, "/card/IMG_1.dng", partial)):
        with (
            pytest.raises(SessionError, match=rf"^{tmp_path / 'strokes.png'}: the disk is "),
            sessions.told(tmp_path / "strokes.png"),
        ):
            raise OSError(code, "no", first, None, second)


def test_no_space_while_a_shot_arrives_leaves_the_other_shots(
    session: sessions.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    add(session, "one", b"1")

    def fsync(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(SessionError, match="disk is full"):
        add(session, "two", b"2")
    monkeypatch.undo()
    assert [shot.name for shot in sessions.shots(session)] == ["one"]
    assert [path.name for path in (session.folder / "shots").iterdir()] == ["0000"]
