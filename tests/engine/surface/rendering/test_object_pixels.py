"""The pixel solver on pictures from its own model: it must undo what it can do.

Own pictures test the machinery only (search, steps, visibility, bounce); accuracy is claimed from path-traced
sets elsewhere.
"""

from dataclasses import replace

import numpy as np
import pytest

from app.bench.baselines.known_light import solve_and_expect_roughness
from engine.errors import SurfaceError
from engine.geometry import rays
from engine.progress import Progress
from engine.surface.data.observations import observe, parent_index
from engine.surface.data.scene import Picture, Scene
from engine.surface.estimate import Estimate, known
from engine.surface.lighting.distance_search import Distance
from engine.surface.lighting.room_light import RoomLight
from engine.surface.optimize import gauss_newton
from engine.surface.params import BOUNDS, OR_NONE, SurfaceParams
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.object_pixels import (
    depth_from_normals,
    geometry_with_visibility,
    image,
    observe_object,
    search_initial_normals,
)
from engine.surface.rendering.transport import (
    IncidentLight,
    LightTransport,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    pixel_blocks,
    predict,
    probe_grid_around,
)
from engine.surface.visibility.ray_visibility import trace_occlusion
from engine.types import Camera, Emitters, Frames, Gaussians, Lamps, Poses

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)


@pytest.mark.parametrize(("name", "least"), [(name, least) for name, (least, _) in BOUNDS.items()])
def test_less_than_a_solve_needs_is_refused_as_it_is_asked(name: str, least: float) -> None:
    params = SurfaceParams()
    assert getattr(replace(params, **{name: least}), name) == least
    less = least - 1
    with pytest.raises(SurfaceError, match=rf"^surface\.{name} is {less}; give {least:.10g} or more$"):
        replace(params, **{name: less})
    if name in OR_NONE:
        assert getattr(replace(params, **{name: 0}), name) == 0


def light_of_lamps(rng: np.random.Generator, views: int, d: int) -> IncidentLight:
    """Every view sees a dim room and three soft lamps somewhere else."""
    directions = direction_cells(d)
    energy = np.full((1, d, views, 3), 0.2)
    for n in range(views):
        for _ in range(3):
            lamp = rng.normal(size=3)
            lamp /= np.linalg.norm(lamp)
            energy[0, :, n] += np.exp(20 * (directions @ lamp - 1))[:, None] * rng.uniform(2, 6, 3)
    lattice = ProbeGrid(np.array([0, 0, 1.0]), np.array([0, 0, 1.0]), (1, 1, 1))
    energy = (energy * 4 * np.pi / d).reshape(1, d, -1).astype(np.float32)
    return IncidentLight(lattice, directions, energy, AreaLights.none(views, d))


def ball() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r, centre, radius = rays(CAMERA), np.array([0, 0, 0.6]), 0.17
    b = r @ centre
    disc = b * b - (centre @ centre - radius**2)
    mask = disc > 2e-3
    points = r * (b - np.sqrt(np.maximum(disc, 0)))[..., None]
    return mask, (points - centre) / radius, points


def pictures_of_a_ball(
    rng: np.random.Generator, views: int, light: IncidentLight
) -> tuple[Frames, np.ndarray]:
    """What the model itself says of a ball of one paint; and the ball's mask."""
    mask, normals, points = ball()
    count = int(mask.sum())
    geometry = SurfaceGeometry(points[mask], -rays(CAMERA)[mask], None)
    transport = LightTransport(light, np.zeros((count, 3 * views), np.float32), True, False, "cpu")
    flat = np.zeros((count, views, 3), np.float32)
    albedo, roughness = np.tile([0.6, 0.4, 0.3], (count, 1)), np.full(count, 0.45)
    for pixels, answer in predict(transport, geometry, pixel_blocks(mask), normals[mask], albedo, roughness):
        flat[pixels] = answer
    radiance = np.zeros((views, 48, 64, 3), np.float32)
    radiance[:, mask] = flat.transpose(1, 0, 2)
    nothing = np.zeros(radiance.shape[:3], bool)
    return Frames(tuple(map(str, range(views))), radiance, nothing, nothing, (1e-6, 1e-6)), mask


PARAMS = SurfaceParams(directions=400, without=("self_shadowing", "interreflections"), normal_candidates=150)


@pytest.mark.parametrize("device", ["cpu", "meta-cpu"])
def test_solver_undoes_its_own_pictures(device: str):
    # For `solve_and_expect_roughness` any torch device but "cpu" takes the torch path; torch's own CPU device runs it without a GPU.
    device = "cpu:0" if device == "meta-cpu" else "cpu"
    rng = np.random.default_rng(0)
    light = light_of_lamps(rng, 24, 400)
    frames, mask = pictures_of_a_ball(rng, 24, light)
    object_pixels = observe_object(frames, mask, CAMERA, np.arange(24), PARAMS)
    state = search_initial_normals(object_pixels, light, object_pixels.geometry_at(0.5), PARAMS, Progress())
    for _ in range(2):
        geometry = geometry_with_visibility(
            object_pixels,
            state,
            depth_from_normals(object_pixels, state, 0.5, Progress()),
            light.directions,
            PARAMS,
            Progress(),
        )
        state = solve_and_expect_roughness(object_pixels, state, light, geometry, PARAMS, device, Progress())
    error = np.degrees(np.arccos(np.clip((state.normals * ball()[1][mask]).sum(-1), -1, 1)))
    assert np.median(error) < 0.2
    assert np.median(np.abs(state.albedo - [0.6, 0.4, 0.3])) < 0.01
    assert np.median(np.abs(state.roughness - 0.45)) < 0.02


@pytest.mark.parametrize("robust", [True, False])
def test_robust_weights_forgive_a_few_false_views(robust: bool):
    rng = np.random.default_rng(5)
    light = light_of_lamps(rng, 24, 300)
    frames, mask = pictures_of_a_ball(rng, 24, light)
    frames.radiance[:3] *= 3.0  # as if something had shone into three views
    params = replace(PARAMS, directions=300, without=(*PARAMS.without, *(() if robust else ("robust_loss",))))
    object_pixels = observe_object(frames, mask, CAMERA, np.arange(24), params)
    truth = ball()[1][mask]
    state = gauss_newton.initial_estimate(
        truth, np.tile([0.6, 0.4, 0.3], (len(truth), 1)), np.full(len(truth), 0.45)
    )
    state = solve_and_expect_roughness(
        object_pixels, state, light, object_pixels.geometry_at(0.5), params, "cpu", Progress()
    )
    error = np.degrees(np.arccos(np.clip((state.normals * truth).sum(1), -1, 1)))
    assert (np.median(error) < 1) == robust
    assert (np.median(error) > 3) == (not robust)


def test_points_lie_where_the_depth_has_them():
    rng = np.random.default_rng(6)
    frames, mask = pictures_of_a_ball(rng, 8, light_of_lamps(rng, 8, 300))
    object_pixels = observe_object(frames, mask, CAMERA, np.arange(8), PARAMS)
    points = ball()[2]
    seen = object_pixels.geometry_at(points[mask][:, 2])
    np.testing.assert_allclose(seen.points, points[mask])
    assert seen.visibility is None


def test_halved_pictures_hold_the_means_of_the_object_and_give_a_start_for_all_its_pixels():
    rng = np.random.default_rng(2)
    frames, mask = pictures_of_a_ball(rng, 8, light_of_lamps(rng, 8, 400))
    half = Picture(frames, mask, CAMERA).downsampled()
    fewer, small, camera = half.frames, half.mask, half.camera
    assert fewer.radiance.shape == (8, 24, 32, 3)
    assert (camera.width, camera.fx) == (32, 30.0)
    inner = small & (mask[::2, ::2] & mask[1::2, ::2] & mask[::2, 1::2] & mask[1::2, 1::2])
    mean = frames.radiance.reshape(8, 24, 2, 32, 2, 3).mean((2, 4))
    np.testing.assert_allclose(fewer.radiance[:, inner], mean[:, inner], rtol=1e-5)
    where = np.stack(np.nonzero(small), 1).astype(float)
    state = gauss_newton.initial_estimate(
        np.tile([0.0, 0.0, -1.0], (len(where), 1)), where[:, [0, 1, 1]] / 64, where[:, 0] / 24
    )
    params, some = SurfaceParams(), np.arange(8)
    pixels = half.pixels(some, params)
    flat = pixels.geometry_at(0.5)
    ball = image(small, flat.points) - np.array([0, 0, 0.1])
    hidden = trace_occlusion(ball, image(small, -pixels.rays), small, direction_cells(200), Progress())
    made = np.stack([np.full(len(where), 0.5), np.arange(len(where)) % 2], 1)
    now = Estimate(
        1, some, replace(pixels, material=made), no_room(), Distance(0.5, 0.0, "given"),
        replace(flat, visibility=hidden), state,
    )  # fmt: skip
    whole = Picture(frames, mask, CAMERA)
    poses = Poses(CAMERA, np.tile(np.eye(3, 4), (8, 1, 1)), np.ones(8, bool), np.zeros((0, 3)), "given", 0.0)
    scene = Scene(whole, (whole, half), poses, some, some, some[:0], params, "cpu", 0)
    found = now.upsampled(scene, Progress())
    material, index = found.object_pixels.material, parent_index(small, mask)
    assert material is not None
    np.testing.assert_array_equal(material, made[index])
    assert found.geometry.material is material
    row = np.nonzero(mask)[0]
    assert np.abs(known(found.state).roughness * 24 - row // 2).max() <= 1
    np.testing.assert_allclose(found.geometry.points[:, 2], known(found.depth)[mask])
    assert known(found.depth)[mask].mean() == pytest.approx(0.5, rel=1e-3)
    # What hides the room from a pixel of half the size does so from all four, and is one of what it was made of.
    seen = found.geometry.visibility
    assert seen is not None
    assert len(hidden.direction)
    for p in range(0, len(index), 7):
        of, own = slice(*hidden.start[index[p] : index[p] + 2]), slice(*seen.start[p : p + 2])
        np.testing.assert_array_equal(seen.direction[own], hidden.direction[of])
        behind = seen.occluder[own]
        np.testing.assert_array_equal(np.where(behind >= 0, index[behind], -1), hidden.occluder[of])


def no_room() -> RoomLight:
    """No emitters, no cameras: nothing that an estimate needs in order to be enlarged."""
    none, nobody = np.zeros((0, 3)), np.zeros(0, bool)
    nothing = Gaussians(none, np.zeros((0, 4)), none, np.zeros(0), none[:, None])
    emitters = Emitters(nothing, Lamps(none, np.zeros(0), none, nobody), 0)
    poses = Poses(CAMERA, np.zeros((0, 3, 4)), nobody, none, "given", 0.0)
    return RoomLight(emitters, poses, np.zeros(0, int), np.zeros(0, np.uint8), np.zeros(0), 0.0, 0.0, 0.0)


def test_a_step_hides_the_sky_beside_it_and_names_what_hides_it():
    mask = np.ones((48, 64), bool)
    q = rays(CAMERA)
    q = q / q[..., 2:]
    z = np.where(np.arange(64) < 32, 0.5, 0.505)[None].repeat(48, 0)
    z[:, 32:] = 0.52
    # The riser itself is seen as one column of strongly tilted facets.
    points = q * z[..., None]
    normals = np.zeros((48, 64, 3))
    normals[..., 2] = -1
    directions = direction_cells(500)
    hidden = trace_occlusion(points, normals, mask, directions, Progress())
    share = hidden.hidden_share.reshape(48, 64)
    assert share[24, 33] > 0.03
    assert share[24, 60] < 0.3 * share[24, 33]
    assert share[24, 5] < 1e-3
    one = hidden.part(np.array([24 * 64 + 33]))
    direction, source = one.direction, one.occluder
    assert one.start[-1] == len(direction)
    above = directions[direction][:, 2] < 0
    assert (directions[direction][above, 0] < 0).mean() > 0.9
    assert ((source[above] % 64) <= 33).all()
    # Just below the horizon of flat ground there is ground.
    direction = hidden.part(np.array([24 * 64 + 16])).direction
    below = np.flatnonzero((directions[:, 2] > 0.2) & (directions[:, 2] < 0.5))
    assert np.isin(below, direction).all()
    assert not (directions[direction][:, 2] > 0.5).any()


def test_lattice_weights_sum_to_one_and_interpolate_log_depth_exactly():
    mask = np.zeros((48, 64), bool)
    mask[10:40, 20:50] = True
    lattice = probe_grid_around(CAMERA, mask, (0.4, 0.6), (3, 3, 2))
    points = lattice.points()
    for point in ([0.0, 0.0, 0.5], [0.02, -0.03, 0.45]):
        weights = lattice.weights(np.array(point)[None])[0]
        assert weights.sum() == pytest.approx(1)
        assert weights @ np.log(points[:, 2]) == pytest.approx(np.log(point[2]))


def test_blocks_cover_every_pixel_once():
    mask, _, _ = ball()
    together = np.concatenate(pixel_blocks(mask))
    np.testing.assert_array_equal(np.sort(together), np.arange(mask.sum()))


def light_that_varies(lattice: ProbeGrid, views: int, d: int) -> IncidentLight:
    """Every view sees a lamp of its own that stands near, where the probes see it each elsewhere."""
    directions = direction_cells(d)
    lamps = np.random.default_rng(3).normal(size=(views, 3)) * 0.3 + [0, 0, -0.4]
    energy = np.zeros((len(lattice.points()), d, views, 3), np.float32)
    for k, point in enumerate(lattice.points()):
        for n, lamp in enumerate(lamps - point):
            far = np.linalg.norm(lamp)
            energy[k, :, n] = (np.exp(9 * (directions @ lamp / far - 1)) / far**2)[:, None] * [3, 2, 1]
    return IncidentLight(lattice, directions, energy.reshape(len(energy), d, -1), AreaLights.none(views, d))


def test_every_pixel_of_a_block_answers_the_light_at_its_own_place():
    mask, normals, points = ball()
    lattice = probe_grid_around(CAMERA, mask, (0.4, 0.6), (3, 3, 2))
    light = light_that_varies(lattice, 5, 400)
    geometry = SurfaceGeometry(points[mask], -rays(CAMERA)[mask], None)
    transport = LightTransport(light, np.zeros((int(mask.sum()), 15), np.float32), True, False, "cpu")
    pixels = max(pixel_blocks(mask), key=len)
    leaning, rough = gauss_newton.perturbed(normals[mask][pixels], np.full(len(pixels), 0.3))
    together = transport.block(geometry, pixels)
    assert 0 < len(together.light.modes) < len(lattice.points()) / 2

    def sent(block, some) -> np.ndarray:
        diffuse, specular = transport(block, leaning[some], rough[some])
        return 0.5 * diffuse + specular

    alone = np.concatenate([sent(transport.block(geometry, pixels[[i]]), [i]) for i in range(len(pixels))])
    everyone = np.arange(len(pixels))
    off, by_the_mean = (
        np.abs(sent(block, everyone) / alone - 1) for block in (together, together.under(together.light.mean))
    )
    assert off.mean() < 0.003 < 0.02 < by_the_mean.mean()
    np.testing.assert_allclose(
        sent(together.part(everyone[::7]), everyone[::7]), sent(together, everyone)[::7], 1e-4
    )


def test_where_no_view_is_kept_out_there_is_nothing_to_render():
    mask, normals, points = ball()
    lattice = probe_grid_around(CAMERA, mask, (0.4, 0.6), (3, 3, 2))
    transport = LightTransport(
        light_that_varies(lattice, 0, 400), np.zeros((int(mask.sum()), 0), np.float32), True, False, "cpu"
    )
    pixels = max(pixel_blocks(mask), key=len)
    block = transport.block(SurfaceGeometry(points[mask], -rays(CAMERA)[mask], None), pixels)
    assert len(block.light.modes)
    diffuse, _ = transport(block, normals[mask][pixels][:, None], np.full((len(pixels), 1), 0.3))
    assert diffuse.shape == (len(pixels), 1, 0)


def test_pixels_at_one_place_share_one_light_and_no_ways_it_differs():
    mask, _, points = ball()
    lattice = probe_grid_around(CAMERA, mask, (0.4, 0.6), (3, 3, 2))
    light = light_that_varies(lattice, 2, 200)
    point = points[mask][:1]
    told = light.among(np.repeat(point, 9, 0))
    assert len(told.modes) == told.coefficients.shape[1] == 0
    np.testing.assert_allclose(told.mean, light.at(point[0]), rtol=1e-6)


def test_a_rim_s_pixels_know_what_is_beside_them_unless_it_is_dark():
    mask = np.zeros((6, 8), bool)
    # Cut off by the picture's left side: nothing is photographed beside it there.
    mask[1:5, 0:6] = True
    radiance = np.full((3, 6, 8, 3), 0.2, np.float32)
    radiance[:, 0] = [[[0.5]], [[0.6]], [[0.7]]]
    radiance[:, :, 6] = 0.01
    radiance[:, 5] = 0.1
    nothing = np.zeros((3, 6, 8), bool)
    frames = Frames(("a", "b", "c"), radiance, nothing, nothing, (1e-6, 1e-6))
    seen = observe(frames, mask, np.arange(3), 0.02)
    row = image(mask, seen.row + 1).astype(int) - 1
    told = np.zeros(mask.shape, bool)
    told[1, :5] = told[4, :5] = True  # the right column has black on its right, which comes first
    np.testing.assert_array_equal(row >= 0, told)
    np.testing.assert_allclose(seen.beside[row[1, 2]], np.repeat([0.5, 0.6, 0.7], 3))
    np.testing.assert_allclose(seen.beside[row[4, 2]], 0.1)
    few = seen.part(np.nonzero(seen.row >= 0)[0][::2], np.array([2]))
    assert few.row.tolist() == list(range(5))
    assert few.beside.shape == (5, 3)
    assert (observe(frames, mask, np.arange(3), 0.02, mixed=False).row == -1).all()
