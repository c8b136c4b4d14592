"""The queue of last time comes back; a file that is damaged costs the queue and nothing else."""

from pathlib import Path

import pytest

from app.work import queue_file
from app.work.jobs import JobState
from app.work.queue import Board
from tests.app.work.children import QUICK, WILLING, Heard, job


@pytest.fixture
def session(tmp_path: Path) -> Path:
    (tmp_path / "a.session").mkdir()
    (tmp_path / "a.session" / "session.json").write_text("{}")
    return tmp_path / "a.session"


def test_what_ran_and_what_waited_comes_back_unstarted(session: Path, tmp_path: Path) -> None:
    board, path = Board(), tmp_path / "state" / "queue.json"
    done, running, waiting = (
        job(script, name, request={"session": str(session), "device": "cpu"})
        for name, script in (("done", QUICK), ("running", WILLING), ("waiting", QUICK))
    )
    board.enqueue(done)
    done.wait(30)
    heard = Heard(running)
    board.enqueue(running)
    board.enqueue(waiting)
    heard.wait(lambda status: status.stage == "hdr")
    queue_file.write(board, path)
    board.cancel_all()
    running.wait(30)
    back = queue_file.read(path)
    assert [other.status.name for other in back] == ["running", "waiting"]
    assert all(other.status.state is JobState.QUEUED for other in back)
    assert back[0].request == {"session": str(session), "device": "cpu"}


def test_an_empty_queue_leaves_no_file(tmp_path: Path) -> None:
    path = tmp_path / "queue.json"
    path.write_text("[]")
    queue_file.write(Board(), path)
    assert not path.exists()
    assert queue_file.read(path) == []


@pytest.mark.parametrize(
    "content", ["", "{}", "[1]", '[{"name": "a", "task": "process", "request": {}}]', '{"a": 1}']
)
def test_a_file_that_cannot_be_meant_is_an_empty_queue(tmp_path: Path, content: str) -> None:
    path = tmp_path / "queue.json"
    path.write_text(content)
    assert queue_file.read(path) == []


def test_sessions_that_are_gone_and_other_tasks_are_left_out(session: Path, tmp_path: Path) -> None:
    import json

    path = tmp_path / "queue.json"
    rows = [
        {"name": "gone", "task": "process", "request": {"session": str(tmp_path / "gone")}},
        {"name": "odd", "task": "erase", "request": {"session": str(session)}},
        {"name": "good", "task": "process", "request": {"session": str(session)}},
    ]
    path.write_text(json.dumps(rows))
    assert [other.status.name for other in queue_file.read(path)] == ["good"]


def test_a_disk_that_refuses_costs_the_queue_alone(session: Path, tmp_path: Path) -> None:
    board = Board()
    board.hold(True)
    board.enqueue(job(QUICK, request={"session": str(session)}))
    (tmp_path / "file").write_text("")
    queue_file.write(board, tmp_path / "file" / "queue.json")
