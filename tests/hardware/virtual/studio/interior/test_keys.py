"""A room's key is remembered by what is in its files: nothing is loaded twice, and nothing that changed is taken for the old."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from hardware.errors import StudioError
from hardware.virtual.studio.interior import keys, read
from tests.hardware.virtual.studio.interior import scenes

INNER = (
    '<default name="where" value="meshes"/><include filename="more.xml"/>'
    '<shape type="obj"><string name="filename" value="$where/a.obj"/></shape>'
)
MORE = '<shape type="cube"><bsdf type="diffuse"><texture type="bitmap"><string name="filename" value="b.png"/></texture></bsdf></shape>'


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """What was loaded; a room's key is the number of loads before it."""
    loaded: list[Path] = []

    def load(path: Path) -> SimpleNamespace:
        if not path.is_file():
            raise StudioError(f"{path}: there is no such scene file")
        loaded.append(path)
        return SimpleNamespace(key=f"{len(loaded):016x}")

    monkeypatch.setattr(read, "read", load)
    return loaded


def room(folder: Path) -> Path:
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "a.obj").write_text("v 0 0 0")
    (folder / "b.png").write_bytes(b"texture")
    scenes.scene(folder / "more.xml", MORE)
    return scenes.scene(folder / "scene.xml", INNER)


def test_an_unchanged_room_is_loaded_once_wherever_it_lies(loads: list[Path], tmp_path: Path) -> None:
    here, moved = room(tmp_path / "here"), room(tmp_path / "moved")
    found = {keys.of(each, tmp_path / "cache") for each in (here, moved, here)}
    assert len(found) == len(loads) == 1


@pytest.mark.parametrize("file", ["scene.xml", "more.xml", "meshes/a.obj", "b.png"])
def test_a_change_in_any_file_that_it_leads_to_loads_it_again(
    loads: list[Path], tmp_path: Path, file: str
) -> None:
    path = room(tmp_path / "room")
    before = keys.of(path, tmp_path / "cache")
    changed = path.parent / file
    kept = changed.read_bytes()
    changed.write_bytes(
        kept.replace(b"0 0 0", b"0 0 1").replace(b"cube", b"ball").replace(b"more", b"./more") + b" "
    )
    assert keys.of(path, tmp_path / "cache") != before
    changed.write_bytes(kept)
    assert keys.of(path, tmp_path / "cache") == before
    changed.unlink()
    assert keys.digest(path) is None or keys.digest(path) != before
    assert len(loads) == 2


def test_what_cannot_be_kept_or_was_damaged_is_loaded(loads: list[Path], tmp_path: Path) -> None:
    path, cache = room(tmp_path / "room"), tmp_path / "cache"
    keys.of(path, cache)
    (kept,) = cache.iterdir()
    kept.write_text("nonsense")
    assert keys.of(path, cache) == f"{2:016x}"
    (tmp_path / "file").write_text("")
    assert keys.of(path, tmp_path / "file" / "cache") == f"{3:016x}"
    with pytest.raises(StudioError, match="no such scene file"):
        keys.of(tmp_path / "gone.xml", cache)


def test_another_text_of_ours_or_release_of_mitsuba_loads_it_again(
    loads: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = room(tmp_path / "room")
    keys.of(path, tmp_path / "cache")
    monkeypatch.setattr(keys, "version", lambda name: "99")
    keys.of(path, tmp_path / "cache")
    monkeypatch.setattr(keys, "READERS", keys.READERS[1:])
    keys.of(path, tmp_path / "cache")
    assert len(loads) == 3
