"""What a batch would do is read off the sessions on disk."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from app.batch.agenda import Standing, agenda, entry, find_sessions
from app.changes import Changes, check
from app.cli import main
from engine.errors import SessionError
from tests.app.sessions import small


@pytest.fixture(scope="module")
def merged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session whose exposures are merged and whose mask is cut."""
    session = small(tmp_path_factory.mktemp("agenda"))
    assert main(["process", str(session), "--until", "segment", "--device", "cpu"]) == 0
    return session


@pytest.fixture
def shelf(merged: Path, tmp_path: Path) -> Path:
    """Two sessions of one name, one that is damaged, one of the future, and folders beside them."""
    for place in ("2024/lion.session", "2025/lion.session", "vase.session", "bowl.session"):
        shutil.copytree(merged, tmp_path / "shelf" / place)
    (tmp_path / "shelf" / "vase.session" / "session.json").write_text("{")
    facts = tmp_path / "shelf" / "bowl.session" / "session.json"
    facts.write_text(json.dumps({**json.loads(facts.read_text()), "schema": 99}))
    shutil.copytree(merged, tmp_path / "shelf" / ".trash" / "lion.session")
    (tmp_path / "empty").mkdir()
    return tmp_path / "shelf"


def test_sessions_are_found_at_any_depth_and_once(shelf: Path) -> None:
    twice = [
        shelf,
        shelf / "2024",
        shelf / "2024" / "lion.session",
        shelf.parent / "empty",
        shelf / "nothing",
    ]
    found, complaints = find_sessions(twice)
    assert [str(folder.relative_to(shelf)) for folder in found] == [
        "2024/lion.session", "2025/lion.session", "bowl.session", "vase.session",
    ]  # fmt: skip
    assert [line.split(";")[0] for line in complaints] == [
        f"{shelf.parent / 'empty'}: holds no session", f"{shelf / 'nothing'}: is no folder",
    ]  # fmt: skip


def test_a_damaged_session_costs_one_line_and_the_rest_is_planned(shelf: Path) -> None:
    entries, complaints = agenda(find_sessions([shelf])[0], Changes(), None, 1)
    assert [e.name for e in entries] == [str(shelf / "2024/lion.session"), str(shelf / "2025/lion.session")]
    assert len(complaints) == 2
    assert "schema 99" in complaints[0]
    assert "vase.session/session.json: damaged" in complaints[1]


@pytest.mark.parametrize(
    ("changes", "until", "standing"),
    [
        ((), "segment", Standing.DONE),
        ((), None, Standing.UNFINISHED),
        (("hdr.dark_sigmas=3.0",), None, Standing.STALE),
    ],
)
def test_a_session_stands_as_its_plan_says(
    merged: Path, changes: tuple[str, ...], until: str | None, standing: Standing
) -> None:
    assert entry(merged, "a", Changes(assignments=changes), until).standing is standing


def test_a_session_without_results_is_new(merged: Path, tmp_path: Path) -> None:
    bare = Path(shutil.copytree(merged, tmp_path / "bare.session"))
    shutil.rmtree(bare / "stages")
    planned = entry(bare, "bare", Changes())
    assert planned.standing is Standing.NEW
    assert planned.reason == ""


def test_a_stage_that_ran_before_is_expected_to_take_what_it_took(merged: Path, tmp_path: Path) -> None:
    session = Path(shutil.copytree(merged, tmp_path / "a.session"))
    (path,) = (session / "stages" / "hdr").glob("*/record.json")
    known = {"seconds": 100.0, "cpu_seconds": 150.0, "peak_memory_bytes": 5_000_000_000}
    path.write_text(json.dumps({**json.loads(path.read_text()), **known}))
    changed = Changes(assignments=("hdr.dark_sigmas=3.0",))
    one, two = (entry(session, "a", changes=changed, cores=cores) for cores in (1, 2))
    assert (one.costs["hdr"].seconds, two.costs["hdr"].seconds) == (150.0, 100.0)
    assert one.cost.memory_bytes == 5_000_000_000
    assert one.cost.seconds == sum(cost.seconds for cost in one.costs.values())
    # What never ran is expected by the photographs' pixels: 8 views of 32 x 24.
    assert one.costs["poses"].seconds == pytest.approx(29.0 + 1.0 * 8 * 32 * 24 / 1e6)


def test_the_papers_solver_takes_nobody_knows_how_long(merged: Path) -> None:
    content = entry(merged, "a", Changes(solver="reference")).content()
    assert content["seconds"] is None
    json.dumps(content, allow_nan=False)


def test_a_wrong_setting_is_refused_before_sessions_are_looked_at() -> None:
    for wrong in (Changes(assignments=("hdr.dark=1",)), Changes(assignments=("nothing.at=1",))):
        with pytest.raises(SessionError):
            check(wrong)
    with pytest.raises(SessionError, match="no stage 'mesh'"):
        check(Changes(), "mesh")
    check(replace(Changes(), preset="draft"), "light")


def test_plan_prints_what_other_programs_read(merged: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(merged), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["schema"], told["standing"]) == (1, "unfinished")
    assert [stage["name"] for stage in told["stages"] if stage["done"]] == ["hdr", "segment"]
    assert told["stages"][2]["reasons"] == ["never ran"]


def test_the_table_says_what_would_run_why_and_at_what_cost(
    shelf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["batch", str(shelf), "--plan", "--workers", "2", "--memory", "8", "--set", "segment.margin_px=5"]
    assert main(words) == 2  # two sessions cannot be read
    told = capsys.readouterr()
    assert told.err.count("\n") == 2
    assert "segment will run because params.margin_px" in told.out.replace("\n", " ")
    assert "2 of 2 sessions would run on 2 worker(s) of 4.0 GB" in told.out
    assert main([*words, "--where", "done"]) == 2
    assert "0 of 0 sessions would run" in capsys.readouterr().out
