"""Some of many."""

from engine.sampling import evenly_spaced


def test_fewer_views_are_spread_evenly_over_all():
    assert evenly_spaced(10, 4).tolist() == [0, 3, 6, 9]
    assert evenly_spaced(5, 8).tolist() == [0, 1, 2, 3, 4]
