"""Steps in depth from horizons. Photographs are stood in for by the geometry itself: what horizons of the true heights
are, and a price that grows with the angle away from them."""

import numpy as np
import pytest

from engine.geometry import rays
from engine.light.rasterise import workers
from engine.progress import Progress
from engine.surface import steps
from engine.surface.horizons import LEVELS, compass
from engine.surface.pixels import Subject, lifted
from engine.surface.steps import HORIZONS, Told, horizons_of
from engine.surface.transport import direction_cells
from engine.surface.visibility import SECTORS, occlusion
from engine.types import Camera
from tests.engine.surface.test_horizons import photographs_under, walled

MASK = np.zeros((70, 90), bool)
MASK[4:66, 4:86] = True
PLATE = np.zeros_like(MASK)
PLATE[20:48, 30:60] = True
DISC = np.hypot(*(np.indices(MASK.shape) - np.array([35, 72])[:, None, None])) < 9
PITCH = 1 / 400


def told_of(height: np.ndarray) -> Told:
    """Pixels that know the horizons of these heights."""
    with workers() as run:
        goal = horizons_of(MASK, height, PITCH, run)
    price = 3 * np.degrees(np.abs(np.minimum(goal, HORIZONS[-1])[..., None] - HORIZONS))
    return Told(goal, np.clip(price, 0, steps.LOUDEST).astype(np.float32))


def found(height: np.ndarray, told: Told, start: np.ndarray | None = None) -> np.ndarray:
    begin = np.zeros(len(height)) if start is None else start
    return steps.lifts(MASK, height, told, PITCH, begin, Progress())


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


def test_a_pit_is_found_as_well() -> None:
    lift = np.where(PLATE, -8.0, 0.0)
    answer = found(ramp(), told_of(ramp() - lift[MASK]))
    assert np.median(answer[PLATE[MASK]]) == pytest.approx(-8, abs=1.5)


def test_without_a_step_nothing_moves() -> None:
    bump = 10 * np.exp(-(((np.indices(MASK.shape) - 35) / 14.0) ** 2).sum(0))[MASK]
    assert not found(ramp() - bump, told_of(ramp() - bump)).any()


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
    prices = np.full((*level.shape, LEVELS), 7.0, np.float32)
    prices[:, 3, 5] = 2.0
    told = steps.told(level, prices, ramp(), MASK, PITCH)
    assert (told.goal[:, 3] == HORIZONS[5]).all()
    with workers() as run:
        own = horizons_of(MASK, ramp(), PITCH, run)
    assert np.allclose(told.goal[:, 4], own[:, 4])
    assert (told.price[:, 3, 5] == 0).all()
    assert (told.price[:, 3, 4] == 5).all()


def test_lifting_keeps_the_mean_depth() -> None:
    who, _, _ = photographs_under(walled(0, 0, 0), np.random.default_rng(0))
    assert isinstance(who, Subject)
    depth = np.where(who.mask, 0.5, 0.0)
    lift = np.linspace(-0.02, 0.05, int(who.mask.sum()))
    lower = lifted(who, depth, lift, 0.5)
    assert lower[who.mask].mean() == pytest.approx(0.5)
    assert np.ptp(np.log(lower[who.mask]) + lift) == pytest.approx(0, abs=1e-12)
    assert not lower[~who.mask].any()
