"""Some of many."""

import numpy as np

from engine.sampling import evenly_spaced


def test_fewer_views_are_spread_evenly_over_all():
    assert evenly_spaced(np.arange(10, 20), 4).tolist() == [10, 13, 16, 19]
    assert evenly_spaced(np.arange(5), 8).tolist() == [0, 1, 2, 3, 4]
