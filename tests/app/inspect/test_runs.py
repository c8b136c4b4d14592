"""The finished runs of a session are found, newest first, and told apart."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from app.inspect import runs
from engine.pipeline import stage_table
from engine.pipeline.artifacts import plain
from tests.app import furnace


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """Two runs; the older one is what the export shows."""
    furnace.finished(tmp_path, "newer", 2e9, with_export=False)
    return furnace.finished(tmp_path, "older", 1e9)


def test_newest_comes_first_and_the_exported_one_is_current(session: Path) -> None:
    found = runs.runs_of(session)
    assert [run.fingerprint for run in found] == ["newer", "older"]
    assert [run.current for run in found] == [False, True]
    assert runs.current(found) is found[1]


def test_without_an_export_the_newest_is_current(session: Path) -> None:
    (session / "exports" / "latest").unlink()
    assert [run.current for run in runs.runs_of(session)] == [True, False]


def test_a_run_knows_its_stages_and_what_they_took(session: Path) -> None:
    run = runs.runs_of(session)[1]
    assert run.seconds == pytest.approx(2 + 1 + 3 + 4 + 10)  # the export is left out
    assert run.folder("light") == session / "stages" / "light" / "llll"
    assert run.folder("export") == session / "stages" / "export" / "eolder"
    assert run.reported("surface")["held_out_error"] == 0.1
    assert run.reported("segment") == {}


def test_unfinished_and_damaged_results_are_no_runs(session: Path) -> None:
    surface = session / "stages" / "surface"
    (surface / "newer" / "record.json").write_text("{")
    (surface / "older").rename(surface / "older.partial")
    assert runs.runs_of(session) == ()
    assert runs.runs_of(session / "nowhere") == ()


def asked(session: Path, run: str, **facts: object) -> None:
    path = session / "stages" / "surface" / run / "record.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, **facts}))


def test_runs_are_named_by_their_preset_and_what_was_set_besides(session: Path) -> None:
    surface = next(stage for stage in stage_table.stages() if stage.name == "surface")
    draft = plain(replace(surface.defaults, **surface.presets["draft"]))
    asked(session, "newer", params=draft)
    asked(session, "older", params={**plain(surface.defaults), "directions": 700}, version=2)
    newer, older = runs.runs_of(session)
    names = [name.split(" · ") for name in runs.names((newer, older))]
    assert [name[0].split(",")[0] for name in names] == ["draft", "standard"]
    assert [name[1:] for name in names] == [[], ["directions of light 700"]]
    assert runs.changes(newer, older) == (
        "preset draft -> standard",
        "surface.directions 512 -> 700",
        "surface: method of version 1 -> 2",
    )
    assert runs.changes(newer, newer) == ()
    asked(session, "newer", params={"samples": 8, "iterations": 3})
    assert runs.names(runs.runs_of(session))[0].startswith("paper's solver, ")


def test_a_run_goes_by_the_name_it_was_given_until_that_is_taken_away(tmp_path: Path) -> None:
    session = furnace.finished(tmp_path)
    (run,) = runs.runs_of(session)
    before = runs.names([run])
    runs.rename(run, "  without the\n window ")
    (named,) = runs.runs_of(session)
    assert runs.names([named]) == ("without the window",)
    assert named.fingerprint == run.fingerprint
    runs.rename(named, " ")
    assert runs.names(runs.runs_of(session)) == before
