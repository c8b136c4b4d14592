"""Where light is gathered: thirteen points tell every probe of a lattice around an object."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import fibonacci_sphere
from engine.light.incident.probes import gather_probes
from engine.surface.lighting.quadratic_probes import quadratic_probes
from engine.surface.rendering.transport import ProbeGrid, direction_cells
from tests.engine.light import clouds

BOX = np.array([-0.2, -0.3, 0.4]), np.array([0.25, 0.2, 0.6])
RNG = np.random.default_rng(0)


def placed(lattice: ProbeGrid, points: np.ndarray) -> np.ndarray:
    """Where in the lattice's box points are, in its own coordinates."""
    at = np.stack([points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], np.log(points[:, 2])], 1)
    low, high = (np.append(x[:2], np.log(x[2])) for x in (lattice.low, lattice.high))
    return (at - low) / (high - low)


@pytest.mark.parametrize("shape", [(3, 3, 3), (3, 4, 2), (4, 4, 4)])
def test_light_that_is_quadratic_in_the_place_is_told_exactly(shape: tuple[int, int, int]) -> None:
    lattice, curve, slope = ProbeGrid(*BOX, shape), RNG.normal(size=(3, 3)), RNG.normal(size=3)

    def light(points: np.ndarray) -> np.ndarray:
        at = placed(lattice, points)
        return (1 + at @ slope + np.einsum("pi,ij,pj->p", at, curve, at))[:, None, None] * np.ones((1, 2, 3))

    asked = quadratic_probes(lattice)
    assert len(asked.points) == 13
    np.testing.assert_allclose(asked.everywhere(light(asked.points)), light(lattice.points()), atol=1e-9)


@pytest.mark.parametrize("shape", [(1, 1, 9), (2, 2, 2), (3, 2, 2), (5, 5, 1), (3, 3, 5)])
def test_where_it_would_tell_less_every_probe_is_asked(shape: tuple[int, int, int]) -> None:
    lattice = ProbeGrid(*BOX, shape)
    asked, energy = quadratic_probes(lattice), RNG.normal(size=(int(np.prod(shape)), 4, 6))
    np.testing.assert_array_equal(asked.points, lattice.points())
    assert asked.everywhere(energy) is energy


def test_a_direction_belongs_to_the_brightest_of_the_points_beside_a_probe() -> None:
    lattice = ProbeGrid(*BOX, (3, 3, 3))
    asked = quadratic_probes(lattice)
    energy, label = RNG.random((13, 5, 6)), RNG.integers(0, 1000, (13, 5, 2))
    found = asked.brightest(energy, label)
    corner = asked.beside[0]
    away = np.linalg.norm(placed(lattice, asked.points) - placed(lattice, lattice.points()[:1]), axis=1)
    np.testing.assert_array_equal(corner, np.nonzero(away < away.min() + 1e-9)[0])
    for direction in range(5):
        for view in range(2):
            level = energy[corner, direction, 3 * view : 3 * view + 3] @ [0.2126, 0.7152, 0.0722]
            assert found[0, direction, view] == label[corner[level.argmax()], direction, view]


def test_a_room_s_light_is_told_to_a_fraction_of_its_parallax() -> None:
    lattice, cells = ProbeGrid(*BOX, (3, 3, 3)), direction_cells(512)
    walls = clouds.shell(1.0, 1.5)
    lit = 0.2 + 8 * (walls.means[:, 0] > 0.8) + 2 * (walls.means[:, 2] > 1)
    room = replace(walls, radiance=walls.radiance * lit[:, None, None])
    pose = np.concatenate([np.eye(3), np.zeros((3, 1))], 1)[None]

    def sent(points: np.ndarray) -> np.ndarray:
        """What matt balls at some points send, by normal."""
        energy = gather_probes(room, pose, points, cells, fill=False).energy[0].sum(-1)
        return energy @ np.maximum(cells @ fibonacci_sphere(60).T, 0)

    asked, every = quadratic_probes(lattice), sent(lattice.points())
    told = asked.everywhere(sent(asked.points)[:, None])[:, 0]
    parallax = np.abs(every / every[13] - 1).mean()
    assert np.abs(told / every - 1).mean() < 0.1 * parallax
