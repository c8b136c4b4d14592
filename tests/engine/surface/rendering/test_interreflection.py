"""What walls that no photograph shows throw: as a direct sum over the two planes and the wall has it, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import fibonacci_sphere, rays
from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.area_lights import Near
from engine.surface.rendering.interreflection import guessed_share, lit
from engine.surface.rendering.object_pixels import sight_of, subject
from engine.surface.rendering.transport import (
    Incident,
    Lattice,
    Responses,
    Sight,
    blocks,
    direction_cells,
    predict,
)
from engine.surface.visibility.ray_visibility import Occlusion, Walls, occlusion
from engine.types import Frames
from tests.engine.surface.rendering.test_object_pixels import CAMERA, light_of_lamps
from tests.engine.surface.visibility.test_hidden_surfaces import DOWN, MASK, UP, UPPER, painted, step

COUNT = 48 * 64
PIXEL = DOWN / CAMERA.fx
"""Width of a pixel on the lower plane."""
SEEN = 0.2
"""Radiance that every pixel was photographed with."""


def sky(directions: np.ndarray) -> np.ndarray:
    """Brighter towards the camera and towards the wall's side."""
    return 1.0 + 0.5 * directions[:, 0] - 0.4 * directions[:, 2]


def light(radiance, cells: int = 1024) -> Incident:
    directions = direction_cells(cells)
    energy = np.tile((radiance(directions) * 4 * np.pi / cells)[None, :, None], (1, 1, 3))
    at = np.array([0, 0, UP])
    return Incident(Lattice(at, at, (1, 1, 1)), directions, energy.astype(np.float32), Near.none(1, cells))


def stepped(incident: Incident, albedo: np.ndarray | None) -> Sight:
    points, normals = step()
    hidden = occlusion(points, normals, MASK, incident.directions, Progress(), albedo=albedo)
    return Sight(points[MASK], -rays(CAMERA)[MASK], hidden)


def known_to(sight: Sight) -> Occlusion:
    """What hides the room there."""
    assert sight.occlusion is not None
    return sight.occlusion


def walls_of(sight: Sight) -> Walls:
    walls = known_to(sight).walls
    assert walls is not None
    return walls


def thrown_by_hand(point: np.ndarray, normal: np.ndarray, wall, rays_: int = 20000) -> float:
    """Irradiance over pi at a point right of the wall x = 0: from the sky, the lower plane, and the wall, whose radiance
    at a z `wall` tells."""
    directions = fibonacci_sphere(rays_)
    cosine = directions @ normal
    directions, cosine = directions[cosine > 0], cosine[cosine > 0]
    value = sky(directions)
    with np.errstate(divide="ignore"):
        down = (DOWN - point[2]) / directions[:, 2]
        aside = -point[0] / directions[:, 0]
    x, y = (point[axis] + down * directions[:, axis] for axis in (0, 1))
    on_plane = (down > 1e-9) & (x > 0) & (x < 31.5 * PIXEL) & (np.abs(y) < 24 * PIXEL)
    value[on_plane] = SEEN
    y, z = (point[axis] + aside * directions[:, axis] for axis in (1, 2))
    on_wall = (aside > 1e-9) & (z > UP) & (z < DOWN) & (np.abs(y) < 24 * z / CAMERA.fx)
    value[on_wall] = wall(z[on_wall])
    return float((value * cosine).sum() * 4 * np.pi / rays_ / np.pi)


def wall_by_hand(z: np.ndarray) -> np.ndarray:
    heights = np.linspace(UP, DOWN, 9)
    heights[[0, -1]] += [1e-4, -1e-4]
    at = [thrown_by_hand(np.array([1e-6, 0, h]), np.array([1.0, 0, 0]), np.zeros_like) for h in heights]
    return 0.7 * np.interp(z, heights, at)


def test_a_wall_throws_what_a_direct_sum_says_and_lights_the_lower_plane_so():
    incident = light(sky)
    photographed = np.full((COUNT, 3), SEEN, np.float32)
    sight = stepped(incident, painted())
    walls = walls_of(sight)
    thrown = lit(sight, incident, photographed)
    middle = np.abs(walls.points[:, 1]) < 5 * PIXEL
    np.testing.assert_allclose(thrown[middle, 0], wall_by_hand(walls.points[middle, 2]), rtol=0.06)
    # One row of the lower plane, from the foot outwards; the wall is some 0.3 of the first ones' light.
    pixels = np.arange(33, 44) + 64 * 24
    responses = Responses(incident, photographed, False, True, "cpu", thrown)
    diffuse, _ = responses(
        responses.block(sight, pixels), np.tile([0, 0, -1.0], (len(pixels), 1, 1)), np.ones((len(pixels), 1))
    )
    # Rays start a tenth of a pixel's width above the plane, and the mesh's wall rises to where the upper plane's last pixel stands.
    lifted, up = sight.points[pixels] + [0.5 * UP / CAMERA.fx, 0, -0.1 * PIXEL], np.array([0, 0, -1.0])
    wanted = np.array([thrown_by_hand(point, up, wall_by_hand) for point in lifted])
    np.testing.assert_allclose(diffuse[:, 0, 0], wanted, rtol=0.005)
    # Where a wall is as bright as the pixel at its rim, that is wrong by several times as much.
    other = np.array([thrown_by_hand(point, up, lambda z: np.full_like(z, SEEN)) for point in lifted])
    assert (wanted - other)[:3].min() > 0.045 * wanted[0]


def test_a_white_wall_in_a_white_world_is_as_bright_as_that_and_no_brighter():
    incident = light(lambda directions: np.ones(len(directions)))
    white = np.ones((COUNT, 3))
    sight = stepped(incident, white)
    thrown = lit(sight, incident, white.astype(np.float32))
    np.testing.assert_allclose(thrown, 1, atol=0.02)


def test_without_paint_the_nearest_pixel_stands_for_a_wall():
    incident = light(sky)
    sight = stepped(incident, None)
    assert known_to(sight).walls is None
    assert known_to(sight).source.max() < COUNT
    assert not len(lit(sight, incident, np.zeros((COUNT, 3), np.float32)))
    known, rim = known_to(stepped(incident, painted())), known_to(sight)
    np.testing.assert_array_equal(known.direction, rim.direction)
    # Of what is met from behind nothing is known.
    assert ((known.source == rim.source) | (known.source >= COUNT) | (known.source == -1)).all()
    assert (known.source == rim.source).mean() > 0.5


def test_only_pixels_near_the_foot_owe_much_of_their_light_to_the_wall():
    incident = light(sky)
    photographed = np.full((COUNT, 3), SEEN, np.float32)
    sight = stepped(incident, painted())
    responses = Responses(incident, photographed, False, True, "cpu", lit(sight, incident, photographed))
    _, normals = step()
    state = gauss_newton.begin(normals[MASK], np.full((COUNT, 3), 0.5), np.full(COUNT, 0.5))
    share = guessed_share(state, responses, sight, blocks(MASK)).reshape(48, 64)
    assert share[24, 34] > 0.1
    assert share[24, 60] < 0.1
    assert np.abs(share[:, UPPER]).max() < 1e-3
    assert (np.diff(share[24, 34:60]) < 1e-3).all()
    none = Responses(incident, photographed, False, True, "cpu")
    assert not guessed_share(state, none, stepped(incident, None), blocks(MASK)).any()


def test_walls_that_were_not_lit_are_refused():
    incident = light(sky)
    responses = Responses(incident, np.zeros((COUNT, 3), np.float32), False, True, "cpu")
    with pytest.raises(ValueError, match="0 walls are lit"):
        responses.block(stepped(incident, painted()), np.arange(4))


def test_neighbours_are_asked_under_the_same_walls_as_gauss_newton_is():
    views = 24
    incident = light_of_lamps(np.random.default_rng(3), views, 512)
    params = SurfaceParams(directions=512)
    points, normals = step()
    albedo, flat = painted(), np.full((COUNT, 3 * views), SEEN, np.float32)
    state = gauss_newton.begin(normals[MASK], albedo, np.full(COUNT, 0.5))
    sight = stepped(incident, albedo)
    parts = blocks(MASK)
    picture = flat.copy()
    # Photographs and light thrown depend on one another; a few turns settle them.
    for _ in range(6):
        responses = Responses(incident, picture, True, True, "cpu", lit(sight, incident, picture))
        for pixels, answer in predict(responses, sight, parts, state.normals, albedo, state.roughness):
            picture[pixels] = answer.reshape(len(pixels), -1)
    radiance = picture.reshape(48, 64, views, 3).transpose(2, 0, 1, 3)
    blank = np.zeros(radiance.shape[:3], bool)
    frames = Frames(tuple(map(str, range(views))), radiance, blank, blank, (1e-9, 1e-6))
    who = subject(frames, MASK, CAMERA, np.arange(views), params)
    state = gauss_newton.respread(
        state, who.responses(incident, params, "cpu", sight), sight, parts, who.seen
    )
    again = sight_of(who, state, points[..., 2], incident.directions, params, Progress())
    np.testing.assert_array_equal(known_to(again).source, known_to(sight).source)
    np.testing.assert_allclose(walls_of(sight.at(2.0)).points, 2 * walls_of(sight).points)


def test_renumbered_pixels_take_their_walls_along():
    inner = Occlusion(np.array([0, 2]), np.zeros(2, np.int32), np.array([1, 3]), np.zeros(1))
    walls = replace(walls_of(stepped(light(sky), painted())), hidden=inner)
    known = Occlusion(np.array([0, 4]), np.zeros(4, np.int32), np.array([-1, 0, 2, 4]), np.zeros(1), walls)
    told = known.told(3, np.array([5, -1, 6]), 8)
    np.testing.assert_array_equal(told.source, [-1, 5, 6, 9])
    assert told.walls is not None
    np.testing.assert_array_equal(told.walls.hidden.source, [-1, 8])
