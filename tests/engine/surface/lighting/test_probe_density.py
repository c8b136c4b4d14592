"""Probes where the light bends, and no more: in rooms far away, beside a wall, and as asked."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import fibonacci_sphere
from engine.light.fitting.lamp_model import with_lamps
from engine.light.gaussians.gaussians import Y00, joined
from engine.light.incident.probes import gather_probes
from engine.progress import Progress
from engine.surface.lighting import probe_density
from engine.surface.lighting.probe_density import (
    ProbeDensityConfig,
    choose_direction_count,
    choose_probe_grid,
    probe_counts,
)
from engine.surface.optimize.gauss_newton import initial_estimate
from engine.surface.params import SurfaceParams
from engine.surface.rendering.transport import ProbeGrid, SurfaceGeometry, direction_cells
from engine.types import Camera, Emitters, Gaussians, Lamps

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
MASK = np.zeros((48, 64), bool)
MASK[10:38, 14:50] = True
NEAR_FAR = 0.9, 1.1
PARAMS = replace(SurfaceParams(), directions=256)
CONFIG = ProbeDensityConfig()
HERE = np.eye(4)[None, :3]
NOBODY = Lamps(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, bool))


def gaussians(means: np.ndarray, scale: float, radiance: np.ndarray) -> Gaussians:
    count = len(means)
    return Gaussians(
        means, np.tile([1.0, 0, 0, 0], (count, 1)), np.full((count, 3), scale), np.full(count, 20.0),
        (radiance / Y00)[:, None, None].repeat(3, 2),
    )  # fmt: skip


def shell(radius: float) -> Gaussians:
    """A room of uneven light, around the object."""
    towards = fibonacci_sphere(600)
    return gaussians(np.array([0, 0, 1.0]) + radius * towards, 0.13 * radius, 1.2 + towards @ [0.6, 0.5, 0.4])


def room(shape: Gaussians) -> Emitters:
    return Emitters(shape, NOBODY, 0)


def chosen(shape: Gaussians, params: SurfaceParams = PARAMS) -> ProbeGrid:
    return choose_probe_grid(CAMERA, MASK, NEAR_FAR, room(shape), HERE, params, Progress())


def left_over(lattice: ProbeGrid, shape: Gaussians) -> float:
    """Largest of the axes' errors of the irradiance in the middle between the two probes around the box's middle."""
    cells = direction_cells(PARAMS.directions)
    normals = direction_cells(50)
    cosine = np.maximum(normals[normals[:, 2] < -0.2] @ cells.T, 0)
    fine = replace(lattice, shape=tuple(4 * (n - 1) + 1 if n > 1 else 1 for n in lattice.shape))
    points, worst = fine.points().reshape(*fine.shape, 3), 0.0
    for axis, count in enumerate(fine.shape):
        if count > 1:
            line = np.moveaxis(points, axis, 0)
            line = line[(slice(None), *(n // 2 for n in line.shape[1:-1]))]
            light = (
                gather_probes(shape, HERE, line, cells, PARAMS.probe_resolution).energy[0].sum(-1) @ cosine.T
            )
            gap = (light[:-4:4] + light[4::4]) / 2 / light[2::4] - 1
            worst = max(worst, float(np.sqrt((gap**2).mean())))
    return worst


def test_one_probe_tells_a_room_that_is_far_away() -> None:
    assert chosen(shell(200.0)).shape == (1, 1, 1)


def beside_a_wall() -> Gaussians:
    wall = np.stack([np.full(81, -0.62), *(0.12 * np.mgrid[-4:5, -4:5].reshape(2, -1) + [[0.0], [1.0]])], 1)
    return joined(shell(6.0), gaussians(wall, 0.08, np.linspace(1, 9, 81)))


def test_there_are_so_many_at_most_the_finest_axis_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    free = np.array(chosen(beside_a_wall()).shape)
    monkeypatch.setattr(probe_density, "CONFIG", replace(CONFIG, most_probes=int(free.prod()) - 1))
    bound = np.array(chosen(beside_a_wall()).shape)
    assert (free - bound).tolist() == np.eye(3, dtype=int)[free.argmax()].tolist()


def test_a_near_wall_takes_more_along_the_way_to_it_and_they_suffice() -> None:
    shape = beside_a_wall()
    lattice = chosen(shape)
    across, down, deep = lattice.shape
    assert CONFIG.most_probes >= across > max(down, deep)
    assert left_over(lattice, shape) < 0.25 * PARAMS.model_error
    fewer = replace(lattice, shape=(across - 1, down, deep))
    assert left_over(fewer, shape) > left_over(lattice, shape)


@pytest.mark.parametrize(("across", "deep", "expected"), [(5, 2, (5, 5, 2)), (3, 0, (3, 3, 1))])
def test_what_was_asked_is_given(across: int, deep: int, expected: tuple[int, ...]) -> None:
    asked = replace(PARAMS, probe_grid_xy=across, probe_grid_z=deep)
    assert chosen(shell(200.0), asked).shape == expected


def test_lamps_that_stand_apart_do_not_count() -> None:
    """They shine on every pixel from their own place, however near."""
    lamp = Lamps(np.array([[-0.6, 0.0, 1.0]]), np.array([0.05]), np.full((1, 3), 50.0), np.zeros(1, bool))
    emitters = Emitters(with_lamps(shell(200.0), lamp), lamp, 0)
    box = ProbeGrid(np.array([-0.3, -0.2, 0.9]), np.array([0.3, 0.2, 1.1]), (3, 3, 3))
    assert probe_counts(box, emitters, HERE, PARAMS, Progress()) == (1, 1, 1)


def asked_for(shape: Gaussians, roughness: float, grey: float = 0.5) -> int:
    """Directions, by the half of a ball that faces the camera."""
    normals = direction_cells(600)
    normals = normals[normals[:, 2] < -0.2]
    count = len(normals)
    points = np.array([0, 0, 1.0]) + 0.1 * normals
    views = -points / np.linalg.norm(points, axis=1, keepdims=True)
    ball = initial_estimate(normals, np.full((count, 3), grey), np.full(count, roughness))
    return choose_direction_count(
        ball, SurfaceGeometry(points, views, None), room(shape), HERE, PARAMS, Progress()
    )


def window() -> Gaussians:
    """A bright square a tenth of a radian across, before the ball in a room of uneven light."""
    pane = np.stack([*(0.03 * np.mgrid[-4:5, -4:5].reshape(2, -1) + [[1.6], [0.7]]), np.full(81, -1.0)], 1)
    return joined(shell(6.0), gaussians(pane, 0.02, np.full(81, 300.0)))


def test_gloss_asks_for_more_directions_than_matt() -> None:
    assert asked_for(shell(6.0), 0.9) == CONFIG.least_directions
    assert asked_for(window(), 0.2) == CONFIG.most_directions
    assert asked_for(window(), 0.9) < asked_for(window(), 0.2)
