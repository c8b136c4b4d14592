"""Horizons of planes, walls and whatever heights, against geometry and central differences."""

import numpy as np
import pytest

from engine.geometry import rays
from engine.surface.clearance import AZIMUTHS, Ground, Rims
from engine.surface.transport import direction_cells
from engine.types import Camera

CAMERA = Camera(60, 50, 300.0, 300.0, 31.0, 24.0)
MASK = np.zeros((50, 60), bool)
MASK[4:46, 5:55] = True
PIXELS = np.arange(int(MASK.sum()))
RAYS = rays(CAMERA)[MASK]
AT = RAYS / RAYS[:, 2:]


def plane(normal: np.ndarray, distance: float = 0.5) -> np.ndarray:
    """Log heights of a plane through the axis at `distance`."""
    return np.log(distance * normal[2] / (AT @ normal))


def rims(height: np.ndarray, pixels: np.ndarray = PIXELS) -> Rims:
    return Ground(CAMERA, MASK).rims(height, pixels)


def pixel_at(row: int, column: int) -> int:
    return int(np.nonzero((np.nonzero(MASK)[0] == row) & (np.nonzero(MASK)[1] == column))[0][0])


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.5, 0.0), (-0.3, 0.6)])
def test_a_plane_hides_what_is_behind_it_and_nothing_else(lean: tuple[float, float]) -> None:
    normal = np.array([*lean, -1.0]) / np.linalg.norm([*lean, 1])
    ground, cells = Ground(CAMERA, MASK), direction_cells(300)
    middle = PIXELS[pixel_at(25, 30)][None]
    way, angle = ground.seen(middle, cells)
    clear = ground.rims(plane(normal), middle).angle[0, way] - angle[0]
    above = cells @ normal
    assert (clear[above > 0.05] > 0).all()
    assert (clear[above < -0.05] < 0).all()
    # At a plane that faces the camera a horizon is the plane's own angle.
    if not any(lean):
        assert clear == pytest.approx(np.pi / 2 - angle[0], abs=0.02)


def test_the_rim_of_a_wall_is_the_horizon() -> None:
    """Columns from 30 on stand nearer by a hundredth of a metre."""
    z = np.where(np.nonzero(MASK)[1] >= 30, 0.49, 0.5)
    pixel = pixel_at(24, 20)
    rim = AT[pixel + 10] * 0.49 - AT[pixel] * 0.5
    expected = np.arccos(-(rim @ AT[pixel]) / (np.linalg.norm(rim) * np.linalg.norm(AT[pixel])))
    found = rims(np.log(z), np.array([pixel]))
    assert found.angle[0, 0] == pytest.approx(expected, abs=1e-6)
    assert found.first[0, 0] == pixel + 10
    # Up the columns nothing rises.
    assert found.angle[0, AZIMUTHS // 4] == pytest.approx(np.pi / 2, abs=0.02)


def test_off_the_object_nothing_stands() -> None:
    corner = np.array([pixel_at(4, 5)])
    found = rims(plane(np.array([0.0, 0.0, -1.0])), corner)
    out = AZIMUTHS * 5 // 8  # up and to the left
    assert found.angle[0, out] == pytest.approx(np.pi)
    assert found.first[0, out] == -1
    pull = found.pull(np.ones((1, AZIMUTHS)) * (np.arange(AZIMUTHS) == out), corner, len(PIXELS))
    assert not pull.any()


def test_the_pull_is_the_slope_of_the_horizons() -> None:
    random = np.random.default_rng(5)
    v, u = np.nonzero(MASK)
    hill = 0.5 - 0.02 * np.exp(-((v - 20) ** 2 + (u - 25) ** 2) / 60)
    height = np.log(hill) + random.normal(0, 2e-4, len(PIXELS))
    found = rims(height)
    weight = random.normal(size=found.angle.shape) * (found.first >= 0)
    step = 1e-7 * random.normal(size=len(PIXELS))
    ahead, behind = (rims(height + sign * step) for sign in (1, -1))
    # Where another pixel takes over as the nearest, there is no slope.
    for other in (ahead, behind):
        weight *= (other.first == found.first) & (other.second == found.second)
    assert (weight != 0).mean() > 0.8
    rise = (weight * (ahead.angle - behind.angle)).sum() / 2
    assert found.pull(weight, PIXELS, len(PIXELS)) @ step == pytest.approx(rise, rel=1e-3)


def test_an_object_nearer_as_a_whole_has_the_same_horizons() -> None:
    v, u = np.nonzero(MASK)
    height = np.log(0.5 - 0.01 * np.sin(u / 4.0) * np.cos(v / 5.0))
    one, other = rims(height), rims(height + 0.3)
    np.testing.assert_allclose(one.angle, other.angle, atol=1e-9)
    assert one.pull(np.ones(one.angle.shape), PIXELS, len(PIXELS)).sum() == pytest.approx(0, abs=1e-6)
