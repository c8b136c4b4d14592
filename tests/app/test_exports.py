"""The export page offers every file of an export, each with its frame and units, and asks for what was chosen."""

import json
from pathlib import Path

import pytest

from app import exports
from engine.errors import ExportError
from tests.engine.results.test_export import write as write_export


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    to = tmp_path_factory.mktemp("export") / "out"
    write_export(to)
    return to


def test_every_file_of_an_export_belongs_to_one_format(exported: Path) -> None:
    found = exports.read(exported)
    files = [name for offer in found.offers for name in offer.files]
    assert sorted(files) == sorted(json.loads((exported / "export.json").read_text())["files"])
    # Its ball is all of paint: nothing is said of materials.
    assert [offer.format for offer in found.offers] == [
        one for one in exports.FORMATS if one.key != "materials"
    ]
    assert (found.length, found.green) == ("metre", "up")


def test_every_format_states_frame_and_units() -> None:
    for entry in exports.FORMATS:
        assert entry.frame, entry.key
        assert entry.unit, entry.key
        assert entry.content, entry.key


def test_every_target_reads_formats_that_there_are(exported: Path) -> None:
    keys = {entry.key for entry in exports.FORMATS}
    for target in exports.TARGETS.values():
        assert set(target.formats) <= keys
        assert target.green in exports.GREEN
    assert exports.files_for(exported, "all") is None
    assert exports.files_for(exported, "web") == ["surface.glb"]


def test_choosing_all_asks_for_all_and_choosing_some_names_them(exported: Path, tmp_path: Path) -> None:
    found = exports.read(exported)
    everything = {entry.key for entry in exports.FORMATS}
    request = exports.request(Path("/s"), tmp_path, found, everything, "down")
    assert request == {"session": "/s", "to": str(tmp_path), "green": "down", "files": None}
    assert exports.chosen(found, {"glb", "normals"}) == ["normal.png", "normal_16.png", "surface.glb"]


@pytest.mark.parametrize(
    "content", [None, "[]", "{}", '{"files": ["maps.exr"], "unit_of_length": "m", "png": {}}']
)
def test_what_is_no_export_is_told(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "export.json").write_text(content)
    with pytest.raises(ExportError, match="process the session again"):
        exports.read(tmp_path)


@pytest.mark.parametrize(
    ("count", "told"),
    [(640, "640 B"), (1000, "1 kB"), (643_000, "643 kB"), (1.26e9, "1.3 GB"), (5.4e12, "5400 GB")],
)
def test_sizes_are_told_in_three_digits_at_most(count: float, told: str) -> None:
    assert exports.told_bytes(count) == told
