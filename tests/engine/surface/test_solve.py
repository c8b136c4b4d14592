"""Which views serve a solve, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from engine.errors import SurfaceError
from engine.progress import Progress
from engine.surface.observations import thinned
from engine.surface.pixels import SurfaceParams
from engine.surface.solve import solve
from tests.engine.reference.lit_room import lambert, scene


def test_fewer_views_are_spread_evenly_over_all():
    assert thinned(np.arange(10, 20), 4).tolist() == [10, 13, 16, 19]
    assert thinned(np.arange(5), 8).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("changes", [{"rough_views": 7}, {"rough_views": 0}, {"views": 3}])
def test_too_few_views_are_refused(changes: dict[str, int]):
    (name,) = changes
    params = replace(SurfaceParams(), **changes)
    with pytest.raises(SurfaceError, match=rf"surface\.{name} is {changes[name]}; give 8 or more"):
        solve(*scene(lambert).given, params, "cpu", 0, Progress())
