"""How a child ended decides what becomes of its order."""

import asyncio
import threading

import pytest

from app.batch import child
from app.batch.child import Killed, ended
from app.exit_codes import ExitCode
from app.work.jobs import JobState, JobStatus


@pytest.mark.parametrize("signal", [-9, -11])
def test_a_killed_child_raises_which_dask_tries_again(signal: int) -> None:
    with pytest.raises(Killed, match="memory ran out"):
        ended("a", JobStatus("a", JobState.FAILED, message="memory ran out", code=signal), 1.0)


@pytest.mark.parametrize(
    ("code", "told"), [(2, ExitCode.REFUSED), (4, ExitCode.BUSY), (1, ExitCode.FAULT), (77, ExitCode.FAULT)]
)
def test_what_the_child_said_is_passed_on_and_not_tried_again(code: int, told: ExitCode) -> None:
    answer = ended("a", JobStatus("a", JobState.FAILED, message="why; do this", code=code), 1.0)
    assert (answer["code"], answer["message"]) == (told, "why; do this")


def test_a_child_that_was_asked_to_stop_is_no_failure_however_it_ended() -> None:
    status = JobStatus("a", JobState.CANCELLED, code=-9)  # its patience was over
    assert ended("a", status, 1.0)["code"] == ExitCode.STOPPED


def test_a_stop_waits_until_the_children_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow:
        def cancel(self) -> None:
            threading.Timer(0.1, running.clear).start()

    running = {Slow()}
    monkeypatch.setitem(child._running, "a", running)
    asyncio.run(child.stop("a"))
    assert not running
