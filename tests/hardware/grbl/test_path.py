import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.grbl.path import Way, distance_to, travel_s

ANGLE = st.floats(-400, 400).map(lambda value: round(value, 3))


@given(ANGLE, ANGLE, st.floats(0.01, 3), st.booleans())
def test_every_way_ends_upwards_by_at_least_the_play(target: float, start: float, play: float, loaded: bool):
    corners = Way.to((target,), (start,), (play,), loaded).corners
    assert corners[-1] == (target,)
    before = corners[-2][0] if len(corners) > 1 else start
    already = loaded and abs(target - start) < 1e-3
    assert already or target - before >= play - 1e-9 or (loaded and target > before)


def test_without_play_the_way_is_straight():
    assert Way.to((5.0, -3.0), (9.0, 1.0), (0.0, 0.0), False).corners == ((5.0, -3.0),)


def test_only_the_axis_that_needs_it_goes_round():
    assert Way.to((5.0, 3.0), (9.0, 1.0), (0.5, 0.5), True).corners == ((4.5, 3.0), (5.0, 3.0))


def test_time_is_that_of_a_trapezoid():
    settings = {110: 600.0, 120: 5.0}
    # 10 deg/s, 5 deg/s2: 2 s up, 2 s down over 10 deg each, 80 deg between at 10 deg/s.
    assert travel_s([(0.0,), (100.0,)], 6000.0, settings) == pytest.approx(12.0)
    assert travel_s([(0.0,), (100.0,), (0.0,)], 6000.0, settings) == pytest.approx(24.0)
    assert travel_s([(0.0,), (0.0,)], 6000.0, settings) == 0.0


def test_the_slower_axis_decides():
    settings = {110: 6000.0, 111: 60.0, 120: 1e9, 121: 1e9}
    assert travel_s([(0.0, 0.0), (10.0, 10.0)], 6000.0, settings) == pytest.approx(10.0)


def test_distance_is_to_the_nearest_point_of_the_way():
    way = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]
    assert distance_to((5.0, 2.0), way) == pytest.approx(2.0)
    assert distance_to((12.0, 5.0), way) == pytest.approx(2.0)
    assert distance_to((-3.0, -4.0), way) == pytest.approx(5.0)
    assert distance_to((1.0, 1.0), [(1.0, 0.0)]) == pytest.approx(1.0)
    assert distance_to((1.0, 1.0), [(1.0, 0.0), (1.0, 0.0)]) == pytest.approx(1.0)
