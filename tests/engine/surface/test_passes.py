"""Every pass by itself, on one estimate of a glossy ball near its lamps that the coarse phases have left."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface import passes
from engine.surface.data.scene import Picture, Scene, build_scene
from engine.surface.estimate import Estimate, known
from engine.surface.lighting.room_light import build_room_light
from engine.surface.params import SurfaceParams
from engine.surface.passes import Pass
from engine.surface.schedule import run, schedule, validation_error
from engine.surface.solve import initial_state
from engine.surface.uncertainty.model_parts import part_worths
from tests.engine.reference.lit_room import glossy, scene

ROUGHNESS = 0.5
BALL = scene(glossy(ROUGHNESS), lamp_distance=1.4, views=16)
PARAMS = replace(
    SurfaceParams(), coarse_views=15, coarse_iterations=2, directions=400, probe_grid_xy=2, probe_grid_z=2,
    probe_resolution=24, object_distance=float(BALL.points[:, 2].mean()),
)  # fmt: skip


@pytest.fixture(scope="module")
def saved() -> tuple[Scene, Estimate]:
    frames, masks, poses, *_ = BALL.given
    steady = replace(PARAMS, light_groups=4, without=("view_exposures", "lamp_directions"))
    room = build_room_light(BALL.captured, steady, 0)
    picture = Picture(frames, masks.object, poses.camera)
    seen = build_scene(picture, poses, np.arange(1, 16), (0,), PARAMS, "cpu", 0)
    phases = [one for one in schedule(PARAMS, False) if one.name in ("initialise", "coarse", "place")]
    return seen, run(seen, initial_state(seen, room), phases, Progress())


def after(saved: tuple[Scene, Estimate], one: Pass, **changes) -> Estimate:
    """What a pass makes of the saved estimate, some of whose pixels' answers are others."""
    seen, now = saved
    return one(seen, replace(now, state=replace(known(now.state), **changes)), Progress())


def turned(normals: np.ndarray, degrees: float) -> np.ndarray:
    rng = np.random.default_rng(0)
    return Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=normals.shape)).apply(normals)


def off_deg(now: Estimate) -> float:
    return float(np.degrees(angle_between(known(now.state).normals, BALL.normals)).mean())


def test_search_normals_runs_again_where_the_light_has_gone_to_other_groups(saved):
    seen, now = saved
    shares = known(now.grouped_light).shares(known(now.light_parameters).gain)
    moved = shares.copy()
    moved[[0, -1]] += [-0.2, 0.2]
    for before, again in ((shares, False), (moved, True), (shares[:-1], True), ((), True)):
        given = replace(now, searched_shares=tuple(before))
        found = passes.search_normals(seen, given, Progress())
        assert (found is not given) == again
        assert found.searched_shares == tuple(shares)


def test_solve_pixels_finds_normals_that_were_lost(saved):
    lost = turned(known(saved[1].state).normals, 5)
    assert np.degrees(angle_between(lost, BALL.normals)).mean() > 5
    assert off_deg(after(saved, passes.solve_pixels, normals=lost)) < 1.5


def test_expect_roughness_draws_pixels_towards_those_that_look_alike(saved):
    before, found = (
        known(saved[1].state).roughness,
        known(after(saved, passes.expect_roughness).state).roughness,
    )
    assert abs(np.median(found) - ROUGHNESS) < 0.03
    assert np.std(found) <= np.std(before)


def test_integrate_depth_lies_where_the_ball_does(saved):
    found = after(saved, passes.integrate_depth, normals=BALL.normals)
    z = known(found.depth)[saved[0].picture.mask]
    assert np.median(np.abs(z / z.mean() - BALL.points[:, 2] / BALL.points[:, 2].mean())) < 0.004


def test_trace_visibility_of_a_ball_hides_next_to_nothing(saved):
    hidden = after(saved, passes.trace_visibility).geometry.visibility
    assert hidden is not None
    assert hidden.is_nearly_convex


def test_calibrate_light_in_place_undoes_a_gain(saved):
    seen, now = saved
    right = known(now.light_parameters)
    brightest = int(np.argmax(known(now.grouped_light).incident.energy.sum((0, 1, 2)))) % len(right.gain)
    gain = right.gain.copy()
    gain[brightest] *= 1.3
    wrong = replace(now, light_parameters=replace(right, gain=gain))
    found = known(passes.calibrate_light_in_place(seen, wrong, Progress()).light_parameters)
    assert np.abs(np.log(found.gain[brightest] / right.gain[brightest])).max() < 0.1
    assert found.distance == right.distance


def test_refine_distance_moves_the_object_to_where_it_stands(saved):
    seen, now = saved
    true = BALL.points[:, 2].mean()
    away = now.with_light_parameters(replace(known(now.light_parameters), distance=1.1 * true))
    free = replace(seen, params=replace(PARAMS, object_distance=0.0))
    found = passes.refine_distance(free, away, Progress())
    assert abs(found.distance.value / true - 1) < 0.05
    assert found.distance.stderr > 0


def test_regularize_lets_neighbours_agree_and_loses_nothing(saved):
    found = after(saved, passes.regularize)
    assert found.regularized
    assert 0 < np.degrees(angle_between(known(found.state).normals, known(saved[1].state).normals)).max() < 5
    assert off_deg(found) < off_deg(saved[1]) + 0.05


def test_classify_material_takes_paint_for_paint(saved):
    material = after(saved, passes.classify_material).object_pixels.material
    assert material is None or not material[:, 1].any()


def test_gather_light_renders_the_view_that_was_kept_out(saved):
    seen, now = saved
    assert validation_error(seen, now).size == 0
    found = passes.gather_light(seen, now, Progress())
    assert found.validation is not None
    assert np.median(validation_error(seen, found)) < 0.03


def test_a_convex_glossy_ball_near_its_lamps_asks_for_light_by_place_and_gloss_alone(saved):
    seen = replace(saved[0], fitted=np.arange(2, 16), validation=np.array([0, 1]))
    found = passes.gather_light(seen, saved[1], Progress())
    worth = {one.part: one for one in part_worths(seen, found)}
    assert {name for name, one in worth.items() if one.gain > 0.01} == {"light by place", "gloss"}
    assert worth["light by place"].gain > worth["light by place"].stderr
    assert abs(worth["visibility"].gain) < 0.005
    assert part_worths(replace(seen, validation=np.array([0])), found) == ()
