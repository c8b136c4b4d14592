"""`--preset auto` takes the least preset that pays, within its budget."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from app import commands, results
from app.auto import Goal, Rung, climb, gained, goal_of, halving
from app.changes import Changes, open_changed
from app.cli import main
from app.costs import cost_of
from app.results import steps_of
from engine.errors import SessionError
from engine.pipeline import artifacts
from engine.pipeline.settings import resolve
from tests.app import sessions
from tests.app.calls import refused

PRESETS = ("draft", "standard", "fine")
SECONDS = {"draft": 10.0, "standard": 30.0, "fine": 90.0}
STDERR = {"draft": 2.0, "standard": 1.0, "fine": 0.9}
VIEWS = np.array([0.9, 1.0, 1.1, 1.0])
ERROR = {"draft": 0.08 * VIEWS, "standard": 0.05 * VIEWS, "fine": 0.05 * VIEWS[::-1]}


def climbed(goal: Goal) -> tuple[str, list[str], float]:
    """The preset that stays, what was said, and the seconds that it took."""
    clock, said = [0.0], []

    def reach(preset: str) -> Rung:
        clock[0] += SECONDS[preset]
        return Rung(preset, SECONDS[preset], STDERR[preset], ERROR[preset])

    rung = climb(PRESETS, goal, reach, SECONDS.__getitem__, said.append, lambda: clock[0])
    return rung.preset, said, clock[0]


@pytest.mark.parametrize(
    ("goal", "stays", "took", "words"),
    [
        (Goal(), "standard", 130.0, "no more than its standard error"),
        (Goal(budget_s=35), "standard", 30.0, "5 s of the budget are left"),
        (Goal(budget_s=95), "fine", 90.0, "fine: surface in 90 s"),
        (Goal(budget_s=35, error_deg=0.5), "draft", 10.0, "25 s of the budget are left"),
        (Goal(budget_s=45, error_deg=0.5), "standard", 40.0, "5 s of the budget are left"),
        (Goal(budget_s=1), "draft", 10.0, "0 s of the budget are left"),
        (Goal(error_deg=2.0), "draft", 10.0, "2 deg, is reached"),
        (Goal(error_deg=1.5), "standard", 40.0, "1.5 deg, is reached"),
    ],
)
def test_the_least_preset_that_pays_stays(goal: Goal, stays: str, took: float, words: str):
    preset, said, seconds = climbed(goal)
    assert (preset, seconds) == (stays, took)
    assert words in said[-1]


def test_a_gain_of_fewer_than_two_views_pays_nothing():
    assert gained(np.array([0.2]), np.array([0.1])) == (0.0, math.inf)
    gain, stderr = gained(np.array([0.2, 0.3]), np.array([0.1, 0.1]))
    assert (gain, stderr) == pytest.approx((0.15, 0.05))


def test_the_time_that_would_halve_the_error_follows_two_rungs():
    low, high = (Rung(name, SECONDS[name], STDERR[name], ERROR[name]) for name in ("draft", "standard"))
    assert halving(low, high) == "about 90 s of stage surface would halve the error"
    assert halving(low, Rung("fine", 30.0, 1.99, VIEWS)).startswith("more time would not halve the error")


@pytest.mark.parametrize(
    ("budget", "until", "goal"),
    [(None, None, Goal()), ("90s", None, Goal(90)), ("2min", "0.5deg", Goal(120, 0.5)), ("1.5h", "2", Goal(5400, 2))],
)  # fmt: skip
def test_goals_are_read_as_they_are_written(budget: str | None, until: str | None, goal: Goal):
    assert goal_of(budget, until) == goal


@pytest.mark.parametrize(
    ("budget", "until", "words"),
    [
        ("soon", None, "write it as 90s"),
        ("-3s", None, "write it as 90s"),
        (None, "surface", "write it as 0.5deg"),
        (None, "nan", "0.5deg"),
        (None, "-1deg", "0.5deg"),
    ],
)
def test_what_is_no_goal_is_refused(budget: str | None, until: str | None, words: str):
    with pytest.raises(SessionError, match=words):
        goal_of(budget, until)


def test_the_command_climbs_and_leaves_the_session_at_what_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    session, ran = sessions.small(tmp_path), []

    def run(folder: Path, changes: Changes, until: str | None, device: str) -> tuple:
        ran.append((changes.preset, until))
        return ()

    def rung(folder: Path, preset: str) -> Rung:
        return Rung(preset, SECONDS[preset], STDERR[preset], ERROR[preset])

    monkeypatch.setattr(commands, "run_stages", run)
    monkeypatch.setattr(results, "rung", rung)
    assert main(["process", str(session), "--preset", "auto", "--set", "surface.views=9"]) == 0
    assert ran == [("draft", "surface"), ("standard", "surface"), ("fine", "surface"), ("standard", None)]
    said = capsys.readouterr().out
    assert re.match(r"auto: draft in about \d+ s, standard in about \d+ s, fine in about \d+ s\n", said)
    assert "standard stays: fine renders" in said
    assert "write it as 90s" in refused(capsys, "process", session, "--preset", "auto", "--budget", "soon")
    refusal = "leave out --preset draft"
    assert refusal in refused(capsys, "process", session, "--preset", "draft", "--budget", "90s")
    assert refusal in refused(capsys, "process", session, "--preset", "draft", "--until", "0.5deg")
    assert "0.5deg" in refused(capsys, "process", session, "--budget", "90s", "--until", "light")
    ran.clear()
    assert main(["process", str(session), "--until", "1.5"]) == 0
    assert ran == [("draft", "surface"), ("standard", "surface"), ("standard", None)]
    ran.clear()
    assert main(["process", str(session), "--budget", "9h"]) == 0
    assert ran == [("fine", "surface"), ("fine", None)]


def test_only_presets_of_our_solver_are_climbed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    session = sessions.small(tmp_path)
    said = refused(capsys, "process", session, "--preset", "auto", "--solver", "reference")
    assert "add --solver transport" in said


def test_a_preset_that_has_not_run_is_told_the_time_of_one_that_has(tmp_path: Path):
    """A draft of 10 s in the records foretells 17 s of standard."""
    (step,) = [one for one in steps_of(sessions.small(tmp_path)) if one.stage.name == "surface"]
    made = step.folder.with_name("drafted")
    made.mkdir(parents=True)
    drafted = resolve("surface", step.stage.defaults, step.stage.presets["draft"], {})
    record = {
        "version": step.stage.version, "finished": 1.0, "seconds": 10.0, "cpu_seconds": 10.0, "peak_memory_bytes": 7,
        "params": artifacts.plain(drafted),
    }  # fmt: skip
    (made / "record.json").write_text(json.dumps(record))
    opened = open_changed(tmp_path / "a.session", Changes()).session
    assert [cost_of(opened, step, 1.0, preset, 1).seconds for preset in PRESETS] == pytest.approx(
        [10, 10 / 0.6, 30 / 0.6]
    )
