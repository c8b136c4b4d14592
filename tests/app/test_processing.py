"""The page's model: the newest edit wins, the run's stages show as cards, and jobs of anybody are followed."""

import datetime
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from app import plan as plans
from app import processing
from app.plan import read_plan
from app.processing import CardState, Processing, column, left_s
from app.work.jobs import Job, JobState, JobStatus
from app.work.queue import Board
from tests.app.plans import Questions, content
from tests.app.work.children import WILLING, job

SESSION = Path("/s/lion.session")
NOON = datetime.datetime(2024, 6, 1, 12, 0, 0)
LONG_S = 30


class Made:
    """A model whose children are stand-ins; what arrives is run by `pump`, as the window's event loop would."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, script: str = WILLING, done: int = 0, at_once: bool = True
    ) -> None:
        self.questions, self.board = Questions(done, at_once), Board()
        self._calls: list[Callable[[], None]] = []
        self._arrived = threading.Condition()

        def make(name: str, task: str, request: Mapping[str, Any]) -> Job:
            return job(script, name, task, request)

        monkeypatch.setattr(processing, "Job", make)
        self.model = Processing(self.questions, self.board, self._queued, lambda: NOON)  # type: ignore[arg-type]

    def _queued(self, call: Callable[..., None]) -> Callable[..., None]:
        def send(*args: Any) -> None:
            with self._arrived:
                self._calls.append(lambda: call(*args))
                self._arrived.notify_all()

        return send

    def pump(self, what: Callable[[], bool] = lambda: True) -> None:
        """Run what arrived until `what` is true."""
        while True:
            with self._arrived:
                calls, self._calls = self._calls, []
            for call in calls:
                call()
            if what():
                return
            with self._arrived:
                assert self._calls or self._arrived.wait(LONG_S), "nothing arrived"

    def state(self) -> JobState | None:
        return self.model.job.value.state if self.model.job.value is not None else None


def test_opening_a_session_plans_it(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made(monkeypatch, done=2)
    made.model.open(SESSION)
    assert made.model.plan.value is None
    made.pump()
    assert [card.state for card in made.model.cards] == [CardState.DONE] * 2 + [CardState.STALE] * 4
    assert made.questions.asked == [
        {"question": "plan", "session": str(SESSION), "settings": None, "keep": False}
    ]
    made.model.open(None)
    assert made.model.cards == ()


def test_an_edit_is_kept_and_only_the_newest_answer_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made(monkeypatch, at_once=False)
    made.model.open(SESSION)
    made.questions.answer()
    made.pump()
    for value in (512, 1024):
        directions = made.model.plan.value.parameter("surface.directions")  # type: ignore[union-attr]
        made.model.edit(plans.with_value(made.model.settings, directions, value))  # type: ignore[arg-type]
    assert [asked["keep"] for asked in made.questions.asked] == [False, True, True]
    assert made.questions.asked[-1]["settings"]["surface"] == {"directions": 1024}
    made.questions.answer(place=1)
    made.questions.answer(place=0)  # the older one, late
    made.pump()
    assert made.model.plan.value.parameter("surface.directions").value == 1024  # type: ignore[union-attr]
    assert made.model.settings.overrides == {"surface": {"directions": 1024}}  # type: ignore[union-attr]


def test_an_answer_for_a_session_that_was_left_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made(monkeypatch, at_once=False)
    made.model.open(SESSION)
    made.model.open(Path("/s/bear.session"))
    made.questions.answer()
    made.pump()
    assert made.model.plan.value is None


def test_a_session_that_cannot_be_planned_says_why_and_an_answer_clears_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = Made(monkeypatch, at_once=False)
    made.model.open(SESSION)
    made.questions.fail("params.toml: not valid TOML; correct or remove it")
    made.pump()
    assert made.model.trouble.value.remedy == "correct or remove it"  # type: ignore[union-attr]
    made.model.refresh()
    made.questions.answer()
    made.pump()
    assert made.model.trouble.value is None


def test_a_run_goes_through_the_queue_once_and_can_be_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made(monkeypatch)
    made.model.open(SESSION)
    run = made.model.process("cpu", "light")
    assert run is not None
    assert run.request == {"session": str(SESSION), "device": "cpu", "until": "light"}
    assert made.model.process("cpu") is None
    assert made.model.busy(SESSION)
    made.pump(lambda: made.model.job.value is not None and made.model.job.value.stage == "hdr")
    assert made.model.cards[0].state is CardState.RUNNING
    before = len(made.questions.asked)
    made.model.cancel()
    made.pump(lambda: made.state() is JobState.CANCELLED)
    assert len(made.questions.asked) > before  # planned anew
    assert not made.model.busy(SESSION)
    assert made.model.log[-1] == "12:00:00  cancelled"


def test_the_end_of_a_stage_plans_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    script = (
        'emit("stage", name="hdr", number=1, count=2); emit("stage_done", name="hdr", seconds=1);'
        'emit("log", text="hdr: done in 1.0 s"); emit("stage", name="segment", number=2, count=2); hear()\nemit("cancelled")'
    )
    made = Made(monkeypatch, script)
    made.model.open(SESSION)
    made.pump()
    asked = len(made.questions.asked)
    made.model.process("cpu")
    made.pump(lambda: made.model.job.value is not None and made.model.job.value.stage == "segment")
    assert len(made.questions.asked) > asked
    assert "12:00:00  hdr: done in 1.0 s" in made.model.log
    made.model.cancel()
    made.pump(lambda: made.state() is JobState.CANCELLED)


def test_what_libraries_print_stays_out_of_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made(
        monkeypatch, 'sys.stderr.write("I2024 COLMAP\\n"); emit("failed", message="too dark; expose longer")'
    )
    made.model.open(SESSION)
    made.model.process("cpu")
    made.pump(lambda: made.state() is JobState.FAILED)
    assert made.model.log == ("12:00:00  failed: too dark; expose longer",)


def test_a_run_somebody_else_queued_is_followed_and_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made(monkeypatch)
    other = job(WILLING, request={"session": str(SESSION)})
    made.board.enqueue(other)
    made.pump()
    made.model.open(SESSION)
    made.pump(lambda: made.model.job.value is not None and made.model.job.value.stage == "hdr")
    made.model.open(Path("/s/bear.session"))
    assert made.model.job.value is None
    made.model.open(SESSION)
    assert made.state() is JobState.RUNNING
    made.model.cancel()
    made.pump(lambda: made.state() is JobState.CANCELLED)


def status(state: JobState, stage: str = "poses", fraction: float = 0.4, **facts: Any) -> JobStatus:
    return JobStatus("lion", state, stage, fraction=fraction, **facts)


@pytest.mark.parametrize(
    ("now", "shown"),
    [
        (None, CardState.STALE),
        (status(JobState.QUEUED), CardState.STALE),
        (status(JobState.RUNNING), CardState.RUNNING),
        (status(JobState.RUNNING, fraction=1.0), CardState.DONE),
        (status(JobState.CANCELLING), CardState.CANCELLING),
        (status(JobState.CANCELLED), CardState.STALE),
        (status(JobState.FAILED, message="too dark"), CardState.FAILED),
        (status(JobState.RUNNING, stage="light"), CardState.STALE),
    ],
)
def test_a_card_shows_what_its_stage_is_doing(now: JobStatus | None, shown: CardState) -> None:
    plan = read_plan(content(done=2))
    assert column(plan, now)[2].state is shown
    assert column(plan, now)[1].state is CardState.DONE


def test_the_time_left_adds_what_later_stages_took_last_time() -> None:
    plan = read_plan(content({"hdr": {"long_edge_px": 64}}, done=6))
    cards = list(column(plan, status(JobState.RUNNING, stage="hdr", eta_s=5.0)))
    assert left_s(cards) == 5.0
    stale = read_plan(content({"hdr": {"long_edge_px": 64}, "surface": {"directions": 64}}, done=6))
    assert left_s(column(stale, status(JobState.RUNNING, stage="hdr", eta_s=5.0))) == 15.0
    assert left_s(column(stale, status(JobState.RUNNING, stage="hdr", eta_s=None))) is None
    never = read_plan(content(done=2))
    assert left_s(column(never, status(JobState.RUNNING, stage="poses", eta_s=5.0))) is None
