"""When silence counts as a hang, and how many restarts there are."""

import pytest

from app.viewer.watch import FRAME, LOADED, PONG, READY, Patience, Restarts, Watch

PATIENCE = Patience(ready=60, loaded=30, frame=8, pong=8, restarts=3, within=60)


def test_an_answer_in_time_is_well() -> None:
    watch = Watch(PATIENCE)
    watch.asked(FRAME, 0)
    assert watch.overdue(7.9) is None
    watch.heard(FRAME, 7.9)
    assert watch.overdue(1000) is None
    assert watch.left(1000) is None


@pytest.mark.parametrize(("what", "after"), [(READY, 60), (LOADED, 30), (FRAME, 8), (PONG, 8)])
def test_silence_is_noticed_after_its_time(what: str, after: float) -> None:
    watch = Watch(PATIENCE)
    watch.asked(what, 100)
    assert watch.left(100) == after
    assert watch.overdue(100 + after - 0.01) is None
    assert watch.overdue(100 + after) == what


def test_what_waits_behind_a_load_is_given_its_full_time_afterwards() -> None:
    watch = Watch(PATIENCE)
    watch.asked(FRAME, 0)
    watch.asked(PONG, 0)
    watch.asked(LOADED, 1)
    assert watch.overdue(25) is None
    watch.heard(LOADED, 25)
    assert watch.overdue(32) is None
    assert watch.overdue(33) in (FRAME, PONG)


def test_a_child_that_says_it_is_busy_gets_more_time() -> None:
    watch = Watch(PATIENCE)
    watch.asked(LOADED, 0)
    watch.lives(29)
    assert watch.overdue(88) is None
    assert watch.overdue(89) == LOADED
    watch.heard(LOADED, 88)
    watch.asked(FRAME, 90)
    watch.lives(95)  # kernels to compile, before a picture
    assert watch.overdue(154) is None
    assert watch.overdue(155) == FRAME
    watch.heard(FRAME, 154)
    watch.asked(FRAME, 160)
    assert watch.overdue(168) == FRAME


def test_restarts_end_after_so_many_within_so_long() -> None:
    restarts = Restarts(PATIENCE)
    assert [restarts.allowed(time) for time in (0, 1, 2, 3)] == [True, True, True, False]
    assert restarts.allowed(60.5)  # the first was forgotten
    assert not restarts.allowed(60.6)
    restarts.forgive()
    assert restarts.allowed(60.7)
