"""Some of many."""

import numpy as np
import pytest

from engine.sampling import evenly_spaced, held_out


def test_fewer_views_are_spread_evenly_over_all():
    assert evenly_spaced(10, 4).tolist() == [0, 3, 6, 9]
    assert evenly_spaced(5, 8).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("views", "expected"), [(48, 4), (31, 3), (12, 1), (9, 1), (8, 0)])
def test_few_views_all_serve_the_fit(views: int, expected: int):
    """Of 12 views four were kept out once, and eight are too few."""
    registered = np.ones(views + 2, bool)
    registered[[1, 4]] = False
    fitted, kept_out = held_out(registered, 4)
    assert len(kept_out) == expected
    assert sorted([*fitted, *kept_out]) == np.nonzero(registered)[0].tolist()
