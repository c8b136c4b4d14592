"""The import dialog proposes a free name and poses that lie where they usually do."""

from pathlib import Path

from app.importing import Request, proposed, suggest_poses


def test_the_proposed_session_is_never_one_that_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "lion"
    assert proposed(folder) == tmp_path / "lion.session"
    (tmp_path / "lion.session").mkdir()
    (tmp_path / "lion-2.session").mkdir()
    assert proposed(folder) == tmp_path / "lion-3.session"
    assert proposed(folder / "Images") == folder / "lion.session"
    assert proposed(Path("/raw")) == Path("/raw.session")


def test_poses_are_found_under_their_usual_names(tmp_path: Path) -> None:
    folder = tmp_path / "scan" / "images"
    (folder.parent / "sparse" / "0").mkdir(parents=True)
    folder.mkdir()
    assert suggest_poses(folder) is None
    (folder.parent / "sparse" / "0" / "cameras.bin").write_text("")
    assert suggest_poses(folder) == folder.parent / "sparse" / "0"
    (folder / "transforms.json").write_text("")
    assert suggest_poses(folder) == folder / "transforms.json"
    assert suggest_poses(tmp_path / "gone") is None


def test_a_request_is_plain_values_with_the_home_folder_written_out() -> None:
    content = Request(Path("~/a"), Path("/b"), None, Path("/m.png"), 3).content()
    assert content == {
        "folder": str(Path.home() / "a"), "session": "/b", "poses": None, "mask": "/m.png", "bracket": 3,
    }  # fmt: skip
