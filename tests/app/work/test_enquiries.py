"""Whoever asks gets one answer, whatever becomes of the child that should give it."""

import queue

from app.work.enquiries import Answer, Enquiries
from tests.app.work.children import job

LONG_S = 30

ECHO = """
while True:
    said = hear()
    if said is None or said["command"] == "cancel":
        emit("cancelled"); break
    if said["question"] == "die": sys.stderr.write("poison\\n"); sys.exit(3)
    if said["question"] == "bad": emit("data", kind="answer", id=said["id"], fault="no such thing; ask another")
    else: emit("data", kind="answer", id=said["id"], answer={"echo": said["text"]})
"""


def enquiries() -> tuple[Enquiries, list[int]]:
    started: list[int] = []

    def make():
        started.append(1)
        return job(ECHO, "answers")

    return Enquiries(make), started


def test_each_question_gets_its_own_answer_from_one_child() -> None:
    asking, started = enquiries()
    got: queue.Queue[tuple[str, Answer]] = queue.Queue()
    for text in "abc":
        asking.ask("echo", lambda answer, text=text: got.put((text, answer)), text=text)
    for _ in range(3):
        text, answer = got.get(timeout=LONG_S)
        assert answer.content == {"echo": text}
    assert len(started) == 1
    asking.close()


def test_a_fault_comes_as_a_trouble() -> None:
    asking, _ = enquiries()
    got: queue.Queue[Answer] = queue.Queue()
    asking.ask("bad", got.put)
    answer = got.get(timeout=LONG_S)
    assert answer.content is None
    assert answer.trouble is not None
    assert (answer.trouble.what, answer.trouble.remedy) == ("no such thing", "ask another")
    asking.close()


def test_a_child_that_dies_answers_with_its_end_and_the_next_question_has_a_new_one() -> None:
    asking, started = enquiries()
    got: queue.Queue[Answer] = queue.Queue()
    asking.ask("die", got.put)
    trouble = got.get(timeout=LONG_S).trouble
    assert trouble is not None
    assert "exit code 3" in trouble.what
    assert "poison" in trouble.details
    asking.ask("echo", got.put, text="again")
    assert got.get(timeout=LONG_S).content == {"echo": "again"}
    assert len(started) == 2
    asking.close()


def test_nothing_is_started_before_the_first_question_or_after_the_last() -> None:
    asking, started = enquiries()
    asking.close()
    asking.ask("echo", lambda answer: None, text="a")
    assert started == []
