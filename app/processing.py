"""What the Process page knows, without Qt: one session's plan, its stages as cards, its job and its log.

Everything here happens in the window's thread; `queued` (app/views/bridge.py) brings answers and statuses there.
The session's params.toml is written with each edit, so the session on disk is the state.
"""

import datetime
import enum
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.plan import Plan, read_plan
from app.state import Trouble, Watched, called
from app.work.enquiries import Answer, Enquiries
from app.work.jobs import Event, Job, JobState, JobStatus
from app.work.queue import Board
from engine.pipeline import settings as asked
from engine.pipeline.settings import Settings

LOG_LINES = 2000
Queued = Callable[[Callable[..., None]], Callable[..., None]]


class CardState(enum.Enum):
    """What the column shows of a stage."""

    DONE = "done"
    STALE = "will run"
    RUNNING = "running"
    CANCELLING = "stopping"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Card:
    """One stage in the column."""

    name: str
    state: CardState
    given: bool
    reasons: tuple[str, ...]  # why it will run; "never ran" alone where it never did
    fraction: float
    note: str
    eta_s: float | None
    took_s: float | None
    message: str  # of its failure


def column(plan: Plan, job: JobStatus | None) -> tuple[Card, ...]:
    """The plan with what the session's job is doing laid over it."""
    cards = []
    for row in plan.rows:
        card = Card(
            row.name, CardState.DONE if row.done else CardState.STALE, row.given, row.reasons, 0.0, "", None,
            row.took_s, "",
        )  # fmt: skip
        if job is not None and job.stage == row.name and not row.done:
            if job.active and job.fraction < 1:
                state = CardState.RUNNING if job.state is JobState.RUNNING else CardState.CANCELLING
                card = replace(card, state=state, fraction=job.fraction, note=job.note, eta_s=job.eta_s)
            elif job.active:
                card = replace(card, state=CardState.DONE)  # the plan will say so in a moment
            elif job.state is JobState.FAILED:
                card = replace(card, state=CardState.FAILED, message=job.message)
        cards.append(card)
    return tuple(cards)


def left_s(cards: Sequence[Card]) -> float | None:
    """Until the run's end: the running stage's own estimate, and for those behind it what they took last time."""
    total = 0.0
    for card in cards:
        if card.state in (CardState.RUNNING, CardState.CANCELLING):
            share = card.eta_s
        elif card.state is CardState.STALE:
            share = card.took_s
        else:
            continue
        if share is None:
            return None
        total += share
    return total


@dataclass(frozen=True, slots=True)
class Preview:
    """What a stage has so far, as a picture that is written anew each time."""

    stage: str
    file: Path
    number: int  # from 1


class Processing:
    """One session after the other."""

    def __init__(
        self,
        enquiries: Enquiries,
        board: Board,
        queued: Queued,
        now: Callable[[], datetime.datetime] = datetime.datetime.now,
    ) -> None:
        self._enquiries, self._board, self._queued, self._now = enquiries, board, queued, now
        self.folder: Path | None = None
        self.plan: Watched[Plan | None] = Watched(None)
        self.answered: Watched[int] = Watched(
            0
        )  # a plan arrived, perhaps like the last: what is shown may not be
        self.trouble: Watched[Trouble | None] = Watched(None)  # why there is no plan, or an edit was refused
        self.job: Watched[JobStatus | None] = Watched(
            None
        )  # of this session's latest run since it was opened
        self.added: Watched[str] = Watched("")  # the latest line of the log
        self.preview: Watched[Preview | None] = Watched(None)  # the newest of the stage that runs
        self._settings: Settings | None = None  # as last edited; the plan follows in a moment
        self._newest = 0
        self._logs: dict[Path, deque[str]] = {}
        self._jobs: dict[Path, Job] = {}
        self._known: weakref.WeakSet[Job] = weakref.WeakSet()
        board.listen(queued(self._look_at_board))

    @property
    def settings(self) -> Settings | None:
        return self._settings

    @property
    def cards(self) -> tuple[Card, ...]:
        return column(self.plan.value, self.job.value) if self.plan.value is not None else ()

    @property
    def log(self) -> Sequence[str]:
        """The lines of this session's runs since the window opened."""
        return tuple(self._logs.get(self.folder, ())) if self.folder is not None else ()

    def open(self, folder: Path | None) -> None:
        """Turn to a session; its plan arrives later."""
        self.folder, self._settings = folder, None
        self.plan.set(None)
        self.trouble.set(None)
        self.preview.set(None)
        job = self._jobs.get(folder) if folder is not None else None
        self.job.set(job.status if job is not None else None)
        self.refresh()

    def refresh(self) -> None:
        """Plan again, with what params.toml or the latest edit says."""
        self._ask(keep=False)

    def edit(self, settings: Settings) -> None:
        """Take these settings, write them, and plan anew."""
        self._settings = settings
        self._ask(keep=True)

    def process(self, device: str, until: str | None = None, scheduler: str = "") -> Job | None:
        """Queue a run of every stage that is not done; None where one of this session waits or runs."""
        if self.folder is None or self.busy(self.folder):
            return None
        return self.enqueue(self.folder, device, until, scheduler)

    def enqueue(self, folder: Path, device: str, until: str | None = None, scheduler: str = "") -> Job:
        """Queue a run of any session, as its own params.toml asks at the time it starts; `scheduler`: of the cluster that does it."""
        request = {"session": str(folder), "device": device, "until": until}
        job = Job(called(folder), "process", request | ({"scheduler": scheduler} if scheduler else {}))
        self._adopt(job)
        self._board.enqueue(job)
        return job

    def busy(self, folder: Path) -> bool:
        """Does a run of this session wait or run?"""
        return any(
            _session(job) == folder and not job.status.ended
            for job in self._board.queue
            if job.task == "process"
        )

    def cancel(self) -> None:
        """Cancel this session's run."""
        job = self._jobs.get(self.folder) if self.folder is not None else None
        if job is not None:
            job.cancel()

    def _ask(self, keep: bool) -> None:
        if self.folder is None:
            return
        settings = None if self._settings is None else asked.to_toml(self._settings)
        self._newest += 1
        take = self._queued(self._take)
        number, folder = self._newest, self.folder

        def then(answer: Answer) -> None:
            take(number, folder, answer)

        self._enquiries.ask("plan", then, session=str(self.folder), settings=settings, keep=keep)

    def _take(self, number: int, folder: Path, answer: Answer) -> None:
        if number != self._newest or folder != self.folder:
            return  # of an earlier edit, or of a session that was left
        if answer.content is None:
            self.trouble.set(answer.trouble)
            return
        plan = read_plan(answer.content)
        self._settings = plan.settings
        for note in answer.content.get("notes", ()):
            self._write(folder, f"note: {note}")
        self.trouble.set(None)
        self.plan.set(plan)
        self.answered.set(number)

    def _look_at_board(self) -> None:
        for job in self._board.queue:
            if job.task == "process":
                self._adopt(job)

    def _adopt(self, job: Job) -> None:
        """Follow a run, also one that somebody else queued."""
        if job in self._known:
            return
        self._known.add(job)
        folder = _session(job)
        self._jobs[folder] = job
        see, hear = self._queued(self._see), self._queued(self._hear)
        job.listen(lambda status: see(folder, job, status))
        # What libraries print is kept for the details of a failure; the log is for people.
        job.listen_events(lambda event: None if event.get("stderr") else hear(folder, event))
        self._see(folder, job, job.status)

    def _see(self, folder: Path, job: Job, status: JobStatus) -> None:
        if self._jobs.get(folder) is not job:
            return
        before = self.job.value
        if status.ended:
            self._write(folder, _told_end(status))
        if folder != self.folder:
            return
        self.job.set(status)
        if status.ended or (self.preview.value is not None and self.preview.value.stage != status.stage):
            self.preview.set(None)
        stage_ended = before is not None and (
            status.fraction == 1 > before.fraction or status.stage != before.stage
        )
        if status.ended or stage_ended:
            self.refresh()

    def _hear(self, folder: Path, event: Event) -> None:
        if event["event"] == "log":
            self._write(folder, str(event["text"]))
        elif event.get("kind") == "preview" and folder == self.folder:
            before = self.preview.value
            number = before.number + 1 if before is not None else 1
            self.preview.set(Preview(str(event["stage"]), Path(event["file"]), number))

    def _write(self, folder: Path, text: str) -> None:
        line = f"{self._now():%H:%M:%S}  {text}"
        self._logs.setdefault(folder, deque(maxlen=LOG_LINES)).append(line)
        if folder == self.folder:
            self.added.set(line)


def _session(job: Job) -> Path:
    return Path(str(job.request["session"]))


def _told_end(status: JobStatus) -> str:
    return f"{status.state.value}: {status.message}" if status.message else status.state.value
