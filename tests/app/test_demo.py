"""The demo's finished results ship, are laid out with the photographs they are of, and say so where a method is newer."""

import os
from pathlib import Path

import pytest

from app import demo, results
from app.inspect import maps, runs
from app.work import stage_picture, tasks
from app.work.worker import Link
from engine.errors import SessionError


def lay_out(folder: Path) -> dict:
    with open(os.devnull, "wb") as out:
        return dict(tasks.demo({"session": str(folder)}, Link(out.fileno())))


@pytest.fixture(scope="module")
def laid_out(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("demo") / "demo"
    return folder, lay_out(folder)


def test_shipped_results_are_up_to_date_or_of_an_older_method(laid_out: tuple[Path, dict]) -> None:
    folder, left = laid_out
    hdr, *solved, export = results.steps_of(folder)
    assert (hdr.reasons, export.reasons) == (("never ran",), ("never ran",))
    newer = [step for step in solved if not step.done]
    assert left["until"] == ("hdr" if newer else None)
    # Pack them anew, as app/demo.py says, where anything but a version differs.
    for reason in (reason for step in newer for reason in step.reasons):
        assert reason.startswith("the stage's method is new") or reason.startswith("input "), reason
    assert not newer or newer[0].reasons[0].startswith("the stage's method is new")


def test_maps_show_at_once_without_frames(laid_out: tuple[Path, dict]) -> None:
    folder, _ = laid_out
    run = runs.current(runs.runs_of(folder))
    assert run is not None
    shown = maps.load(run)
    assert shown.frames is None
    assert shown.surface.mask.sum() > 10_000


def test_what_finished_stages_made_is_pictured(
    laid_out: tuple[Path, dict], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder, _ = laid_out
    assert stage_picture.show({"session": str(folder), "stage": "hdr"}) == {"picture": None, "facts": {}}
    done = [
        step.stage.name for step in results.steps_of(folder) if step.done and step.stage.name != "segment"
    ]
    for stage in done:
        answer = stage_picture.show({"session": str(folder), "stage": stage})
        assert Path(answer["picture"]).stat().st_size > 1000, stage
        assert answer["facts"], stage


def test_a_copy_of_the_persons_is_never_laid_over(laid_out: tuple[Path, dict]) -> None:
    with pytest.raises(SessionError, match="holds something else"):
        lay_out(laid_out[0])


def test_only_a_finished_session_is_packed(tmp_path: Path) -> None:
    (tmp_path / "results.zip").write_bytes(b"of before")
    with pytest.raises(SessionError, match=r"has no params\.toml; run `roomlight demo`"):
        demo.pack(tmp_path / "nothing", tmp_path / "results.zip")
    assert (tmp_path / "results.zip").read_bytes() == b"of before"
