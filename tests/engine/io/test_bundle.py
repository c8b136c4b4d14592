"""A bundle is the session, byte for byte and the same each time; nothing lies outside the session, and damage is named."""

import json
import os
import time
import zipfile
from pathlib import Path

import pytest

from engine.errors import BusyError, SessionError
from engine.io import session as sessions
from engine.io.bundle import LIST, pack, unpack
from engine.progress import Cancelled, Progress


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    """Two photographs, an edit, a finished stage with a link to it, and what does not belong in a bundle."""
    made = sessions.create(tmp_path / "lion.session", "raw", {"model": "none"})
    for name in ("b", "a"):
        source = tmp_path / f"{name}.DNG"
        source.write_bytes(name.encode() * 3_000_000)
        sessions.add_shot(made, name, [source], [{"shutter_s": 0.5}])
    sessions.write_edit(made, "mask.png", b"white")
    sessions.write_params(made, {"preset": "draft"})
    stage = made.folder / "stages" / "export" / "f00d"
    stage.mkdir(parents=True)
    (stage / "maps.exr").write_bytes(b"maps")
    (made.folder / "exports").mkdir(exist_ok=True)
    (made.folder / "exports" / "latest").symlink_to("../stages/export/f00d")
    half = made.folder / "stages" / "export" / "beef.partial"
    half.mkdir()
    (half / "maps.exr").write_bytes(b"half")
    (made.folder / "derived").mkdir()
    (made.folder / "derived" / "thumbnail.png").write_bytes(b"again")
    return made


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_is_unpacked_is_what_was_packed(session: sessions.Session, tmp_path: Path) -> None:
    count = pack(session, tmp_path / "lion.zip", True, Progress())
    back = unpack(tmp_path / "lion.zip", tmp_path / "far" / "away.session", Progress())
    before, after = contents(session.folder), contents(back.folder)
    left_out = {"run.lock", "derived/thumbnail.png", "stages/export/beef.partial/maps.exr"}
    assert after == {name: content for name, content in before.items() if name not in left_out}
    assert count == len([name for name in after if not name.startswith("exports/latest/")])
    assert os.readlink(back.folder / "exports" / "latest") == "../stages/export/f00d"
    for shot in sessions.shots(back):
        sessions.verify(shot)
    assert not list((tmp_path / "far").glob(".*"))


def test_the_same_session_gives_the_same_bytes_whenever_it_is_packed(
    session: sessions.Session, tmp_path: Path
) -> None:
    pack(session, tmp_path / "first.zip", True, Progress())
    later = time.time() + 5000
    os.utime(session.folder / "session.json", (later, later))
    pack(session, tmp_path / "second.zip", True, Progress())
    assert (tmp_path / "first.zip").read_bytes() == (tmp_path / "second.zip").read_bytes()


def test_without_raw_the_shots_are_known_and_not_there(session: sessions.Session, tmp_path: Path) -> None:
    pack(session, tmp_path / "light.zip", False, Progress())
    assert (tmp_path / "light.zip").stat().st_size < 10_000
    back = unpack(tmp_path / "light.zip", tmp_path / "back.session", Progress())
    shots = sessions.shots(back)
    assert [shot.fingerprint for shot in shots] == [s.fingerprint for s in sessions.shots(session)]
    with pytest.raises(SessionError, match="packed without its photographs"):
        sessions.verify(shots[0])
    again = tmp_path / "again.zip"
    pack(back, again, True, Progress())
    assert sessions.shots(unpack(again, tmp_path / "again.session", Progress()))[0].name == shots[0].name


def test_what_is_there_is_not_written_over(session: sessions.Session, tmp_path: Path) -> None:
    (tmp_path / "lion.zip").write_bytes(b"mine")
    with pytest.raises(SessionError, match="exists already"):
        pack(session, tmp_path / "lion.zip", True, Progress())
    assert (tmp_path / "lion.zip").read_bytes() == b"mine"
    with pytest.raises(SessionError, match="exists already"):
        unpack(tmp_path / "lion.zip", session.folder, Progress())


def test_a_session_at_work_is_left_to_who_has_it(session: sessions.Session, tmp_path: Path) -> None:
    with sessions.lock(session), pytest.raises(BusyError):
        pack(session, tmp_path / "lion.zip", True, Progress())
    assert not (tmp_path / "lion.zip").exists()


def test_a_link_out_of_the_session_is_refused(session: sessions.Session, tmp_path: Path) -> None:
    (session.folder / "exports" / "secrets").symlink_to("/etc")
    with pytest.raises(SessionError, match="leads out of the session"):
        pack(session, tmp_path / "lion.zip", True, Progress())


def test_a_stop_leaves_nothing_behind(session: sessions.Session, tmp_path: Path) -> None:
    pack(session, tmp_path / "lion.zip", True, Progress())
    for work in (
        lambda stopped: pack(session, tmp_path / "other.zip", True, stopped),
        lambda stopped: unpack(tmp_path / "lion.zip", tmp_path / "back.session", stopped),
    ):
        before = set(tmp_path.iterdir())
        with pytest.raises(Cancelled):
            work(Progress(cancelled=lambda: True))
        assert set(tmp_path.iterdir()) == before


def rewritten(bundle: Path, **changes: object) -> Path:
    """The bundle with other bytes of some files: None takes one away, new names are added, `LIST` is a dict merged into the list."""
    made = bundle.with_name("made.zip")
    with zipfile.ZipFile(bundle) as old, zipfile.ZipFile(made, "w") as new:
        entries = {name: old.read(name) for name in old.namelist()}
        for name, content in changes.items():
            if name == LIST and isinstance(content, dict):
                listed = json.loads(entries[LIST])
                for key, value in content.items():
                    listed[key] = listed[key] | value if isinstance(value, dict) else value
                content = json.dumps(listed).encode()
            entries[name] = content  # type: ignore[assignment]
        for name, content in entries.items():
            if content is not None:
                new.writestr(name, content)
    return made


EMPTY = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"edits/mask.png": b"black"}, "edits/mask.png is damaged"),
        ({"edits/mask.png": None}, "does not hold what its bundle.json says"),
        ({"edits/more.png": b""}, "does not hold what its bundle.json says"),
        ({LIST: None}, "holds no bundle.json"),
        ({LIST: b"[]"}, "its bundle.json is damaged"),
        ({LIST: {"schema": 2}}, "has schema 2, this roomlight reads up to 1"),
        ({"../evil": b"", LIST: {"files": {"../evil": EMPTY}}}, "would lie outside the session"),
        ({"/evil": b"", LIST: {"files": {"/evil": EMPTY}}}, "would lie outside the session"),
        ({"shots/../../evil": b"", LIST: {"files": {"shots/../../evil": EMPTY}}}, "would lie outside"),
        ({"evil.sh": b"", LIST: {"files": {"evil.sh": EMPTY}}}, "would lie outside the session"),
        ({LIST: {"links": {"exports/latest": "../../etc"}}}, "would lie outside the session"),
        ({LIST: {"links": {"exports/latest": "/etc"}}}, "would lie outside the session"),
        ({LIST: {"links": {"shots/0000": "../edits", "edits": "shots"}}}, "exists"),
    ],
)
def test_a_bundle_that_is_not_as_it_says_is_refused_and_leaves_nothing(
    session: sessions.Session, tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    pack(session, tmp_path / "lion.zip", True, Progress())
    made = rewritten(tmp_path / "lion.zip", **changes)
    before = set(tmp_path.iterdir())
    with pytest.raises(SessionError, match=words):
        unpack(made, tmp_path / "back.session", Progress())
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.999])
def test_half_a_file_is_no_bundle(session: sessions.Session, tmp_path: Path, kept: float) -> None:
    pack(session, tmp_path / "lion.zip", True, Progress())
    whole = (tmp_path / "lion.zip").read_bytes()
    (tmp_path / "half.zip").write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(SessionError, match="no ZIP file, or damaged"):
        unpack(tmp_path / "half.zip", tmp_path / "back.session", Progress())


def test_a_file_that_is_not_there_or_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="no such file"):
        unpack(tmp_path / "none.zip", tmp_path / "back.session", Progress())
    with pytest.raises(SessionError, match="is a folder"):
        unpack(tmp_path, tmp_path / "back.session", Progress())
