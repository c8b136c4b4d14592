"""Horizons from photographs: a wall that the depth does not know, found by the shadow it throws.

Own pictures again: what is tested is the search, its thrift, and the bookkeeping.
"""

import copy
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.optimize import gauss_newton, horizon_search
from engine.surface.optimize.horizon_search import LEVELS, RINGS, beside, compass, overruled
from engine.surface.optimize.neighbour_propagation import ask, dissent, prices
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import as_photographed, subject
from engine.surface.rendering.transport import Responses, Sight, blocks, direction_cells, predict
from engine.surface.visibility.ray_visibility import SECTORS, Occlusion
from engine.types import Camera, Frames
from tests.engine import kept
from tests.engine.surface.rendering.test_object_pixels import light_of_lamps

CAMERA = Camera(24, 16, 60.0, 60.0, 12.0, 8.0)
MASK = np.zeros((16, 24), bool)
MASK[3:13, 4:20] = True
COUNT, VIEWS, CELLS = int(MASK.sum()), 32, 500
PARAMS = SurfaceParams(directions=CELLS, bounce=False)
NOTHING = Occlusion(
    np.zeros(COUNT + 1, np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(COUNT, np.float32)
)


def facing(occlusion: Occlusion | None) -> Sight:
    r = rays(CAMERA)[MASK]
    return Sight(r / r[:, 2:] * 0.5, -r, occlusion)


def walled(first: int, last: int, level: int) -> np.ndarray:
    levels = np.zeros((COUNT, SECTORS), np.int8)
    levels[:, first:last] = level
    return levels


def inner() -> np.ndarray:
    """Pixels that are not on the rim."""
    rows, columns = np.argwhere(MASK).T
    return (rows > 3) & (rows < 12) & (columns > 4) & (columns < 19)


def photographs_under(levels: np.ndarray, rng: np.random.Generator):
    """A plane that looks at the camera, under the horizons given; its subject, light and true state."""
    light = light_of_lamps(rng, VIEWS, CELLS)
    normals = np.tile([0.0, 0.0, -1.0], (COUNT, 1))
    albedo, roughness = np.tile([0.5, 0.4, 0.3], (COUNT, 1)), np.full(COUNT, 0.5)
    parts = blocks(MASK)
    sight = overruled(facing(NOTHING), levels, normals, parts, light.directions, beside(MASK))
    responses = Responses(light, np.zeros((COUNT, 3 * VIEWS), np.float32), True, False, "cpu")
    radiance = np.zeros((VIEWS, *MASK.shape, 3), np.float32)
    for pixels, answer in predict(responses, sight, parts, normals, albedo, roughness):
        rows = np.argwhere(MASK)[pixels]
        radiance[:, rows[:, 0], rows[:, 1]] = answer.transpose(1, 0, 2)
    radiance *= 1 + rng.normal(0, 0.01, radiance.shape).astype(np.float32)
    blank = np.zeros(radiance.shape[:3], bool)
    frames = Frames(tuple(map(str, range(VIEWS))), radiance, blank, blank, (1e-6, 1e-6))
    who = subject(frames, MASK, CAMERA, np.arange(VIEWS), PARAMS)
    state = gauss_newton.begin(normals, albedo, roughness)
    return (
        who,
        light,
        gauss_newton.respread(state, who.responses(light, PARAMS, "cpu"), facing(NOTHING), parts, who.seen),
    )


def test_sectors_and_rings_part_the_sphere_around_the_viewing_ray():
    directions, view = direction_cells(4000), np.array([0.2, -0.1, -1.0]) / np.linalg.norm([0.2, -0.1, -1.0])
    sector, ring = compass(directions, view)
    assert sorted(np.unique(sector)) == list(range(SECTORS))
    assert np.bincount(sector).std() < 0.05 * len(directions) / SECTORS
    angle = np.arccos(directions @ view)
    assert (angle[ring == 0] <= RINGS[0]).all()
    assert (angle[ring == LEVELS - 2] > RINGS[-1]).all()


def test_a_level_hides_its_rings_and_zero_leaves_the_depth_its_say():
    directions, sight = direction_cells(CELLS), facing(NOTHING)
    known = Occlusion(
        np.arange(COUNT + 1), np.zeros(COUNT, np.int32), np.full(COUNT, 7, np.int32), sight.points[:, 0]
    )
    parts, aside = blocks(MASK), beside(MASK)
    normals = np.random.default_rng(0).normal([0.0, 0.0, -1.0], 0.5, (COUNT, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert overruled(facing(known), walled(0, 0, 0), normals, parts, directions, aside).occlusion is known
    found = overruled(facing(known), walled(2, 5, 3), normals, parts, directions, aside).occlusion
    assert found is not None
    for pixels in parts:
        view = sight.views[pixels].mean(0)
        sector, ring = compass(directions, view / np.linalg.norm(view))
        ruled = (sector >= 2) & (sector < 5)
        wanted = np.where(ruled, ring >= 3, np.arange(CELLS) == 0)
        _, hidden, source = found.of(pixels[:1])
        np.testing.assert_array_equal(hidden, np.nonzero(wanted)[0])
        stands = aside[pixels[0]][sector]
        # Who looks away is not what is seen there.
        stands = np.where((normals[stands] * directions).sum(1) < 0, stands, -1)
        stands[0] = 7  # what the depth has in the way is what was photographed there
        np.testing.assert_array_equal(source, stands[hidden])
    up = directions @ normals[0]
    assert found.share[0] == pytest.approx(
        np.maximum(up[found.direction[: found.start[1]]], 0).sum() / np.maximum(up, 0).sum(), abs=1e-3
    )


def test_a_wall_that_the_depth_does_not_know_is_found_by_its_shadow():
    wall = walled(3, 7, 3)
    foot = np.argwhere(MASK)[:, 1] > 13
    wall[~foot] = 0
    who, light, state = photographs_under(wall, np.random.default_rng(0))
    found = ask(who, state, light, facing(NOTHING), PARAMS, Progress())
    right = np.abs(found.level - np.where(wall == 0, LEVELS - 1, wall)) <= 1
    right |= (found.level == 0) & (wall == 0)
    # Three of the four sectors: no lamp crossed the horizon in the first.
    assert right[foot & inner()][:, 3:7].mean() > 0.7
    assert right[inner()].mean() > 0.8
    assert np.median(np.abs(found.albedo - [0.5, 0.4, 0.3])[foot & inner()]) < 0.02
    seen = as_photographed(who, found, facing(NOTHING), light.directions)
    after = gauss_newton.respread(found, who.responses(light, PARAMS, "cpu"), seen, blocks(MASK), who.seen)
    assert np.median(after.spread[foot & inner()]) < 0.5 * np.median(state.spread[foot & inner()])


def test_where_nothing_is_hidden_hardly_a_horizon_leaves_the_depth():
    who, light, state = photographs_under(walled(0, 0, 0), np.random.default_rng(1))
    found = ask(who, state, light, facing(NOTHING), PARAMS, Progress())
    assert (found.level != 0).mean() < 0.1


def test_horizons_can_be_left_to_the_depth():
    who, light, state = photographs_under(walled(3, 7, 3), np.random.default_rng(2))
    params = SurfaceParams(directions=CELLS, bounce=False, horizons=False)
    assert not ask(who, state, light, facing(NOTHING), params, Progress()).level.any()


def test_the_horizon_that_is_there_costs_least() -> None:
    first, last, level = 2, 4, 6
    who, light, state = photographs_under(walled(first, last, level), np.random.default_rng(3))
    cost = prices(who, state, light, facing(NOTHING), np.arange(COUNT), PARAMS, Progress())
    assert not cost[~inner()].any()
    assert np.abs(cost[:, :, 0]).max() < 0.01  # what is held: nothing, but for rounding
    walled_off = cost[inner()][:, first:last]
    assert (walled_off[:, :, level] < 0).mean() > 0.9
    assert np.median(np.abs(walled_off.argmin(2) - level)) <= 1
    open_ = np.delete(cost[inner()], np.s_[first:last], axis=1)
    assert (open_.min((1, 2)) > walled_off.min((1, 2))).mean() > 0.95
    few = np.array([40, 41, 90])
    some = prices(who, state, light, facing(NOTHING), few, PARAMS, Progress())
    np.testing.assert_array_equal(some, cost[few])


def test_an_answer_unlike_all_neighbours_dissents_and_one_like_them_does_not() -> None:
    state = gauss_newton.begin(np.tile([0.0, 0.0, -1.0], (4, 1)), np.full((4, 3), 0.3), np.full(4, 0.5))
    others = np.array([[1, 2], [2, 3]])
    mine, all_ = (state.normals[:2], state.albedo[:2]), np.ones((2, 2), bool)
    assert dissent(*mine, state, others, all_) == pytest.approx([0, 0], abs=1e-12)
    aside, other = np.tile([1.0, 0.0, 0.0], (2, 1)), np.full((2, 3), 0.01)
    assert (dissent(aside, mine[1], state, others, all_) > 0.9).all()
    assert (dissent(aside, other, state, others, all_) > 1.8).all()
    assert not dissent(aside, other, state, others, ~all_).any()


def test_beside_is_a_pixel_of_the_object_that_way():
    aside = beside(MASK)
    row, column = np.argwhere(MASK).T
    turn = 2 * np.pi * ((np.arange(SECTORS) + 0.5) / SECTORS - 0.5)
    moved = column[aside] - column[:, None], row[aside] - row[:, None]
    assert (moved[0] * np.cos(turn) + moved[1] * np.sin(turn) >= 0).all()
    middle = (row == 8) & (column == 12)
    assert np.hypot(*(m[middle] for m in moved)).min() > 3


def questions() -> list[tuple]:
    """What `explain` is asked about walled planes; what is left over of a vector's width is where roundings part, but not only."""
    asked: list[tuple] = []
    explain = horizon_search.explain

    def noted(*args):
        asked.append(copy.deepcopy(args))
        return explain(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(horizon_search, "explain", noted)
        for count in (45, 48):
            patch.setattr(sys.modules[__name__], "VIEWS", count)
            for shown in (False, True):
                who, light, state = photographs_under(walled(2, 5, 3), np.random.default_rng(0))
                ask(who, state, light, facing(NOTHING), replace(PARAMS, bounce=shown), Progress())
    return asked


def test_kernels_compiled_now_and_kernels_kept_from_before_give_the_same_bits(tmp_path: Path) -> None:
    asked, cache = tmp_path / "asked", tmp_path / "cache"
    asked.write_bytes(pickle.dumps(questions()))
    compiled = kept.answer(__name__, cache, asked)
    assert any(cache.rglob("*.nbc"))
    assert kept.answer(__name__, cache, asked) == compiled


if __name__ == "__main__":
    answers = [
        x for args in pickle.loads(Path(sys.argv[1]).read_bytes()) for x in horizon_search.explain(*args)
    ]
    kept.tell(*answers)
