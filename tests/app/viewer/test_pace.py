"""How much is drawn while the eye moves."""

from app.viewer.pace import AIM_MS, EFFORTS, LEAST, Pace

FAST, SLOW = AIM_MS / 2, AIM_MS * 2


def test_a_quick_machine_always_draws_everything() -> None:
    pace = Pace()
    for _ in range(9):
        pace.still(FAST)
        pace.moved(FAST)
    assert pace.effort == EFFORTS[0]


def test_a_slow_machine_draws_less_and_less() -> None:
    pace = Pace()
    seen = []
    for _ in range(12):
        pace.moved(SLOW)
        seen.append(EFFORTS.index(pace.effort))
    assert seen == sorted(seen)
    assert seen[-1] == LEAST


def test_the_first_picture_of_an_effort_does_not_count() -> None:
    pace = Pace()
    pace.moved(50 * SLOW)  # sends everything to the graphics card
    assert pace.effort == EFFORTS[0]
    pace.moved(SLOW)
    assert pace.effort == EFFORTS[1]


def test_a_resting_picture_says_where_the_next_movement_begins() -> None:
    pace = Pace()
    pace.still(FAST)
    pace.still(SLOW)
    assert pace.effort == EFFORTS[1]
    for _ in range(20):
        pace.still(FAST)
    assert pace.effort == EFFORTS[0]


def test_another_scene_begins_anew() -> None:
    pace = Pace()
    for _ in range(12):
        pace.moved(SLOW)
    pace.forget()
    assert pace.effort == EFFORTS[0]


def test_what_was_slow_while_the_machine_was_busy_is_tried_again() -> None:
    pace = Pace()
    for _ in range(12):
        pace.moved(SLOW)
    assert pace.effort == EFFORTS[LEAST]
    for _ in range(40):
        pace.still(SLOW)
    assert pace.effort == EFFORTS[1]
