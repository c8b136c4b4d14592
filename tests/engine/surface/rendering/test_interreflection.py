"""What walls that no photograph shows throw: as a direct sum over the two planes and the wall has it, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import fibonacci_sphere, rays
from engine.progress import Progress
from engine.surface.data.observations import observe
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.interreflection import hidden_light_fraction, radiance_of_hidden_patches
from engine.surface.rendering.object_pixels import geometry_with_visibility, observe_object
from engine.surface.rendering.transport import (
    IncidentLight,
    LightTransport,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    pixel_blocks,
    predict,
)
from engine.surface.visibility.ray_visibility import HiddenSurfaces, SparseVisibility, trace_occlusion
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


def light(radiance, cells: int = 1024) -> IncidentLight:
    directions = direction_cells(cells)
    energy = np.tile((radiance(directions) * 4 * np.pi / cells)[None, :, None], (1, 1, 3))
    at = np.array([0, 0, UP])
    return IncidentLight(
        ProbeGrid(at, at, (1, 1, 1)), directions, energy.astype(np.float32), AreaLights.none(1, cells)
    )


def stepped(incident: IncidentLight, albedo: np.ndarray | None) -> SurfaceGeometry:
    points, normals = step()
    hidden = trace_occlusion(points, normals, MASK, incident.directions, Progress(), albedo=albedo)
    return SurfaceGeometry(points[MASK], -rays(CAMERA)[MASK], hidden)


def blank_frames(views: int) -> Frames:
    nothing = np.zeros((views, 48, 64), bool)
    radiance = np.full((views, 48, 64, 3), SEEN, np.float32)
    return Frames(tuple(map(str, range(views))), radiance, nothing, nothing, (1e-9, 1e-6))


def known_to(geometry: SurfaceGeometry) -> SparseVisibility:
    """What hides the room there."""
    assert geometry.visibility is not None
    return geometry.visibility


def walls_of(geometry: SurfaceGeometry) -> HiddenSurfaces:
    walls = known_to(geometry).hidden_surfaces
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
    geometry = stepped(incident, painted())
    walls = walls_of(geometry)
    thrown = radiance_of_hidden_patches(geometry, incident, photographed)
    middle = np.abs(walls.points[:, 1]) < 5 * PIXEL
    np.testing.assert_allclose(thrown[middle, 0], wall_by_hand(walls.points[middle, 2]), rtol=0.06)
    # One row of the lower plane, from the foot outwards; the wall is some 0.3 of the first ones' light.
    pixels = np.arange(33, 44) + 64 * 24
    transport = LightTransport(incident, photographed, False, True, "cpu", thrown)
    diffuse, _ = transport(
        transport.block(geometry, pixels),
        np.tile([0, 0, -1.0], (len(pixels), 1, 1)),
        np.ones((len(pixels), 1)),
    )
    # Rays start a tenth of a pixel's width above the plane, and the mesh's wall rises to where the upper plane's last pixel stands.
    lifted, up = geometry.points[pixels] + [0.5 * UP / CAMERA.fx, 0, -0.1 * PIXEL], np.array([0, 0, -1.0])
    wanted = np.array([thrown_by_hand(point, up, wall_by_hand) for point in lifted])
    np.testing.assert_allclose(diffuse[:, 0, 0], wanted, rtol=0.005)
    # Where a wall is as bright as the pixel at its rim, that is wrong by several times as much.
    other = np.array([thrown_by_hand(point, up, lambda z: np.full_like(z, SEEN)) for point in lifted])
    assert (wanted - other)[:3].min() > 0.045 * wanted[0]


def test_a_white_wall_in_a_white_world_is_as_bright_as_that_and_no_brighter():
    incident = light(lambda directions: np.ones(len(directions)))
    white = np.ones((COUNT, 3))
    geometry = stepped(incident, white)
    thrown = radiance_of_hidden_patches(geometry, incident, white.astype(np.float32))
    np.testing.assert_allclose(thrown, 1, atol=0.02)


def test_without_paint_the_nearest_pixel_stands_for_a_wall():
    incident = light(sky)
    geometry = stepped(incident, None)
    assert known_to(geometry).hidden_surfaces is None
    assert known_to(geometry).occluder.max() < COUNT
    assert not len(radiance_of_hidden_patches(geometry, incident, np.zeros((COUNT, 3), np.float32)))
    known, rim = known_to(stepped(incident, painted())), known_to(geometry)
    np.testing.assert_array_equal(known.direction, rim.direction)
    # Of what is met from behind nothing is known.
    assert ((known.occluder == rim.occluder) | (known.occluder >= COUNT) | (known.occluder == -1)).all()
    assert (known.occluder == rim.occluder).mean() > 0.5


def test_only_pixels_near_the_foot_owe_much_of_their_light_to_the_wall():
    incident = light(sky)
    photographed = np.full((COUNT, 3), SEEN, np.float32)
    geometry = stepped(incident, painted())
    transport = LightTransport(
        incident,
        photographed,
        False,
        True,
        "cpu",
        radiance_of_hidden_patches(geometry, incident, photographed),
    )
    _, normals = step()
    state = gauss_newton.initial_estimate(normals[MASK], np.full((COUNT, 3), 0.5), np.full(COUNT, 0.5))
    seen = observe(blank_frames(1), MASK, np.arange(1), 0.02)
    problem = gauss_newton.PixelProblem(transport, geometry, pixel_blocks(MASK), seen)
    share = hidden_light_fraction(state, problem).reshape(48, 64)
    assert share[24, 34] > 0.1
    assert share[24, 60] < 0.1
    assert np.abs(share[:, UPPER]).max() < 1e-3
    assert (np.diff(share[24, 34:60]) < 1e-3).all()
    none = LightTransport(incident, photographed, False, True, "cpu")
    problem = gauss_newton.PixelProblem(none, stepped(incident, None), pixel_blocks(MASK), seen)
    assert not hidden_light_fraction(state, problem).any()


def test_walls_that_were_not_lit_are_refused():
    incident = light(sky)
    transport = LightTransport(incident, np.zeros((COUNT, 3), np.float32), False, True, "cpu")
    with pytest.raises(ValueError, match="0 walls are lit"):
        transport.block(stepped(incident, painted()), np.arange(4))


def test_neighbours_are_asked_under_the_same_walls_as_gauss_newton_is():
    views = 24
    incident = light_of_lamps(np.random.default_rng(3), views, 512)
    params = SurfaceParams(directions=512)
    points, normals = step()
    albedo, flat = painted(), np.full((COUNT, 3 * views), SEEN, np.float32)
    state = gauss_newton.initial_estimate(normals[MASK], albedo, np.full(COUNT, 0.5))
    geometry = stepped(incident, albedo)
    parts = pixel_blocks(MASK)
    picture = flat.copy()
    # Photographs and light thrown depend on one another; a few turns settle them.
    for _ in range(6):
        transport = LightTransport(
            incident, picture, True, True, "cpu", radiance_of_hidden_patches(geometry, incident, picture)
        )
        for pixels, answer in predict(transport, geometry, parts, state.normals, albedo, state.roughness):
            picture[pixels] = answer.reshape(len(pixels), -1)
    radiance = picture.reshape(48, 64, views, 3).transpose(2, 0, 1, 3)
    frames = replace(blank_frames(views), radiance=radiance)
    object_pixels = observe_object(frames, MASK, CAMERA, np.arange(views), params)
    problem = object_pixels.problem(incident, geometry, params, "cpu")
    state = gauss_newton.update_residual_scale(state, problem)
    again = geometry_with_visibility(
        object_pixels, state, points[..., 2], incident.directions, params, Progress()
    )
    np.testing.assert_array_equal(known_to(again).occluder, known_to(geometry).occluder)
    np.testing.assert_allclose(walls_of(geometry.at(2.0)).points, 2 * walls_of(geometry).points)


def test_renumbered_pixels_take_their_walls_along():
    inner = SparseVisibility(np.array([0, 2]), np.zeros(2, np.int32), np.array([1, 3]), np.zeros(1))
    walls = replace(walls_of(stepped(light(sky), painted())), hidden=inner)
    known = SparseVisibility(
        np.array([0, 4]), np.zeros(4, np.int32), np.array([-1, 0, 2, 4]), np.zeros(1), walls
    )
    told = known.told(3, np.array([5, -1, 6]), 8)
    np.testing.assert_array_equal(told.occluder, [-1, 5, 6, 9])
    assert told.hidden_surfaces is not None
    np.testing.assert_array_equal(told.hidden_surfaces.hidden.occluder, [-1, 8])
