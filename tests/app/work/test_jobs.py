"""A job's child may do what it likes: the status tells the truth about it and always comes to an end."""

import time

import pytest

from app.work.jobs import Job, JobState, JobStatus
from tests.app.work.children import QUICK, WILLING, Heard, job

LONG_S = 30


def test_stages_progress_and_result_come_in_order() -> None:
    work = job(
        """
emit("stage", name="hdr", number=1, count=2)
emit("progress", fraction=0.5, note="view 3")
emit("stage_done", name="hdr", seconds=1.0)
emit("stage", name="segment", number=2, count=2)
emit("done", result={"ran": ["hdr", "segment"]})
"""
    )
    heard = Heard(work)
    work.start()
    assert work.wait(LONG_S).state is JobState.DONE
    assert work.status.result == {"ran": ["hdr", "segment"]}
    assert heard.states == [JobState.RUNNING, JobState.DONE]
    told = [(status.stage, status.stage_number, status.fraction, status.note) for status in heard.statuses]
    assert told[1:5] == [
        ("hdr", 1, 0.0, ""),
        ("hdr", 1, 0.5, "view 3"),
        ("hdr", 1, 1.0, ""),
        ("segment", 2, 0.0, ""),
    ]


def test_a_status_is_frozen() -> None:
    with pytest.raises(AttributeError):
        JobStatus("lion").fraction = 0.5  # type: ignore[misc]


def test_time_left_follows_the_pace_of_the_stage() -> None:
    # The child's words come one by one; the clock stands at 0 when the stage begins and at 10 s afterwards.
    now = [0.0]
    work = job(
        """
emit("stage", name="light", number=1, count=1)
hear()
emit("progress", fraction=0.25)
hear()
emit("done")
""",
        clock=lambda: now[0],
    )
    heard = Heard(work)
    work.start()
    heard.wait(lambda status: status.stage == "light")
    now[0] = 10.0
    work.send("on")
    assert heard.wait(lambda status: status.fraction == 0.25).eta_s == pytest.approx(30.0)
    work.send("on")
    assert work.wait(LONG_S).eta_s is None


@pytest.mark.parametrize("stage", ['emit("stage", name="a", number=1, count=1)', "pass"])
def test_time_left_is_not_guessed_from_nothing(stage: str) -> None:
    work = job(f'{stage}; emit("progress", fraction=0.5); emit("done")', clock=lambda: 5.0)
    heard = Heard(work)
    work.start()
    work.wait(LONG_S)
    assert heard.wait(lambda status: status.fraction == 0.5).eta_s is None


def test_a_failure_carries_its_line_and_its_details() -> None:
    work = job('emit("failed", message="a.dng: cannot be read; take it again", details="Traceback ...")')
    work.start()
    status = work.wait(LONG_S)
    assert (status.state, status.message, status.details) == (
        JobState.FAILED, "a.dng: cannot be read; take it again", "Traceback ...",
    )  # fmt: skip


def test_a_child_that_ends_without_a_word_is_a_failure_with_its_stderr() -> None:
    work = job('sys.stderr.write("ran into a wall\\n"); sys.exit(7)')
    work.start()
    status = work.wait(LONG_S)
    assert status.state is JobState.FAILED
    assert "exit code 7" in status.message
    assert "ran into a wall" in status.details


@pytest.mark.parametrize(("name", "told"), [("SIGKILL", "memory ran out"), ("SIGSEGV", "crashed (SIGSEGV)")])
def test_a_child_that_was_killed_says_what_that_means(name: str, told: str) -> None:
    work = job(f"os.kill(os.getpid(), signal.{name})")
    work.start()
    status = work.wait(LONG_S)
    assert status.state is JobState.FAILED
    assert told in status.message
    assert "; " in status.message


def test_what_libraries_print_is_no_event() -> None:
    work = job('print("Elapsed time: 3 s"); print("[1, 2]"); print("{}"); emit("done")')
    heard = Heard(work)
    work.start()
    assert work.wait(LONG_S).state is JobState.DONE
    assert heard.states == [JobState.RUNNING, JobState.DONE]


def test_a_cancelled_child_ends_by_itself() -> None:
    work = job(WILLING)
    heard = Heard(work)
    work.start()
    heard.wait(lambda status: status.stage == "hdr")
    work.cancel()
    assert work.wait(LONG_S).state is JobState.CANCELLED
    assert heard.states == [JobState.RUNNING, JobState.CANCELLING, JobState.CANCELLED]


def test_a_child_that_heeds_no_cancel_is_killed_after_its_patience() -> None:
    work = job('emit("stage", name="deaf", number=1, count=1)\nwhile True: time.sleep(60)', patience_s=0.05)
    heard = Heard(work)
    work.start()
    heard.wait(lambda status: status.stage == "deaf")
    work.cancel()
    assert work.wait(LONG_S).state is JobState.CANCELLED


def test_a_job_cancelled_before_its_start_never_starts() -> None:
    work = job(QUICK)
    work.cancel()
    work.start()
    assert work.status.state is JobState.CANCELLED


def test_a_job_that_was_done_before_the_cancel_came_is_done() -> None:
    work = job(QUICK)
    work.start()
    work.wait(LONG_S)
    work.cancel()
    assert work.status.state is JobState.DONE


def test_starting_twice_runs_once() -> None:
    work = job(QUICK)
    work.start()
    work.start()
    assert work.wait(LONG_S).state is JobState.DONE
    work.start()
    assert work.status.state is JobState.DONE


def test_a_child_that_reads_nothing_never_blocks_the_window() -> None:
    work = job('emit("stage", name="stuck", number=1, count=1)\nwhile True: time.sleep(60)')
    heard = Heard(work)
    work.start()
    heard.wait(lambda status: status.stage == "stuck")
    start = time.monotonic()
    for _ in range(400):
        work.send("ask", question="x" * 1000)
    assert time.monotonic() - start < 10
    assert work.wait(LONG_S).state is JobState.FAILED


def test_a_listener_may_use_the_job_it_hears_of() -> None:
    work = job(WILLING)
    seen: list[JobState] = []

    def meddle(status: JobStatus) -> None:
        seen.append(work.status.state)
        if status.stage == "hdr":
            work.cancel()

    work.listen(meddle)
    work.start()
    assert work.wait(LONG_S).state is JobState.CANCELLED
    assert seen[-1] is JobState.CANCELLED


def test_who_left_hears_no_more() -> None:
    work = job(QUICK)
    heard: list[JobStatus] = []
    leave = work.listen(heard.append)
    leave()
    work.start()
    work.wait(LONG_S)
    assert heard == []


def test_a_worker_that_cannot_be_started_is_a_failure() -> None:
    work = Job("lion", "process", {}, command=lambda task, request: ["/nowhere/python"])
    work.start()
    assert work.wait(1).state is JobState.FAILED
    assert "could not be started" in work.status.message


def test_events_reach_those_who_listen_for_them() -> None:
    work = job('emit("data", kind="answer", id=3, answer=42); emit("log", text="hello"); emit("done")')
    events = []
    work.listen_events(events.append)
    work.start()
    work.wait(LONG_S)
    assert [event["event"] for event in events] == ["data", "log", "done"]
    assert events[0]["answer"] == 42
