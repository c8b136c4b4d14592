"""What only the object tells: pictures under a light that was changed behind the solver's back.

The pictures come from the solver's own rows, so this tests the joint step and its gauge, not the model.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.geometry import rays, tangents
from engine.progress import Progress
from engine.surface.data.observations import observe
from engine.surface.lighting import light_calibration
from engine.surface.lighting.distance_search import find_distance
from engine.surface.lighting.emitter_groups import CLIPPED, FILLED, KNOWN, UNSEEN
from engine.surface.lighting.grouped_light import GroupedLight
from engine.surface.lighting.light_calibration import (
    CalibrationConfig,
    LightParameters,
    calibrate,
    calibrate_with_distance,
    light_belief,
    light_variance,
    prior_light,
)
from engine.surface.lighting.room_light import RoomLightConfig
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.pixel_sample import PixelSample
from engine.surface.params import SurfaceParams
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.object_pixels import coarse_regions
from engine.surface.rendering.transport import (
    IncidentLight,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    predict,
)
from engine.types import Camera, Frames

CAMERA = Camera(40, 30, 40.0, 40.0, 20.0, 15.0)
VIEWS, CELLS = 24, 600
TRUE_Z = 0.5
RADIUS, COLOUR = 0.1, (1.0, 0.9, 0.8)
AWAY = 0.85


def parts_of_lamps(rng: np.random.Generator, clipped: float, depths: int = 5) -> GroupedLight:
    """Three lamps a metre away, another place in every view, in a dim room; probes at some depths.

    Two are part of the room; the third, of which a share may be clipped, stands apart.
    """
    directions = direction_cells(CELLS)
    lattice = ProbeGrid(np.array([-0.3, -0.25, 0.35]), np.array([0.3, 0.25, 0.7]), (2, 2, depths))
    points = lattice.points()
    energy = np.full((len(points), CELLS, VIEWS, 3), 0.15)
    group = np.full((len(points), CELLS, VIEWS), 3)
    bulb = np.array([0.6, -0.5, 0.33]) / np.linalg.norm([0.6, -0.5, 0.33])
    turned = Rotation.from_quat(np.random.default_rng(11).normal(size=(VIEWS, 4))).as_matrix()
    turned[:, 2, :] *= np.where(
        (turned @ bulb)[:, 2:] > 0.3, -1.0, 1.0
    )  # before the tile rather than behind it
    bulbs = AWAY * (turned @ bulb)[:, None] + [0, 0, TRUE_Z]
    for lamp in range(3):
        for n in range(VIEWS):
            at = rng.normal(size=3) * [1, 1, 0.6] + [0, 0, -0.2]
            at = at / np.linalg.norm(at) * rng.uniform(0.7, 1.0) + [0, 0, TRUE_Z]
            if lamp == 2:
                continue
            away = at - points
            distance = np.linalg.norm(away, axis=1, keepdims=True)
            glow = np.exp(60 * ((away / distance) @ directions.T - 1)) * 9 / distance**2
            energy[:, :, n] += glow[..., None] * COLOUR
            group[:, :, n][glow > 0.15] = lamp
    energy = (energy * 4 * np.pi / CELLS).reshape(len(points), CELLS, -1).astype(np.float32)
    # As much light as the glow of the others has.
    radiance = np.tile(np.float32(9 * 2 / 60 / RADIUS**2) * np.array(COLOUR, np.float32), (VIEWS, 1, 1))
    near = AreaLights(bulbs, np.array([RADIUS]), radiance, CELLS)
    light = IncidentLight(lattice, directions, energy, AreaLights.none(VIEWS, CELLS))
    kind = np.array([KNOWN, KNOWN, CLIPPED if clipped else KNOWN, FILLED], np.uint8)
    across = AWAY * np.stack(tangents(bulb[None]), 1)
    share = np.array([0, 0, clipped, 0], float)
    return GroupedLight(light, group, near, kind, share, 0.15, turned, across)


def sample_of(
    grouped_light: GroupedLight, gain: np.ndarray
) -> tuple[PixelSample, gauss_newton.PixelEstimate, np.ndarray]:
    """A tilted bumpy tile under the light with every group under its gain, at the true distance."""
    mask = np.zeros((30, 40), bool)
    mask[6:24:2, 8:32:2] = True
    rng = np.random.default_rng(5)
    r = rays(CAMERA)[mask]
    normals = rng.normal(0, 0.35, r.shape) + [0, 0, -1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    albedo, roughness = rng.uniform(0.2, 0.7, r.shape), rng.uniform(0.4, 0.7, len(r))
    q = r / r[:, 2:]
    nothing = np.zeros((VIEWS, 30, 40), bool)
    frames = Frames(
        tuple("x" * VIEWS), np.zeros((VIEWS, 30, 40, 3), np.float32), nothing, nothing, (1e-7, 1e-7)
    )
    blank = observe(frames, mask, np.arange(VIEWS), 0.01, mixed=False)
    regions = coarse_regions(mask)
    sample = PixelSample(SurfaceGeometry(q, -r, None), blank, blank.radiance, regions, True, False)
    problem = sample.problem(grouped_light.with_gains(gain), TRUE_Z)
    for pixels, answer in predict(problem.transport, problem.geometry, regions, normals, albedo, roughness):
        rows = np.argwhere(mask)[pixels]
        frames.radiance[:, rows[:, 0], rows[:, 1]] = answer.transpose(1, 0, 2)
    seen = observe(frames, mask, np.arange(VIEWS), 0.01, mixed=False)
    sample = replace(sample, observations=seen, photographed=seen.radiance)
    return sample, gauss_newton.initial_estimate(normals, albedo, roughness), albedo


def so_often(rounds: int, steps: int) -> CalibrationConfig:
    return CalibrationConfig(rounds=rounds, gauss_newton_steps=steps)


def test_distance_is_found_from_the_parallax_of_near_lamps():
    parts = parts_of_lamps(np.random.default_rng(0), False)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    start = prior_light(parts, TRUE_Z * 1.2)
    found, _ = calibrate(start, parts, sample, state, True, False, Progress(), so_often(8, 3))
    assert found.distance == pytest.approx(TRUE_Z, rel=0.01)
    assert 0 < found.distance_stderr < 0.05
    np.testing.assert_allclose(found.gain, 1, rtol=1e-6)  # the light was not to be touched


@pytest.mark.parametrize("off", [0.93, 1.0, 1.08])
def test_the_distance_is_found_from_either_side(off: float):
    """Also where the pixels have made themselves at home at the wrong distance."""
    parts = parts_of_lamps(np.random.default_rng(0), False)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    wrong, state = calibrate(
        prior_light(parts, TRUE_Z * off), parts, sample, state, False, True, Progress(), so_often(3, 3)
    )
    found = calibrate_with_distance(wrong, parts, sample, state, True, Progress(), so_often(2, 3))
    assert found.distance == pytest.approx(TRUE_Z, rel=0.01)
    assert 1e-4 < found.distance_stderr < 0.05


def test_no_distance_is_told_where_every_distance_misfits_alike():
    parts = parts_of_lamps(np.random.default_rng(0), False)
    even = np.full_like(parts.incident.energy, 0.15 * 4 * np.pi / CELLS)
    far = replace(
        parts,
        incident=replace(parts.incident, energy=even),
        area_lights=replace(
            parts.area_lights, centres=parts.area_lights.centres * 1e3, radii=parts.area_lights.radii * 1e3
        ),
    )
    sample, state, _ = sample_of(far, np.ones((4, 3)))
    found = calibrate_with_distance(
        prior_light(far, TRUE_Z), far, sample, state, False, Progress(), so_often(1, 2)
    )
    assert found.distance_stderr > 0.1


@pytest.mark.parametrize(("clipped", "brighter"), [(1.0, 3.5), (0.3, 1.2)])
def test_a_clipped_lamp_is_as_bright_as_the_shading_says(clipped: float, brighter: float):
    parts = parts_of_lamps(np.random.default_rng(1), clipped)
    gain = np.ones((4, 3))
    gain[2] = brighter
    sample, state, albedo = sample_of(parts, gain)
    found, state = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(8, 3)
    )
    np.testing.assert_allclose(found.gain[2], brighter, rtol=0.1)
    np.testing.assert_allclose(found.gain[:2], 1, atol=0.06)
    assert np.median(state.albedo / albedo) == pytest.approx(1, abs=0.05)
    assert found.distance == TRUE_Z
    assert found.distance_stderr == 0


def test_the_less_of_a_lamp_is_clipped_the_better_is_its_light_known():
    shares = np.array([1.0, 0.5, 0.1, 0.001])
    mean, spread = np.array(
        [np.array(light_belief(parts_of_lamps(np.random.default_rng(1), one)))[:, 2] for one in shares]
    ).T
    assert (mean[0], spread[0]) == pytest.approx(CalibrationConfig().clipped_belief)
    assert (np.diff(mean) < 0).all()
    assert (np.diff(spread) <= 0).all()
    assert (mean[-1], spread[-1]) == pytest.approx((0, 0.15), abs=1e-5)


def test_the_sum_of_light_that_is_not_clipped_stays_the_backgrounds():
    parts = parts_of_lamps(np.random.default_rng(2), False)
    sample, state, _ = sample_of(parts, np.full((4, 3), 1.3))  # as if the whole room were brighter
    found, _ = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(4, 3)
    )
    levels = parts.levels()
    np.testing.assert_allclose((levels * found.gain).sum(0) / levels.sum(0), 1, atol=0.02)


def test_light_that_no_photograph_shows_is_as_bright_as_the_shading_says():
    parts = parts_of_lamps(np.random.default_rng(6), False)
    kind = parts.kind.copy()
    kind[1] = UNSEEN
    parts = replace(parts, kind=kind)
    gain = np.ones((4, 3))
    gain[1] = [5.0, 4.0, 0.4]
    sample, state, albedo = sample_of(parts, gain)
    found, state = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(10, 3)
    )
    np.testing.assert_allclose(found.gain[1], gain[1], rtol=0.1)
    np.testing.assert_allclose(found.gain[[0, 2]], 1, atol=0.06)
    assert np.median(state.albedo / albedo) == pytest.approx(1, abs=0.05)
    share = parts.unseen_share(found.gain)
    dark = parts.unseen_share(np.where(parts.unseen[:, None], 0, found.gain))
    assert dark == 0
    assert parts.unseen_share(np.ones((4, 3))) < share < 1


def test_distance_and_unseen_light_are_found_from_nothing():
    """Where the ceiling's lamp is in no photograph, normals that are sought without it are all wrong."""
    parts = parts_of_lamps(np.random.default_rng(7), False, depths=3)
    kind = parts.kind.copy()
    kind[:2] = UNSEEN
    parts = replace(parts, kind=kind)
    gain = np.ones((4, 3))
    gain[:2] = [[12.0], [4.0]]
    sample, _, _ = sample_of(parts, gain)
    told = find_distance(parts, sample, SurfaceParams(), Progress())
    found, layers = told.light_parameters, parts.incident.probe_grid.depths()
    assert found.distance == layers[np.argmin(np.abs(layers - TRUE_Z))]
    assert told.distances == tuple(layers)
    assert found.cost == min(told.misfits)
    np.testing.assert_allclose(np.log(found.gain[:2] / gain[:2]), 0, atol=0.5)
    left = find_distance(parts, sample, SurfaceParams(without=("light_gains",)), Progress())
    assert (left.light_parameters.gain == 1).all()


def nearest_layer(grouped_light: GroupedLight) -> GroupedLight:
    """The light at the layer of probes nearest to the object alone, as where its distance is given."""
    lattice = grouped_light.incident.probe_grid
    z = lattice.points()[:, 2]
    kept = np.abs(z - TRUE_Z) <= np.abs(z - TRUE_Z).min() + 1e-9
    low, high = (np.append(corner[:2], z[kept][0]) for corner in (lattice.low, lattice.high))
    alone = replace(
        grouped_light.incident,
        probe_grid=ProbeGrid(low, high, (2, 2, 1)),
        energy=grouped_light.incident.energy[kept],
    )
    return replace(grouped_light, incident=alone, group=grouped_light.group[kept])


@pytest.mark.parametrize("given", [False, True])
def test_a_lamp_recorded_at_a_three_hundredth_of_its_radiance_is_found_from_nothing(given: bool):
    parts = parts_of_lamps(np.random.default_rng(8), True, depths=3)
    gain = np.ones((4, 3))
    gain[2] = [250.0, 300.0, 350.0]
    sample, _, _ = sample_of(parts, gain)
    parts = nearest_layer(parts) if given else parts
    told = find_distance(parts, sample, SurfaceParams(), Progress())
    found, layers = told.light_parameters, parts.incident.probe_grid.depths()
    assert found.distance == layers[np.argmin(np.abs(layers - TRUE_Z))]
    assert found.cost == min(told.misfits)
    np.testing.assert_allclose(np.log(found.gain[2] / gain[2]), 0, atol=0.5)
    left = find_distance(parts, sample, SurfaceParams(without=("light_gains",)), Progress()).light_parameters
    np.testing.assert_array_equal(left.gain, prior_light(parts, TRUE_Z).gain)


def test_a_clipped_lamp_is_never_dimmer_than_it_was_recorded():
    parts = parts_of_lamps(np.random.default_rng(3), True)
    gain = np.ones((4, 3))
    gain[2] = 0.5
    sample, state, _ = sample_of(parts, gain)
    found, _ = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(6, 3)
    )
    assert (found.gain[2] >= 1).all()


def test_settings_of_one_light_add_up_to_it():
    parts = parts_of_lamps(np.random.default_rng(4), True)
    gain = np.random.default_rng(0).uniform(0.5, 2, (4, 3))
    point = np.array([0.03, -0.02, 0.47])
    np.testing.assert_allclose(parts.at(point, gain).sum(0), parts.with_gains(gain).at(point), rtol=1e-5)
    light = parts.with_gains(gain)
    whole = light.energy.reshape(-1, 3).sum(0, dtype=float)
    whole += light.area_lights.levels(light.probe_grid.points()).sum(0)
    np.testing.assert_allclose((parts.levels() * gain).sum(0), whole, rtol=1e-4)
    assert isinstance(prior_light(parts, 1.0), LightParameters)


def drifted(sample: PixelSample, drift: np.ndarray) -> PixelSample:
    """The same photographed with every view's log exposure off."""
    return sample.with_exposure_compensated(-drift)


def jitter(spread: float) -> np.ndarray:
    drift = np.random.default_rng(8).normal(0, spread, VIEWS)
    return drift - drift.mean()


def test_exposures_that_drift_by_3_percent_are_known_to_half_a_percent():
    parts = replace(
        parts_of_lamps(np.random.default_rng(9), False), exposure_sigma=RoomLightConfig().exposure_sigma
    )
    sample, state, albedo = sample_of(parts, np.ones((4, 3)))
    drift = jitter(0.03)
    sample = drifted(sample, drift)
    found, state = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(6, 3)
    )
    assert np.abs(found.exposure_offset - drift).max() < 0.005
    assert abs(found.exposure_offset.mean()) < 1e-4
    assert np.median(state.albedo / albedo) == pytest.approx(1, abs=0.01)
    left, _ = calibrate(
        prior_light(parts, TRUE_Z),
        replace(parts, exposure_sigma=0.0),
        sample,
        state,
        False,
        True,
        Progress(),
        so_often(3, 3),
    )
    assert (left.exposure_offset == 0).all()


def aside_of(grouped_light: GroupedLight) -> np.ndarray:
    """Two degrees, some way."""
    return np.radians(2.0) * np.array([[0.6, -0.8]])


@pytest.mark.parametrize("clipped", [False, True])
def test_a_lamp_two_degrees_off_is_put_right_to_half_a_degree(clipped: bool):
    parts = replace(parts_of_lamps(np.random.default_rng(10), clipped), lamp_offset_sigma=np.radians(0.5))
    true = aside_of(parts)
    sample, state, _ = sample_of(replace(parts, area_lights=parts.lamps_moved(true)), np.ones((4, 3)))
    found, _ = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(8, 3)
    )
    assert np.degrees(np.linalg.norm(found.lamp_offset - true)) < 0.5
    at = parts.with_gains(found.gain, found.lamp_offset).area_lights.centres
    back = np.einsum("nji,nlj->nli", parts.cam_from_world_rotation, at - parts.area_lights.centres)
    np.testing.assert_allclose(
        back, np.broadcast_to(parts.lamp_shift(found.lamp_offset), back.shape), atol=1e-12
    )
    left, _ = calibrate(
        prior_light(parts, TRUE_Z),
        replace(parts, lamp_offset_sigma=0.0),
        sample,
        state,
        False,
        True,
        Progress(),
        so_often(1, 1),
    )
    assert (left.lamp_offset == 0).all()


def test_where_nothing_is_off_nothing_moves():
    parts = replace(
        parts_of_lamps(np.random.default_rng(9), False),
        exposure_sigma=RoomLightConfig().exposure_sigma,
        lamp_offset_sigma=np.radians(0.5),
    )
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    noise = 0.01 * np.random.default_rng(12).normal(size=sample.observations.radiance.shape)
    radiance = (sample.observations.radiance * np.exp(noise)).astype(np.float32)
    sample = replace(
        sample, observations=replace(sample.observations, radiance=radiance), photographed=radiance
    )
    found, _ = calibrate(
        prior_light(parts, TRUE_Z), parts, sample, state, False, True, Progress(), so_often(6, 3)
    )
    # 108 pixels in three channels tell a view's mean to 0.6 permille, were their residuals all their own.
    assert found.exposure_offset.std() < 0.002
    assert np.degrees(np.linalg.norm(found.lamp_offset)) < 0.2


def test_pixels_follow_the_light_as_its_doubt_takes_it():
    """Solved under a lamp that is a little brighter, albedo and roughness have moved as the derivative says."""
    parts = parts_of_lamps(np.random.default_rng(0), True)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    setting = replace(prior_light(parts, TRUE_Z), gain=np.ones((4, 3)))

    def solved(gain: np.ndarray) -> gauss_newton.PixelEstimate:
        problem = sample.problem(parts.with_gains(gain), TRUE_Z)
        return gauss_newton.minimize(
            gauss_newton.update_residual_scale(state, problem), problem, 12, Progress()
        )

    at = solved(setting.gain)
    following = light_calibration._Linearization(setting, parts, sample, at).equations().following
    lamp, step = 2, 0.01
    brighter = setting.gain.copy()
    brighter[lamp] *= np.exp(step)
    moved = solved(brighter)
    told = step * following[:, :, 3 * lamp : 3 * lamp + 3].sum(2)
    found = np.column_stack([np.log(moved.albedo / at.albedo), moved.roughness - at.roughness])
    for k, wanted in zip((2, 3, 4, 5), found.T, strict=True):
        assert np.corrcoef(told[:, k], wanted)[0, 1] > 0.98
        assert np.median(told[:, k] / wanted) == pytest.approx(1, abs=0.05)


def test_what_the_voters_leave_open_of_the_light_is_less_the_more_they_know():
    parts = parts_of_lamps(np.random.default_rng(0), True)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    setting = replace(prior_light(parts, TRUE_Z), gain=np.ones((4, 3)))
    sharp, blunt = (replace(state, residual_scale=np.full(len(state.roughness), s)) for s in (1.0, 10.0))
    others = sample, sharp
    little, much = (light_variance(setting, parts, (sample, one), others) for one in (sharp, blunt))
    assert (little > 0).all()
    assert (little < much).all()
    certain = replace(parts, kind=np.full_like(parts.kind, FILLED))
    assert np.median(light_variance(setting, certain, (sample, blunt), others) / much) < 0.01
