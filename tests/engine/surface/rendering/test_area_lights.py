"""Lamps at a pixel against the integral over the sphere that they are."""

import numpy as np
import pytest

from app.bench.baselines.flat import sorted_into_cells
from engine.geometry import fibonacci_sphere, tangents
from engine.surface.reflectance.brdf import rows
from engine.surface.rendering.area_lights import AreaLights, cells_around
from engine.surface.rendering.transport import Block, LightModes, SurfaceGeometry, direction_cells
from engine.surface.visibility.ray_visibility import SparseVisibility

CELLS = 600
RADIANCE = np.array([[[3.0, 2.0, 1.0]]], np.float32)


def lamp(centre: tuple[float, float, float], radius: float = 0.06) -> AreaLights:
    return AreaLights(np.array([[centre]]), np.array([radius]), RADIANCE, CELLS)


def over_its_disc(
    near: AreaLights, point: np.ndarray, normal: np.ndarray, roughness: float, view: np.ndarray, made: np.ndarray | None = None
):  # fmt: skip
    """(diffuse, specular) by brute force: rows without any widening for many rays to the lamp."""
    towards = near.centres[0, 0] - point
    distance = np.linalg.norm(towards)
    rim = np.sqrt(1 - (near.radii[0] / distance) ** 2)
    first, second = (x[0] for x in tangents(towards[None] / distance))
    i = np.arange(4000) + 0.5
    up = 1 - i / len(i) * (1 - rim)
    flat, turn = np.sqrt(1 - up**2), np.pi * (1 + 5**0.5) * i
    rays = up[:, None] * towards / distance + flat[:, None] * (
        np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    )
    both = rows(normal[None], np.array([roughness]), view[None], rays, True, 0.0, made)
    return [x.mean() * 2 * np.pi * (1 - rim) for x in both]


def lit(near: AreaLights, points: np.ndarray, views: np.ndarray, made: np.ndarray | None = None) -> Block:
    """Points that see every lamp and nothing else."""
    dark = LightModes(np.zeros((CELLS, 3)), np.zeros((0, CELLS, 3)), np.zeros((len(points), 0)))
    return Block(SurfaceGeometry(points, views, None, made), dark, near.visible(points, None))


def answer(
    near: AreaLights, point: np.ndarray, normal: np.ndarray, roughness: float, view: np.ndarray, made: np.ndarray | None = None
):  # fmt: skip
    block = lit(near, point[None], view[None], made)
    both = block.each_lamp(near, normal[None, None], np.array([[roughness]]), True)
    return [float(x[0, 0, 0, 0]) for x in both]


# A sharp lobe's tails are not those of a wider one.
@pytest.mark.parametrize(("roughness", "within"), [(0.25, 0.15), (0.4, 0.06), (0.6, 0.03), (0.9, 0.03)])
@pytest.mark.parametrize("point", [(0.0, 0, 0.5), (0.1, -0.05, 0.55)])
@pytest.mark.parametrize("made", [None, (1.0, 0.0), (0.5, 1.0)])
def test_a_lamp_answers_as_the_sphere_it_is(
    roughness: float,
    within: float,
    point: tuple[float, float, float],
    made: tuple[float, float] | None,
):
    near, at = lamp((0.3, -0.4, 0.1)), np.array(point)
    view = -at / np.linalg.norm(at)
    towards = near.centres[0, 0] - at
    # Close to the mirror direction, where a highlight is steepest.
    normal = view + towards / np.linalg.norm(towards) + [0.1, 0.05, 0]
    normal /= np.linalg.norm(normal)
    material = None if made is None else np.array([made])
    expected = over_its_disc(near, at, normal, roughness, view, material)
    found = answer(near, at, normal, roughness, view, material)
    np.testing.assert_allclose(found, expected, rtol=within, atol=1e-5)


@pytest.mark.parametrize("sine", [-0.15, -0.05, 0.0, 0.05, 0.12, 0.3])
def test_a_lamp_rises_above_the_horizon_bit_by_bit(sine: float):
    near = lamp((0.0, 0.0, 0.0), 0.1)
    point, view = np.array([0.0, 0, 1]), np.array([0.0, 0, -1])
    normal = np.array([np.sqrt(1 - sine**2), 0, -sine])
    full = np.pi * 0.1**2 / np.pi  # what it would send from overhead
    expected = over_its_disc(near, point, normal, 0.5, view)[0]
    assert answer(near, point, normal, 0.5, view)[0] == pytest.approx(expected, abs=0.01 * full)


def test_no_highlight_is_brighter_than_the_lobe_is_high():
    rng = np.random.default_rng(3)
    centres = rng.normal(size=(300, 1, 3)) + [0.0, 0, 1]
    near = AreaLights(centres, np.array([0.08]), np.ones((300, 1, 3), np.float32), CELLS)
    point, view = np.array([[0.0, 0, 1]]), np.array([[0.0, 0, -1]])
    # Steep slopes and smooth paint: lamps that are half set, seen at a glance.
    tilt = rng.uniform(1.3, 1.6, 200)
    normals = np.stack([np.sin(tilt), 0 * tilt, -np.cos(tilt)], 1)
    _, specular = lit(near, point, view).each_lamp(near, normals[None], np.full((1, 200), 0.2), True)
    distance = np.linalg.norm(centres[:, 0] - point, axis=1)
    sine = np.minimum(0.08 / distance, 0.99)
    a2 = 0.2**4 + sine**2 / 8
    solid = 2 * np.pi * (1 - np.sqrt(1 - sine**2))
    # D at its top, F at most 1, and what is left of Smith's masking where the view grazes.
    ceiling = 1 / (np.pi * a2) / np.sqrt(a2) * solid
    assert (specular[0, :, :, 0] <= ceiling).all()
    assert specular.max() > 0


def test_what_hides_the_cells_around_a_lamp_hides_the_lamp():
    directions = direction_cells(CELLS)
    hidden = np.nonzero(directions[:, 0] > 0)[0].astype(np.int32)
    # The second point sees everything.
    start = np.array([0, len(hidden), len(hidden)])
    entries = SparseVisibility(start, hidden, np.full_like(hidden, -1), np.zeros(2))
    points = np.zeros((2, 3))
    shares = [
        lamp(at).visible(points, entries)[:, 0, 0] for at in ((1.0, 0, 0.3), (-1.0, 0, 0.3), (0.01, 0.2, 1))
    ]
    np.testing.assert_allclose(shares[0], [0, 1], atol=1e-6)
    np.testing.assert_allclose(shares[1], [1, 1], atol=1e-6)
    assert 0.02 < shares[2][0] < 0.98


def test_the_cells_around_a_direction_have_it_for_their_mean():
    rng = np.random.default_rng(0)
    around, directions = cells_around(CELLS), direction_cells(CELLS)
    for at in rng.normal(size=(20, 3)) * 2:
        near = lamp((at[0], at[1], at[2]), 0.01)
        cells = sorted_into_cells(near, np.zeros(3))[:, 0]
        middle = cells @ directions
        assert middle @ at / np.linalg.norm(middle) / np.linalg.norm(at) > np.cos(np.radians(0.8))
    np.testing.assert_allclose(around.share.sum(-1), 1, rtol=1e-5)


def test_spread_light_is_radiance_times_solid_angle_wherever_the_point_is():
    near = lamp((0.4, 0.1, 1.0), 0.1)
    for point in (np.zeros(3), np.array([0.2, 0, 0.3])):
        cells = sorted_into_cells(near, point)
        distance = np.linalg.norm(near.centres[0, 0] - point)
        solid = 2 * np.pi * (1 - np.sqrt(1 - (0.1 / distance) ** 2))  # of a cap
        np.testing.assert_allclose(cells.sum(0), RADIANCE[0, 0] * solid, rtol=1e-4)
        np.testing.assert_allclose(near.levels(point[None])[0], RADIANCE[0, 0] * solid, rtol=1e-4)


def test_the_sum_over_lamps_is_theirs_one_by_one():
    rng = np.random.default_rng(1)
    centres, radiance = rng.normal(size=(5, 3, 3)) * 2, rng.uniform(0, 2, (5, 3, 3)).astype(np.float32)
    radiance[2, 1] = 0  # the room hides it there
    near = AreaLights(centres, np.array([0.05, 0.1, 0.2]), radiance, CELLS)
    points = rng.normal(size=(4, 3)) * 0.1
    normals = -fibonacci_sphere(8).reshape(4, 2, 3)
    views, rough = np.tile([0.0, 0, -1], (4, 1)), rng.uniform(0.3, 0.8, (4, 2))
    both, block = np.zeros((2, 4, 2, 5, 3), np.float32), lit(near, points, views)
    block.add_lamps(near, near.radiance, normals, rough, True, both)
    each = block.each_lamp(near, normals, rough, True)
    for total, unit in zip(both.reshape(2, 4, 2, 15), each, strict=True):
        expected = np.einsum("pknl,nlc->pknc", unit, radiance).reshape(4, 2, 15)
        np.testing.assert_allclose(total, expected, rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(near.shone(unit).reshape(4, 2, 15), expected, rtol=1e-5, atol=1e-7)
    assert both[0].max() > 0
    assert (each[0][:, :, 2, 1] == 0).all()
