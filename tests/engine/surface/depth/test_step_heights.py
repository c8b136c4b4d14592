"""Steps in depth from horizons. Photographs are stood in for by the geometry itself: what horizons of the true heights
are, and a price that grows with the angle away from them."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import rays
from engine.light.gaussians.rasterize import workers
from engine.progress import Progress
from engine.surface.depth import step_heights
from engine.surface.depth.step_heights import Told
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.horizon_search import LEVELS, beside, compass, overruled
from engine.surface.params import SurfaceParams
from engine.surface.passes import relief
from engine.surface.rendering.object_pixels import Subject, lifted, sight_of, subject
from engine.surface.rendering.transport import blocks, direction_cells, predict
from engine.surface.visibility.height_field import HORIZONS, horizons_of
from engine.surface.visibility.ray_visibility import SECTORS, occlusion
from engine.types import Camera, Frames
from tests.engine.surface.optimize.test_horizon_search import photographs_under, walled
from tests.engine.surface.rendering.test_object_pixels import light_of_lamps

MASK = np.zeros((70, 90), bool)
MASK[4:66, 4:86] = True
PLATE = np.zeros_like(MASK)
PLATE[20:48, 30:60] = True
DISC = np.hypot(*(np.indices(MASK.shape) - np.array([35, 72])[:, None, None])) < 9
PITCH = 1 / 400


EVERY = np.arange(int(MASK.sum()))


def told_of(height: np.ndarray, jitter: np.ndarray | float = 0.0) -> Told:
    """Pixels that know the horizons of these heights, or nearly."""
    with workers() as run:
        goal = horizons_of(MASK, height, PITCH, run)
    goal = np.where(goal < 3.14, np.clip(goal + jitter, 0.1, 3.1), goal).astype(np.float32)
    price = 3 * np.degrees(np.abs(np.minimum(goal, HORIZONS[-1])[..., None] - HORIZONS))
    return Told(goal, EVERY, np.clip(price, 0, step_heights.LOUDEST).astype(np.float32))


def found(height: np.ndarray, told: Told, start: np.ndarray | None = None) -> np.ndarray:
    begin = np.zeros(len(height)) if start is None else start
    return step_heights.lifts(MASK, height, told, PITCH, begin, Progress())


def ramp() -> np.ndarray:
    """Range of a slope without steps, as heights in pixels' widths."""
    rows, columns = np.nonzero(MASK)
    return 0.3 * rows + 0.1 * columns


@pytest.mark.parametrize("tall", [6.0, 14.0])
def test_plates_stand_as_high_as_their_shadows_say(tall: float) -> None:
    lift = np.where(PLATE, tall, 0.0) + np.where(DISC, tall / 2, 0.0)
    answer = found(ramp(), told_of(ramp() - lift[MASK]))
    for plate, high in ((PLATE, tall), (DISC, tall / 2)):
        core = np.isclose(lift, high)[MASK] & plate[MASK]
        assert np.median(answer[core]) == pytest.approx(high, abs=0.8)
    assert np.abs(answer - lift[MASK]).mean() < 0.1 * tall
    assert (np.abs(answer - lift[MASK]) > 1.5).mean() < 0.1


def test_regions_are_joined_across_the_faintest_edge_first() -> None:
    border, length = np.zeros((2, 4, 4))
    for one, other, closed, long in ((0, 1, 0.9, 10), (1, 2, 0.1, 40), (2, 3, 0.5, 5)):
        border[one, other] = border[other, one] = closed * long
        length[one, other] = length[other, one] = long
    found = [set(group) for group in step_heights.groups(border, length)]
    assert found == [{0}, {1}, {2}, {3}, {0, 1}, {2, 3}]


def test_a_pit_is_found_as_well() -> None:
    lift = np.where(PLATE, -8.0, 0.0)
    answer = found(ramp(), told_of(ramp() - lift[MASK]))
    assert np.median(answer[PLATE[MASK]]) == pytest.approx(-8, abs=1.5)


def test_horizons_that_are_off_move_nothing_where_no_step_is() -> None:
    bump = 10 * np.exp(-(((np.indices(MASK.shape) - 35) / 14.0) ** 2).sum(0))[MASK]
    jitter = np.random.default_rng(5).normal(0, np.radians(15), (len(EVERY), SECTORS))
    told = told_of(ramp() - bump, jitter)
    assert (np.abs(jitter) > np.radians(8)).mean() > 0.5
    assert np.abs(found(ramp() - bump, told)).max() < 1


@pytest.mark.parametrize("slope", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("way", range(SECTORS))
def test_the_horizon_of_a_slope_is_its_own_line(slope: float, way: int) -> None:
    """A plane that rises towards one sector: the cotangent is the slope along every sector."""
    rows, columns = np.nonzero(MASK)
    turn = 2 * np.pi * ((way + 0.5) / SECTORS - 0.5)
    height = -slope * (rows * np.sin(turn) + columns * np.cos(turn))
    with workers() as run:
        angle = horizons_of(MASK, height, PITCH, run)
    middle = np.nonzero((rows > 30) & (rows < 40) & (columns > 40) & (columns < 50))[0]
    along = slope * np.cos(2 * np.pi * (np.arange(SECTORS) - way) / SECTORS)
    away = np.degrees(angle[middle] - np.arctan2(1, along))
    # Pixels stand on a grid: the first ones are up to half a sector aside.
    assert np.abs(away[:, way]).max() < 5
    assert np.abs(away).max() < 18


def test_a_gap_in_the_object_hides_nothing_and_ends_nothing() -> None:
    mask = MASK.copy()
    mask[:, 50] = False
    rows, columns = np.nonzero(mask)
    height = np.where(columns > 50, -20.0, 0.0)
    with workers() as run:
        angle = horizons_of(mask, height, PITCH, run)
    beside = np.nonzero((columns == 44) & (rows == 35))[0][0]
    towards = [5, 6]  # the sectors of growing columns
    assert np.degrees(angle[beside, towards]) == pytest.approx(np.degrees(np.arctan2(7, 20)), abs=4)


def test_every_part_of_an_object_keeps_its_place() -> None:
    mask = MASK.copy()
    mask[:, 22:26] = False
    inside = mask[MASK]
    plate = PLATE[mask]
    rows, columns = np.nonzero(mask)
    with workers() as run:
        goal = horizons_of(mask, ramp()[inside] - np.where(plate, 8.0, 0.0), PITCH, run)
    price = np.clip(3 * np.degrees(np.abs(np.minimum(goal, HORIZONS[-1])[..., None] - HORIZONS)), 0, 40)
    told = Told(goal, np.arange(len(goal)), price.astype(np.float32))
    start = np.where(columns < 22, -8.0, 0.0)
    answer = step_heights.lifts(mask, ramp()[inside], told, PITCH, start, Progress())
    assert np.median(answer[columns < 22]) == 0
    assert np.median(answer[(columns > 26) & ~plate]) == 0
    assert np.median(answer[plate]) == pytest.approx(8, abs=1.5)


def test_a_step_believed_wrongly_is_taken_back() -> None:
    answer = found(ramp(), told_of(ramp()), np.where(PLATE, 9.0, 0.0)[MASK])
    assert np.abs(answer).max() < 1


def test_horizons_of_heights_are_those_that_rays_meet() -> None:
    """Against rays cast at the mesh of the same depth."""
    camera = Camera(90, 70, 400.0, 400.0, 45.0, 35.0)
    who_rays = rays(camera)
    height = ramp() - np.where(PLATE, 12.0, 0.0)[MASK]
    points = np.zeros((*MASK.shape, 3))
    points[MASK] = who_rays[MASK] * np.exp(height * PITCH)[:, None]
    normals = np.zeros_like(points)
    normals[MASK] = -who_rays[MASK]
    cells = direction_cells(2000)
    cast = occlusion(points, normals, MASK, cells, Progress())
    with workers() as run:
        angle = horizons_of(MASK, height, PITCH, run)
    rows, columns = np.nonzero(MASK)
    foot = np.nonzero((rows > 22) & (rows < 46) & (columns > 60) & (columns < 68))[0]
    away = []
    for p in foot:
        view = -who_rays[MASK][p]
        sector, _ = compass(cells, view)
        slant = np.arccos(np.clip(cells @ view, -1, 1))
        hidden = np.zeros(len(cells), bool)
        hidden[cast.direction[cast.start[p] : cast.start[p + 1]]] = True
        for s in range(SECTORS):
            there = (sector == s) & (cells @ view > -0.3)
            if (hidden & there).sum() > 3:
                away.append(slant[hidden & there].min() - angle[p, s])
    assert len(away) > 100
    assert np.degrees(np.median(np.abs(away))) < 5


def test_a_pixel_prefers_what_it_holds_and_else_what_the_depth_has() -> None:
    level = np.zeros((int(MASK.sum()), SECTORS), np.int8)
    level[:, 3] = 5
    some = step_heights.speakers(MASK)
    told = step_heights.tell(level, some, np.full((len(some), SECTORS, LEVELS), -3.0), ramp(), MASK, PITCH)
    assert np.allclose(told.goal[:, 3], HORIZONS[5])
    with workers() as run:
        own = horizons_of(MASK, ramp(), PITCH, run)
    assert np.allclose(told.goal[:, 4], own[:, 4])
    assert not told.price.any()


def test_what_the_depth_has_costs_hardly_anything_where_it_stands() -> None:
    """Else the heights of pixels that are content would creep to the middle of a ring."""
    some, level = step_heights.speakers(MASK), np.zeros((int(MASK.sum()), SECTORS), np.int8)
    level[:, 3] = 5
    with workers() as run:
        own = horizons_of(MASK, ramp(), PITCH, run)[some]
    price = 10 + 20 * np.abs(own[..., None] - HORIZONS)
    told = step_heights.tell(level, some, price, ramp(), MASK, PITCH)
    seen = own < HORIZONS[-1]
    kept = np.where(np.arange(SECTORS) == 3, False, seen)
    before, after = (
        step_heights.between(np.clip(p, 0, step_heights.LOUDEST), own)[kept] for p in (price, told.price)
    )
    assert (after < 0.2 * before).all()
    assert np.allclose(told.price[:, 3], np.clip(price[:, 3], 0, step_heights.LOUDEST))
    assert (told.price >= 0).all()


def test_between_two_levels_a_horizon_costs_in_proportion() -> None:
    price = np.arange(float(LEVELS))[None, None] ** 2
    angle = HORIZONS[4] + 0.25 * (HORIZONS[5] - HORIZONS[4])
    for at, cost in (
        (HORIZONS[4], 16.0),
        (angle, 0.75 * 16 + 0.25 * 25),
        (0.0, 1.0),
        (3.0, (LEVELS - 1.0) ** 2),
    ):
        assert step_heights.between(price, np.full((1, 1), at)) == pytest.approx(cost)


def test_relief_finds_the_wall_that_throws_a_shadow() -> None:
    """Pixels of a plane that hold the horizons of a plate on it: the plate comes nearer, normals stay."""
    camera = Camera(90, 70, 400.0, 400.0, 45.0, 35.0)
    light = light_of_lamps(np.random.default_rng(1), 8, 300)
    count, cells = int(MASK.sum()), light.directions
    normals, depth = np.tile([0.0, 0.0, -1.0], (count, 1)), np.where(MASK, 0.5, 0.0)
    picture = np.zeros((8, *MASK.shape, 3), np.float32)
    nothing = np.zeros(picture.shape[:3], bool)
    frames = Frames(tuple("abcdefgh"), picture + 0.1, nothing, nothing, (1e-6, 1e-6))
    params = SurfaceParams(directions=300, bounce=False)
    who = subject(frames, MASK, camera, np.arange(8), params)
    range_ = np.log(np.linalg.norm(who.flat(0.5).points, axis=1)) / who.pitch
    with workers() as run:
        goal = horizons_of(MASK, range_ - np.where(PLATE, 12.0, 0.0)[MASK], who.pitch, run)
    level = np.abs(np.minimum(goal, HORIZONS[-1])[..., None] - HORIZONS[1:]).argmin(2) + 1
    free = gauss_newton.begin(normals, np.full((count, 3), 0.4), np.full(count, 0.5))
    sight = sight_of(who, free, depth, cells, params, Progress())
    # The photographs are those under these very horizons.
    parts = blocks(MASK)
    seeing = overruled(sight, level, normals, parts, cells, beside(MASK))
    for pixels, answer in predict(
        who.responses(light, params, "cpu"), seeing, parts, normals, free.albedo, free.roughness
    ):
        rows = np.argwhere(MASK)[pixels]
        picture[:, rows[:, 0], rows[:, 1]] = answer.transpose(1, 0, 2)
    frames = Frames(frames.names, picture, nothing, nothing, frames.noise)
    who = subject(frames, MASK, camera, np.arange(8), params)
    state = gauss_newton.begin(normals, free.albedo, free.roughness, level.astype(np.int8))
    state = gauss_newton.respread(state, who.responses(light, params, "cpu"), seeing, parts, who.seen)
    found, lower = relief(who, state, light, sight, 0.5, params, Progress())
    plate, base = found.lift[PLATE[MASK]] / who.pitch, found.lift[~(PLATE | DISC)[MASK]] / who.pitch
    assert np.median(plate) == pytest.approx(12, abs=3)
    assert np.median(base) == pytest.approx(0, abs=0.5)
    nearer = np.median(lower[MASK & ~PLATE]) / np.median(lower[PLATE]) - 1
    assert nearer == pytest.approx(12 * who.pitch, rel=0.3)
    same, flat = relief(who, state, light, sight, 0.5, replace(params, steps=False), Progress())
    assert not same.lift.any()
    assert flat[MASK] == pytest.approx(0.5, rel=1e-3)


def test_lifting_keeps_the_mean_depth() -> None:
    who, _, _ = photographs_under(walled(0, 0, 0), np.random.default_rng(0))
    assert isinstance(who, Subject)
    depth = np.where(who.mask, 0.5, 0.0)
    lift = np.linspace(-0.02, 0.05, int(who.mask.sum()))
    lower = lifted(who.mask, depth, lift, 0.5)
    assert lower[who.mask].mean() == pytest.approx(0.5)
    assert np.ptp(np.log(lower[who.mask]) + lift) == pytest.approx(0, abs=1e-12)
    assert not lower[~who.mask].any()
