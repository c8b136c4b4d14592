"""What stands before planes, walls, wires and whatever heights, against geometry and central differences."""

import numpy as np
import pytest

from engine.geometry import rays
from engine.surface.rendering.transport import direction_cells
from engine.surface.visibility.horizon_map import AZIMUTHS, Ground, Rims
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


SOLID = np.full(len(PIXELS), 3.0)
"""Deeper than anything stands."""


def rims(height: np.ndarray, pixels: np.ndarray = PIXELS, deep: np.ndarray = SOLID) -> Rims:
    return Ground(CAMERA, MASK).rims(height, deep, pixels)


def pixel_at(row: int, column: int) -> int:
    return int(np.nonzero((np.nonzero(MASK)[0] == row) & (np.nonzero(MASK)[1] == column))[0][0])


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.5, 0.0), (-0.3, 0.6)])
def test_a_plane_hides_what_is_behind_it_and_nothing_else(lean: tuple[float, float]) -> None:
    normal = np.array([*lean, -1.0]) / np.linalg.norm([*lean, 1])
    ground, cells = Ground(CAMERA, MASK), direction_cells(300)
    middle = PIXELS[pixel_at(25, 30)][None]
    way, angle = ground.seen(middle, cells)
    clear = ground.rims(plane(normal), SOLID, middle).angle[0, way, 0, 0] - angle[0]
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
    assert found.angle[0, 0, 0, 0] == pytest.approx(expected, abs=1e-6)
    assert found.first[0, 0, 0, 0] == pixel + 10
    # Up the columns nothing rises.
    assert found.angle[0, AZIMUTHS // 4, 0, 0] == pytest.approx(np.pi / 2, abs=0.02)


def test_off_the_object_nothing_stands() -> None:
    corner = np.array([pixel_at(4, 5)])
    found = rims(plane(np.array([0.0, 0.0, -1.0])), corner)
    out = AZIMUTHS * 5 // 8  # up and to the left
    assert found.angle[0, out] == pytest.approx(np.pi)
    assert (found.first[0, out] == -1).all()
    weight = np.zeros(found.angle.shape)
    weight[0, out] = 1
    assert not found.pull(weight, corner, len(PIXELS)).any()


def wire(z: float = 0.4) -> np.ndarray:
    """Depth of a plate with a wire of four columns before it."""
    u = np.nonzero(MASK)[1]
    return np.where((u >= 30) & (u < 34), z, 0.5)


def test_a_wire_hides_an_interval_and_the_plate_behind_it_the_rest() -> None:
    """From its near edge in front to its far edge's back, seen from the plate."""
    pixel, thick = pixel_at(24, 20), 0.01
    deep = np.where(wire() < 0.5, np.log(1 + thick / 0.4), 3.0)
    found = rims(np.log(wire()), np.array([pixel]), deep)

    def to(column: int, z: float) -> float:
        way = AT[pixel_at(24, column)] * z - AT[pixel] * 0.5
        return float(np.arccos(-(way @ AT[pixel]) / np.linalg.norm(way) / np.linalg.norm(AT[pixel])))

    pieces = found.angle[0, 0][found.first[0, 0, :, 0] >= 0]
    assert len(pieces) == 2
    hanging, ground = sorted(pieces.tolist())
    assert hanging == pytest.approx([to(30, 0.4), to(33, 0.4 + thick)], abs=1e-6)
    assert ground[0] == pytest.approx(np.pi / 2, abs=0.05)
    # Just over the plate, light comes in beneath the wire.
    assert hanging[1] < np.radians(60)


def test_what_stands_on_the_plate_is_one_piece_with_it() -> None:
    """As deep as it stands high, so that nothing comes in behind it."""
    deep = np.where(wire(0.48) < 0.5, np.log(0.5 / 0.48), 3.0)
    found = rims(np.log(wire(0.48)), np.array([pixel_at(24, 20)]), deep)
    assert (found.first[0, 0, :, 0] >= 0).sum() == 1


@pytest.mark.parametrize("thin", [False, True])
def test_the_pull_is_the_slope_of_the_ends(thin: bool) -> None:
    random = np.random.default_rng(5)
    v, u = np.nonzero(MASK)
    hill = 0.5 - 0.02 * np.exp(-((v - 20) ** 2 + (u - 25) ** 2) / 60)
    height = np.log(wire() if thin else hill) + random.normal(0, 2e-4, len(PIXELS))
    deep = np.where(wire() < 0.5, 0.02, 0.3) if thin else SOLID

    def rims(height: np.ndarray) -> Rims:
        return Ground(CAMERA, MASK).rims(height, deep, PIXELS)

    found = rims(height)
    weight = random.normal(size=found.angle.shape) * (found.first >= 0)
    step = 1e-7 * random.normal(size=len(PIXELS))
    ahead, behind = (rims(height + sign * step) for sign in (1, -1))
    # Where another pixel takes over as the nearest, there is no slope.
    for other in (ahead, behind):
        weight *= (other.first == found.first) & (other.second == found.second)
    assert (weight != 0).sum() > 0.8 * (found.first >= 0).sum()
    rise = (weight * (ahead.angle - behind.angle)).sum() / 2
    assert found.pull(weight, PIXELS, len(PIXELS)) @ step == pytest.approx(rise, rel=1e-3)


def test_an_object_nearer_as_a_whole_has_the_same_horizons() -> None:
    v, u = np.nonzero(MASK)
    height = np.log(0.5 - 0.01 * np.sin(u / 4.0) * np.cos(v / 5.0))
    one, other = rims(height), rims(height + 0.3)
    np.testing.assert_allclose(one.angle, other.angle, atol=1e-9)
    assert one.pull(np.ones(one.angle.shape), PIXELS, len(PIXELS)).sum() == pytest.approx(0, abs=1e-6)
