"""Light at many places from cube maps at few of them, against what is gathered at each of its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.geometry import inverse
from engine.light.incident import probe_interpolation
from engine.light.incident.direction_grid import FACES, face_directions
from engine.light.incident.probe_interpolation import interpolate
from engine.light.incident.probes import gather_probes
from engine.progress import Progress
from engine.surface.lighting.room_light import ball
from engine.surface.rendering.transport import direction_cells
from engine.types import Gaussians
from tests.engine.light import clouds

FACE, TOLERANCE = 32, 0.01
CELLS = direction_cells(400)
POINTS = np.array([[x, y, z] for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.08) for z in (0.36, 0.5)])
RECEIVERS = np.concatenate([ball(face_directions(FACE).reshape(-1, 3) @ turn.T, True) for turn in FACES])


def room() -> Gaussians:
    """Walls a metre and a half away, one of them bright, one brighter, and a gap that no photograph shows."""
    walls = clouds.shell(1.0, 1.5)
    lit = 0.2 + 8 * (walls.means[:, 0] > 0.8) + 2 * (walls.means[:, 2] > 1)
    closed = walls.means[:, 1] < 1.42
    return Gaussians(*(
        getattr(replace(walls, radiance=walls.radiance * lit[:, None, None]), name)[closed]
        for name in Gaussians.__slots__
    ))  # fmt: skip


def views(count: int, apart: float) -> np.ndarray:
    """Cameras that turn every way about a pivot before them, which wanders."""
    rng = np.random.default_rng(3)
    turned = Rotation.random(count, random_state=3).as_matrix()
    pivots = rng.normal(0, apart, (count, 3))
    return inverse(np.concatenate([turned, (pivots - turned @ [0, 0, 0.25])[..., None]], 2))


def told(poses: np.ndarray) -> np.ndarray:
    return interpolate(room(), poses, POINTS, CELLS, FACE, RECEIVERS, TOLERANCE, Progress())


def test_what_a_third_of_the_places_foretell_is_what_is_gathered_at_all(monkeypatch: pytest.MonkeyPatch):
    poses, gathered = views(100, 0.02), []
    cubes = probe_interpolation.cubes
    monkeypatch.setattr(probe_interpolation, "cubes", lambda *a: gathered.append(len(a[1])) or cubes(*a))
    found = told(poses)
    assert sum(gathered) < len(poses) * len(POINTS) / 3
    some = np.arange(0, len(poses), 7)
    truth = gather_probes(room(), poses[some], POINTS, CELLS, FACE).energy
    takes = ball(CELLS, True)
    off = (takes @ found[some]) / (takes @ truth) - 1
    assert np.sqrt((off**2).mean()) < TOLERANCE
    # The gap is filled as it is there, and no light is lost.
    np.testing.assert_allclose(found[some].sum(2), truth.sum(2), rtol=0.01)


def test_places_far_apart_are_gathered_at_each(monkeypatch: pytest.MonkeyPatch):
    poses = views(10, 0.5)
    monkeypatch.setattr(probe_interpolation, "FIRST", 24)  # a fifth of the places, as 96 are of 40 views'
    monkeypatch.setattr(probe_interpolation, "_sorted", None)
    np.testing.assert_array_equal(told(poses), gather_probes(room(), poses, POINTS, CELLS, FACE).energy)


def test_places_that_are_chosen_are_told_by_themselves_and_constant_light_everywhere():
    places = np.random.default_rng(1).normal(size=(300, 3))
    choice = probe_interpolation._PivotedCholesky(places, 80)
    first = choice.first(40)
    np.testing.assert_allclose(choice.weights(first, 40), np.eye(40), atol=1e-6)
    np.testing.assert_array_equal(choice.first(80)[:40], first)
    weights = choice.weights(np.arange(300), 80)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-5)
    slope = np.abs(weights @ places[choice.first(80)] - places)
    assert np.median(slope) < 0.05


def test_a_camera_that_only_turns_needs_a_cube_map_for_each_of_few_places():
    """Round about one pivot, a quarter at a time: the probes of all views stand at a few places."""
    turned = Rotation.from_rotvec(np.outer(np.tile(np.pi / 2 * np.arange(4), 25), [0, 0, 1])).as_matrix()
    poses = np.concatenate([turned, np.zeros((100, 3, 1))], 2)
    truth = gather_probes(room(), poses[:4], POINTS, CELLS, FACE).energy
    found = told(poses)[:4]
    takes = ball(CELLS, True)
    np.testing.assert_allclose(takes @ found, takes @ truth, rtol=0.05)


def test_places_that_are_one_are_chosen_once():
    places = np.repeat(np.random.default_rng(1).normal(size=(5, 3)), 4, axis=0)
    assert len(probe_interpolation._PivotedCholesky(places, 20).first(20)) == 5
