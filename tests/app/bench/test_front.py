"""Pareto fronts and exponents hold for what can be worked out by hand."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.bench.front import exponent, pareto

numbers = st.floats(0.01, 100)


def test_the_front_is_what_no_point_beats():
    seconds, errors = [1.0, 2.0, 3.0, 4.0, 2.5], [9.0, 5.0, 6.0, 1.0, 5.0]
    assert pareto(seconds, errors) == [0, 1, 3]


def test_a_slower_point_of_equal_error_and_a_point_without_error_are_not_on_the_front():
    assert pareto([2.0, 1.0, 0.5], [3.0, 3.0, math.nan]) == [1]


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=12))
def test_every_point_is_on_the_front_or_beaten_by_one_that_is(points):
    front = pareto([s for s, _ in points], [e for _, e in points])
    for s, e in points:
        assert any(points[i][0] <= s and points[i][1] <= e for i in front)
    for i in front:
        for s, e in points:
            assert not (s <= points[i][0] and e <= points[i][1] and (s, e) != points[i])


@given(st.floats(-2, 3), st.floats(0.1, 10))
def test_the_exponent_of_a_power_is_found(power, factor):
    sizes = [10.0, 20.0, 40.0, 160.0]
    found, spread = exponent(sizes, [factor * size**power for size in sizes])
    assert found == pytest.approx(power, abs=1e-9)
    assert spread == pytest.approx(0, abs=1e-6)


def test_the_exponents_error_is_that_of_a_straight_line():
    # Logs x = -1, 0, 1 and y = 0, 1, 0 about their means: slope 0, residual square sum 2/3, over 1 x 2.
    found, spread = exponent([math.exp(-1), 1, math.e], [1, math.e, 1])
    assert found == pytest.approx(0, abs=1e-12)
    assert spread == pytest.approx(math.sqrt((2 / 3) / 1 / 2))


@pytest.mark.parametrize(("sizes", "values"), [([3, 3], [1, 2]), ([1, 2], [0, 1]), ([4], [2])])
def test_no_exponent_without_two_sizes_and_positive_values(sizes, values):
    with pytest.raises(ValueError, match="two sizes"):
        exponent(sizes, values)
