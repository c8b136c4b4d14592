"""Doubt about horizons: where they stand, how far they are off, and what follows for a pixel, against answers worked out anew."""

from dataclasses import replace

import numpy as np

from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.horizon_search import LEVELS, beside, compass, overruled
from engine.surface.rendering.transport import Sight, blocks
from engine.surface.uncertainty.horizon_uncertainty import Misplaced, misplaced, standing
from engine.surface.visibility.ray_visibility import SECTORS
from tests.engine.surface.optimize.test_horizon_search import (
    COUNT,
    MASK,
    NOTHING,
    PARAMS,
    facing,
    inner,
    photographs_under,
    walled,
)

PARTS = blocks(MASK)


def levels_of(sight: Sight, normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """What `standing` says of all pixels, block by block."""
    level = np.zeros((COUNT, SECTORS), int)
    for block in PARTS:
        around = compass(directions, sight.middle(block))
        level[block] = standing(sight, block, normals[block], directions, around)
    return level


def test_a_horizon_is_read_from_what_it_hides():
    who, light, state = photographs_under(walled(0, 0, 0), np.random.default_rng(0))
    level = walled(2, 5, 3)
    sight = overruled(facing(NOTHING), level, state.normals, PARTS, light.directions, beside(MASK))
    told = levels_of(sight, state.normals, light.directions)
    assert (told[:, 2:5] == 3).all()
    # What lies beneath the pixel's own plane is not hidden by anything, whatever the level.
    assert (told[:, :2] == LEVELS - 1).all()
    assert (told[:, 5:] == LEVELS - 1).all()
    one_less = overruled(
        facing(NOTHING), level - (level > 0), state.normals, PARTS, light.directions, beside(MASK)
    )
    assert (levels_of(one_less, state.normals, light.directions)[:, 2:5] == 2).all()


def test_what_is_overruled_speaks_for_those_around_it():
    who, light, state = photographs_under(walled(0, 0, 0), np.random.default_rng(0))
    aside, depth = beside(MASK), facing(NOTHING)
    level = walled(2, 3, 4)
    left = np.argwhere(MASK)[:, 1] < 8
    level[~left] = 0
    seeing = overruled(depth, level, state.normals, PARTS, light.directions, aside)
    assert misplaced(depth, seeing, state, MASK, light.directions, Progress()) is None
    found = misplaced(depth, seeing, replace(state, level=level), MASK, light.directions, Progress())
    assert found is not None
    # One sector of all, which the depth leaves open.
    off = (LEVELS - 1 - 4) ** 2 / SECTORS
    columns = np.argwhere(MASK)[:, 1]
    np.testing.assert_allclose(found.square[columns == 4], off)
    np.testing.assert_allclose(found.square[columns == 7], off * 4 / 7)
    assert (found.square[columns > 10] < 1e-12).all()


def test_a_pixel_varies_as_its_answer_does_under_other_horizons():
    wall = walled(3, 4, 4)
    who, light, state = photographs_under(wall, np.random.default_rng(1))
    aside, depth = beside(MASK), facing(NOTHING)
    responses = who.responses(light, PARAMS, "cpu")

    def under(level: int, start: gauss_newton.State, passes: int) -> gauss_newton.State:
        sight = overruled(depth, walled(3, 4, level), start.normals, PARTS, light.directions, aside)
        return gauss_newton.iterate(start, responses, sight, PARTS, who.seen, passes, Progress(), anew=True)

    settled = under(4, state, 12)
    nearer, farther = (under(level, settled, 30) for level in (3, 5))
    half = np.arccos(np.clip((nearer.normals * farther.normals).sum(1), -1, 1)) / 2
    sight = overruled(depth, wall, settled.normals, PARTS, light.directions, aside)
    doubt = Misplaced(np.ones(COUNT), aside)
    variance = doubt.variance(settled, responses, sight, PARTS, who.seen, Progress())
    told = np.sqrt(variance[:, 0] + variance[:, 1])[inner()]
    assert np.median(half[inner()]) > np.radians(0.25)
    assert 0.6 < np.median(told / half[inner()]) < 1.5
    none = Misplaced(np.zeros(COUNT), aside).variance(settled, responses, sight, PARTS, who.seen, Progress())
    assert not none.any()
