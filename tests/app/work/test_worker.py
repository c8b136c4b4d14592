"""A worker tells everything on its pipe, ends when the window is gone, and leaves a session that resumes."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from app.work import worker
from app.work.jobs import Job, JobState, child_command
from app.work.worker import Link
from engine.errors import Cancelled, MaskError
from engine.io import session as sessions
from tests.app.calls import ROOT
from tests.app.sessions import VIEWS, small
from tests.app.work.children import Heard

LONG_S = 120  # children import the engine; a busy machine takes its time


class Pipe:
    """A link whose events are read here."""

    def __init__(self) -> None:
        self._read, self._write = os.pipe()
        self.link = Link(self._write, clock=lambda: self.now)
        self.now = 0.0

    def events(self) -> list[Mapping[str, Any]]:
        """What was emitted; the link is used up."""
        os.close(self._write)
        with os.fdopen(self._read) as file:
            return [json.loads(line) for line in file]


@pytest.fixture
def pipe() -> Pipe:
    return Pipe()


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return small(tmp_path)


def test_progress_is_told_some_twenty_times_a_second_and_always_to_the_end(pipe: Pipe) -> None:
    for number in range(1000):
        pipe.now = number / 1000
        pipe.link.move(number / 1000)
    pipe.link.move(1.0, "written")
    events = pipe.events()
    assert 15 <= len(events) <= 25
    assert events[-1] == {"event": "progress", "fraction": 1.0, "note": "written"}


@pytest.mark.parametrize(
    ("error", "event", "code"),
    [
        (Cancelled("stopped"), "cancelled", 130),
        (MaskError("no\nobject; paint one"), "failed", 2),
        (MemoryError(), "failed", 2),
        (ZeroDivisionError("division by zero"), "failed", 1),
    ],
)
def test_every_end_is_one_last_event(pipe: Pipe, error: BaseException, event: str, code: int) -> None:
    def task(request: Mapping[str, Any], link: Link) -> None:
        raise error

    assert worker.perform(task, {}, pipe.link) == code
    (last,) = pipe.events()
    assert last["event"] == event
    if event == "failed":
        assert "\n" not in last["message"]
        assert "; " in last["message"]
        assert type(error).__name__ in last["details"]


def test_commands_that_come_before_the_task_listens_are_not_lost(pipe: Pipe) -> None:
    heard = []
    pipe.link.take(b'{"command": "ask", "id": 1}')
    pipe.link.take(b'{"command": "other"}')
    pipe.link.take(b'{"command": "ask", "id": 2}')
    pipe.link.hear("ask", lambda content: heard.append(content["id"]))
    pipe.link.take(b'{"command": "ask", "id": 3}')
    assert heard == [1, 2, 3]


def test_garbage_on_stdin_is_told_and_passed_over(pipe: Pipe) -> None:
    pipe.link.take(b"\xff{")
    pipe.link.take(b"[]")
    pipe.link.take(b'{"command": "cancel"}')
    assert pipe.link.cancelled()
    assert [event["event"] for event in pipe.events()] == ["log", "log"]


def test_a_window_that_is_gone_stops_the_task_and_then_the_process(pipe: Pipe) -> None:
    left: list[int] = []
    gone, ended = threading.Event(), threading.Event()
    pipe.link.hear("gone", lambda content: gone.set())
    read, write = os.pipe()
    os.write(write, b'{"command": "pau')
    os.close(write)
    worker.listen(pipe.link, read, leave=lambda code: (left.append(code), ended.set()), grace_s=0.01)
    assert pipe.link.cancelled()
    assert gone.is_set()
    assert ended.wait(LONG_S)
    assert left == [worker.ORPHANED]


def test_a_pipe_nobody_reads_stops_the_task(pipe: Pipe) -> None:
    os.close(pipe._read)
    pipe.link.emit("log", text="anybody?")
    assert pipe.link.cancelled()


def test_every_task_is_where_the_table_says() -> None:
    for name in worker.TASKS:
        assert callable(worker.find(name))


def test_processing_tells_its_stages_and_reads_what_params_toml_asks(session: Path) -> None:
    sessions.write_params(sessions.open_session(session), {"preset": "draft"})
    job = Job("a", "process", {"session": str(session), "device": "cpu", "until": "segment"})
    heard, policies = Heard(job), set()
    job.listen_events(lambda event: policies.add(os.sched_getscheduler(job._child.pid)))  # type: ignore[union-attr]
    job.start()
    status = job.wait(LONG_S)
    assert status.state is JobState.DONE, status
    assert policies == {os.SCHED_BATCH}  # the window goes first
    assert status.result == {"ran": ["hdr", "segment"]}
    assert list(dict.fromkeys(s.stage for s in heard.statuses if s.fraction == 1)) == ["hdr", "segment"]
    assert sessions.read_params(sessions.open_session(session))["preset"] == "draft"


def run(task: str, request: Mapping[str, Any], pipe: Pipe) -> Mapping[str, Any]:
    """The last event of a task that runs in this process."""
    worker.perform(worker.find(task), request, pipe.link)
    return pipe.events()[-1]


def test_a_locked_session_fails_with_the_line_the_terminal_would_show(session: Path, pipe: Pipe) -> None:
    with sessions.lock(sessions.open_session(session)):
        last = run("process", {"session": str(session), "device": "cpu"}, pipe)
    assert last["event"] == "failed"
    assert f"process {os.getpid()} is working on this session; wait for it" in last["message"]


@pytest.fixture
def orphan(session: Path) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A window that is killed: a process that starts a worker and tells its id."""
    code = f"""
import subprocess, sys
child = subprocess.Popen({child_command("process", {"session": str(session), "device": "cpu"})!r},
    stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
for line in child.stdout:
    if b'"stage"' in line:
        print(child.pid, flush=True); break
sys.stdin.read()
"""
    window = subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert window.stdout is not None
    yield window, int(window.stdout.readline())
    window.kill()
    window.communicate()


def test_killing_the_window_leaves_no_worker_and_a_session_that_resumes(
    orphan: tuple[subprocess.Popen[str], int], session: Path, pipe: Pipe
) -> None:
    window, child = orphan
    window.send_signal(signal.SIGKILL)
    end = time.monotonic() + LONG_S
    while Path(f"/proc/{child}").exists() and _state(child) != "Z":
        assert time.monotonic() < end, "the worker outlived its window"
        time.sleep(0.05)
    with sessions.lock(sessions.open_session(session)):
        pass
    last = run("process", {"session": str(session), "device": "cpu", "until": "segment"}, pipe)
    assert last["event"] == "done", last


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


def test_an_export_fails_in_words_where_nothing_is_processed(
    session: Path, tmp_path: Path, pipe: Pipe
) -> None:
    last = run("export", {"session": str(session), "to": str(tmp_path / "out"), "green": "down"}, pipe)
    assert last["event"] == "failed"
    assert "roomlight process" in last["message"]
    assert not (tmp_path / "out").exists()


def test_an_import_makes_a_session_and_says_where(session: Path, tmp_path: Path, pipe: Pipe) -> None:
    to = tmp_path / "b.session"
    last = run("import", {"folder": str(tmp_path / "renders"), "session": str(to), "bracket": None}, pipe)
    assert last == {"event": "done", "result": {"session": str(to), "views": VIEWS}}
    assert len(sessions.shots(sessions.open_session(to))) == VIEWS
