"""The queue runs one job at a time, in the order a person gave it, and goes on after a failure."""

import threading
from collections.abc import Callable

from app.work.jobs import Job, JobState
from app.work.queue import CLUSTER_JOBS, Board
from tests.app.work.children import QUICK, WILLING, Heard, job

LONG_S = 30


def settled(board: Board, what: Callable[[], bool]) -> None:
    """Wait until the board's news make `what` true."""
    changed = threading.Event()
    leave = board.listen(changed.set)
    for _ in range(200):
        if what():
            leave()
            return
        changed.wait(LONG_S / 200)
        changed.clear()
    raise AssertionError([(other.status.name, other.status.state) for other in board.queue])


def names(jobs: tuple[Job, ...]) -> list[str]:
    return [other.status.name for other in jobs]


def test_one_runs_after_the_other() -> None:
    board = Board()
    running: list[int] = []
    jobs = [job(QUICK, name) for name in "abc"]
    board.listen(lambda: running.append(len(board.active)))
    for work in jobs:
        board.enqueue(work)
    for work in jobs:
        assert work.wait(LONG_S).state is JobState.DONE
    assert max(running) == 1
    assert names(board.queue) == ["a", "b", "c"]


def test_a_cluster_has_some_at_once_and_this_machine_one() -> None:
    board = Board()
    away = [job(WILLING, name, request={"scheduler": "tcp://head:8786"}) for name in range(CLUSTER_JOBS + 1)]
    here = [job(WILLING, name) for name in "ab"]
    for work in (here[0], *away, here[1]):
        board.enqueue(work)
    assert set(board.active) == {here[0], *away[:-1]}
    assert board.waiting == (away[-1], here[1])
    board.hold(True)
    away[0].cancel()
    away[0].wait(LONG_S)
    assert board.waiting == (away[-1], here[1])
    board.hold(False)
    assert board.waiting == (here[1],)
    board.cancel_all()
    for work in away:
        assert work.wait(LONG_S).state is JobState.CANCELLED


def test_a_failure_does_not_stop_the_night() -> None:
    board = Board()
    bad, good = job("sys.exit(1)", "bad"), job(QUICK, "good")
    board.enqueue(bad)
    board.enqueue(good)
    assert good.wait(LONG_S).state is JobState.DONE
    assert bad.status.state is JobState.FAILED


def test_a_job_that_cannot_start_lets_the_next_run() -> None:
    board = Board()
    bad = Job("bad", "process", {}, command=lambda task, request: ["/nowhere"])
    good = job(QUICK, "good")
    board.hold(True)
    board.enqueue(bad)
    board.enqueue(good)
    board.hold(False)
    assert good.wait(LONG_S).state is JobState.DONE


def test_waiting_jobs_are_moved_and_removed_and_the_running_one_is_not() -> None:
    board = Board()
    first = job(WILLING, "first")
    board.enqueue(first)
    others = [job(QUICK, name) for name in "abc"]
    for work in others:
        board.enqueue(work)
    board.move(others[2], 0)
    assert names(board.waiting) == ["c", "a", "b"]
    board.move(others[2], 99)
    assert names(board.waiting) == ["a", "b", "c"]
    board.move(first, 2)
    assert names(board.queue)[0] == "first"
    board.remove(others[0])
    board.remove(first)
    assert names(board.queue) == ["first", "b", "c"]
    first.cancel()
    assert others[2].wait(LONG_S).state is JobState.DONE
    assert others[0].status.state is JobState.CANCELLED


def test_a_held_queue_starts_nothing_further() -> None:
    board = Board()
    board.hold(True)
    work = job(QUICK)
    board.enqueue(work)
    assert work.status.state is JobState.QUEUED
    assert board.held
    board.hold(False)
    assert work.wait(LONG_S).state is JobState.DONE


def test_jobs_beside_the_queue_run_at_once_and_leave_when_done() -> None:
    board = Board()
    slow, beside = job(WILLING, "slow"), job(QUICK, "beside")
    board.enqueue(slow)
    board.start(beside)
    assert beside.wait(LONG_S).state is JobState.DONE
    settled(board, lambda: names(board.active) == ["slow"])
    assert names(board.queue) == ["slow"]
    slow.cancel()
    slow.wait(LONG_S)


def test_cancelling_all_stops_what_runs_and_keeps_what_waits() -> None:
    board = Board()
    running, beside, waiting = job(WILLING, "running"), job(WILLING, "beside"), job(QUICK, "waiting")
    heard = [Heard(running), Heard(beside)]
    board.enqueue(running)
    board.enqueue(waiting)
    board.start(beside)
    for one in heard:
        one.wait(lambda status: status.stage == "hdr")
    board.cancel_all()
    assert running.wait(LONG_S).state is JobState.CANCELLED
    assert beside.wait(LONG_S).state is JobState.CANCELLED
    settled(board, lambda: not board.active)
    assert waiting.status.state is JobState.QUEUED


def test_ended_jobs_are_cleared_and_others_stay() -> None:
    board = Board()
    done, waiting = job(QUICK, "done"), job(QUICK, "waiting")
    board.enqueue(done)
    done.wait(LONG_S)
    board.hold(True)
    board.enqueue(waiting)
    board.clear_ended()
    assert names(board.queue) == ["waiting"]


def test_a_job_that_is_left_runs_on_and_counts_no_more() -> None:
    board = Board()
    work = job(WILLING)
    work.start()
    assert board.active == ()
    for _ in range(2):
        board.start(work)
        board.start(work)
        assert board.active == (work,)
        board.leave(work)
        assert board.active == ()
        assert work.status.state is JobState.RUNNING
    news: list[int] = []
    board.listen(lambda: news.append(1))
    work.cancel()
    assert work.wait(LONG_S).state is JobState.CANCELLED
    assert news == []
