import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.capture_checks.checker import ShotChecker, plan_findings
from engine.capture_checks.finding import Severity
from engine.capture_checks.planning import coverage, next_view
from engine.capture_checks.planning.plan_precision import certainty
from tests.engine.capture_checks.planning.test_coverage import OPEN, facing, look

RIG = {
    "pan_axis": (0.0, -1.0, 0.0), "pan_point": (0.0, 0.0, 0.2), "tilt_axis": (1.0, 0.0, 0.0), "tilt_point": (0.0, 0.0, 0.2),
}  # fmt: skip
TURNTABLE = [(15.0 * i, 0.0) for i in range(24)]
ROWS = [(45.0 * i + 20 * row, tilt) for row, tilt in enumerate((-50.0, 0.0, 50.0)) for i in range(8)]


def seen(turns: np.ndarray) -> coverage.Coverage:
    return coverage.cover(OPEN, [look()] * len(turns), turns)


# ---- the next pose


def test_a_rig_goes_where_most_is_unseen_and_enough_is_shared():
    done = np.stack([facing(0), facing(30)])
    left = np.stack([facing(15), facing(60), facing(180)])
    order = next_view.order(OPEN, done, left)
    assert order[0] == 1  # 0 shows nothing new, 2 could not be tied to any
    assert sorted(order) == [0, 1, 2]
    best = next_view.best_pose(OPEN, seen(done), done, left)
    assert best.index == 1
    assert best.overlap > next_view.OVERLAP
    assert best.gain == pytest.approx(0.5 * seen(done[:1]).share, rel=0.3)
    assert f"{best.gain:.0%}" in best.sentence


def test_an_order_shows_most_of_the_room_early():
    turns = np.stack([facing(yaw, pitch) for pitch in range(-60, 61, 24) for yaw in range(0, 360, 15)])
    order = next_view.order(OPEN, np.zeros((0, 3, 3)), turns)
    assert sorted(order) == list(range(len(turns)))
    assert order[0] == 0
    assert seen(turns[order[:40]]).share > 1.3 * seen(turns[:40]).share
    shown = next_view._shown(OPEN, turns, coverage.fibonacci_sphere(coverage.DIRECTIONS))
    for number in range(1, len(order)):
        ours = shown[order[number]]
        assert max((ours & shown[k]).sum() for k in order[:number]) >= next_view.OVERLAP * ours.sum()


def test_poses_that_overlap_nothing_are_still_all_visited():
    done, left = facing(0)[None], np.stack([facing(180), facing(150)])
    assert next_view.order(OPEN, done, left)[0] == 1  # the nearer of the two
    assert next_view.best_pose(OPEN, seen(done), done, np.zeros((0, 3, 3))) is None


@pytest.mark.parametrize(
    ("done", "words"),
    [
        ([(yaw, pitch) for yaw in range(0, 181, 30) for pitch in (-60, -30, 30, 60, 0)], "right"),
        ([(yaw, pitch) for yaw in range(0, 360, 20) for pitch in (-80, -50, -20, 0)], "up"),
    ],
)  # fmt: skip
def test_hands_are_sent_where_nobody_has_looked(done, words):
    turns = np.stack([facing(*where) for where in done])
    best = next_view.for_hands(OPEN, seen(turns), turns, coverage.upright(turns), np.eye(3))
    assert words in best.sentence
    assert best.gain > next_view.ENOUGH_GAIN
    assert f"adds {best.gain:.0%} of the sphere" in best.sentence


@pytest.mark.parametrize(
    ("yaw", "pitch", "expected"),
    [(40, 20, "turn 40 degrees right and point 20 degrees up"), (-30, 0, "turn 30 degrees left"), (3, -80, "point down to the floor")],
)  # fmt: skip
def test_ways_are_told_as_one_would_say_them(yaw, pitch, expected):
    now, then = facing(0)[2], facing(yaw, pitch)[2]
    assert next_view._way(now, then, level=True) == expected


def test_a_camera_pointed_elsewhere_looks_there_without_rolling():
    rng = np.random.default_rng(0)
    for turn in Rotation.random(20, rng=rng).as_matrix():
        gaze = rng.standard_normal(3)
        gaze /= np.linalg.norm(gaze)
        for target in (gaze, turn[2], -turn[2]):
            pointed = next_view._pointed(turn, target)
            np.testing.assert_allclose(pointed[2], target, atol=1e-9)
            np.testing.assert_allclose(pointed @ pointed.T, np.eye(3), atol=1e-9)


def test_a_room_that_is_seen_needs_no_more():
    turns = np.stack([facing(yaw, pitch) for pitch in range(-90, 91, 20) for yaw in range(0, 360, 20)])
    best = next_view.for_hands(OPEN, seen(turns), turns, coverage.upright(turns), np.eye(3))
    assert "the room is seen" in best.sentence


# ---- plans about one axis


def test_a_turntable_is_warned_of_with_numbers():
    (found,) = plan_findings(RIG, TURNTABLE)
    assert (found.kind, found.severity) == ("plan", Severity.WARNING)
    assert 1.2 < found.value < 2.5
    # 42 degrees high: a band of 36 % of the sphere.
    assert "64% of the room's directions" in found.seen
    assert f"{found.value:.1f} times less certain" in found.seen


@pytest.mark.parametrize("tilt", [0.0, 25.0])
def test_any_one_axis_is_one_axis(tilt):
    assert plan_findings(RIG, [(pan, tilt) for pan, _ in TURNTABLE])
    assert plan_findings(RIG, [(0.0, 5.0 * i) for i in range(12)])


def test_tilted_rows_are_not_warned_of():
    assert plan_findings(RIG, ROWS) == ()
    assert plan_findings(RIG, TURNTABLE[:2]) == ()


def test_small_tilts_are_still_one_axis():
    wobbling = [(pan, 6.0 * (-1) ** n) for n, (pan, _) in enumerate(TURNTABLE)]
    assert plan_findings(RIG, wobbling)


# ---- certainty


def rows_of(plan: list[tuple[float, float]]) -> np.ndarray:
    return np.stack([facing(-pan, tilt) for pan, tilt in plan])


def test_one_axis_leaves_normals_less_certain_and_more_at_the_mercy_of_lamps():
    table, rows = certainty(rows_of(TURNTABLE)), certainty(rows_of(ROWS))
    assert table.worst > 1.25 * rows.worst
    assert table.lamp_deg > 1.4 * rows.lamp_deg
    assert table.best == pytest.approx(rows.best, rel=0.3)


def test_four_times_the_shots_halve_the_error():
    few, many = certainty(rows_of(ROWS)), certainty(rows_of(ROWS * 4))
    assert many.worst == pytest.approx(few.worst / 2, rel=1e-3)
    assert many.lamp_deg == pytest.approx(few.lamp_deg, rel=1e-3)


# ---- through the watch


def test_a_rig_without_shots_starts_with_its_plan():
    watch = ShotChecker(RIG)
    order = watch.order(ROWS)
    assert order[0] == 0
    assert sorted(order) == list(range(len(ROWS)))
    assert watch.next_by_rig(ROWS) is None
