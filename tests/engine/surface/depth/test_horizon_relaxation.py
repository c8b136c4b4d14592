"""Heights that relax until their horizons suit. Photographs are stood in for by the geometry, as in `test_step_heights`."""

import numpy as np
import pytest

from engine.light.gaussians.rasterize import workers
from engine.progress import Progress
from engine.surface.depth.horizon_relaxation import _without_needles, relaxed
from engine.surface.depth.step_heights import Told
from engine.surface.visibility.height_field import HORIZONS, Field
from tests.engine.surface.depth.test_step_heights import EVERY, MASK, PITCH, PLATE, ramp, told_of

DOME = 12 * np.exp(-(((np.indices(MASK.shape) - np.array([35, 45])[:, None, None]) / 12.0) ** 2).sum(0))


def found(height: np.ndarray, told: Told, start: np.ndarray | None = None) -> np.ndarray:
    lift = relaxed(MASK, height, told, PITCH, np.zeros(len(height)) if start is None else start, Progress())
    return lift - np.median(lift)


def test_what_integration_flattened_rises_again() -> None:
    """A dome of which normals tell 60 % of the height, as where its foot is torn."""
    true, flat = ramp() - DOME[MASK], ramp() - 0.6 * DOME[MASK]
    answer = found(flat, told_of(true))
    before, after = 0.4 * DOME[MASK], 0.4 * DOME[MASK] - answer
    assert np.sqrt((after**2).mean()) < 0.4 * np.sqrt((before**2).mean())
    assert answer[np.argmax(DOME[MASK])] == pytest.approx(0.4 * 12, abs=1.5)


def test_a_low_step_rises_as_one_piece() -> None:
    lift = np.where(PLATE, 3.0, 0.0)[MASK]
    answer = found(ramp(), told_of(ramp() - lift))
    inner = np.zeros_like(MASK)
    inner[24:44, 34:56] = True
    assert answer[inner[MASK]] == pytest.approx(3, abs=0.7)
    assert np.abs(answer[~PLATE[MASK]]).mean() < 0.4


def test_heights_whose_horizons_suit_stay() -> None:
    height = ramp() - DOME[MASK]
    told = told_of(height)
    # Corners, where few others stand by, follow the rings.
    assert np.sqrt((found(height, told) ** 2).mean()) < 0.3
    mistaken = found(height, told, 0.3 * DOME[MASK])
    assert np.sqrt((mistaken**2).mean()) < 0.4 * np.sqrt(((0.3 * DOME[MASK]) ** 2).mean())


def test_a_needle_goes_and_a_step_stays() -> None:
    lift = np.where(PLATE, 3.0, 0.0)
    needles = lift.copy()
    needles[5::2, 5::2] += 2.5
    found = np.zeros(MASK.shape)
    found[MASK] = _without_needles(needles[MASK], MASK)
    edge = np.zeros_like(MASK)
    for axis in (0, 1):
        for way in (-1, 1):
            edge |= np.roll(PLATE, way, axis) != PLATE
    assert np.array_equal(found[MASK & ~edge], lift[MASK & ~edge])
    assert set(np.unique(found[MASK])) <= {0.0, 2.5, 3.0, 5.5}


def test_who_has_no_say_moves_nothing() -> None:
    nobody = Told(told_of(ramp()).goal, EVERY[:0], np.zeros((0, 12, len(HORIZONS)), np.float32))
    start = np.where(PLATE, 2.0, 0.0)[MASK]
    assert np.array_equal(relaxed(MASK, ramp(), nobody, PITCH, start, Progress()), start)


def test_the_slope_is_that_of_the_cost() -> None:
    """By central differences along it."""
    random = np.random.default_rng(3)
    height = ramp() - DOME[MASK] + random.normal(0, 0.2, len(EVERY))
    liked = random.uniform(0.5, 2.0, (len(EVERY), 12, 1))
    price = (20 * (HORIZONS - liked) ** 2).astype(np.float32)
    field = Field(MASK, height, PITCH, np.zeros(len(height), int))
    with workers() as run:
        _, slope = field.uphill(height, EVERY, price, run)
        steep = float(np.linalg.norm(slope))
        up, down = (
            field.uphill(height + step * slope / steep, EVERY, price, run)[0] for step in (1e-3, -1e-3)
        )
    assert (up - down) / 2e-3 == pytest.approx(steep, rel=0.02)
