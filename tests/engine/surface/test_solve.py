"""Which views serve a solve, how many rounds it takes, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from engine.errors import SurfaceError
from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface import solve as solving
from engine.surface.data.scene import Picture, build_scene
from engine.surface.estimate import known
from engine.surface.lighting.room_light import build_room_light, gather_incident_light
from engine.surface.params import PARTS, SurfaceParams
from engine.surface.passes import emitters_of
from engine.surface.schedule import run, schedule
from engine.surface.solve import initial_state, solve
from tests.engine.reference.lit_room import DISTANCE, lambert, metal, scene

METAL = ("detect_metal", "classify_material")


@pytest.mark.parametrize("directions", [400, 1200])
def test_the_light_that_the_coarse_phases_gathered_serves_again_in_its_views_and_the_rest_is_fetched(
    directions: int,
):
    lit = scene(lambert)
    frames, masks, poses, *_ = lit.given
    params = replace(
        SurfaceParams(),
        coarse_views=8,
        coarse_iterations=1,
        directions=directions,
        probe_grid_xy=1,
        probe_grid_z=2,
        probe_resolution=32,
        object_distance=DISTANCE,  # looking for it gathers nothing that serves again
    )
    steady = replace(params, light_groups=4, without=("view_exposures", "lamp_directions"))
    room = build_room_light(lit.captured, steady, 0)
    picture, fitted = Picture(frames, masks.object, poses.camera), np.arange(1, 16)
    seen = build_scene(picture, poses, fitted, (0,), params, "cpu", 0)
    phases = {phase.name: phase for phase in schedule(params, False)}
    looks: list[np.ndarray] = []
    coarse = run(
        seen,
        initial_state(seen, room),
        [phases[name] for name in ("initialise", "coarse", "place", "full")],
        Progress(viewer=lambda make: looks.append(make())),
    )
    # Whoever looks sees normals from the first phase on.
    assert len(looks) == 3
    assert all(np.allclose(np.linalg.norm(look[look.any(-1)], axis=-1), 1, atol=1e-5) for look in looks)
    found = run(seen, coarse, [phases["relight"]], Progress())
    assert found.light is not None
    assert found.validation is not None
    there = poses.cam_from_world[fitted]
    light = found.light
    anew = gather_incident_light(
        light.probe_grid, emitters_of(found), there, directions, params.probe_resolution, Progress()
    )
    assert light.energy.shape == (2, directions, 45)
    assert found.validation.energy.shape == (2, directions, 3)
    np.testing.assert_allclose(light.area_lights.centres, anew.area_lights.centres)
    np.testing.assert_allclose(light.area_lights.radiance, anew.area_lights.radiance, rtol=1e-5)
    np.testing.assert_allclose(light.energy.sum(1), anew.energy.sum(1), rtol=0.01)
    assert (light.probe_grid is known(coarse.grouped_light).incident.probe_grid) == (directions == 400)


def test_a_pass_that_is_left_out_runs_in_no_phase():
    out = ("regularize", "expect_roughness")
    phases, fewer = (schedule(replace(SurfaceParams(), without=of), False) for of in ((), out))
    ran, left = ({one.__name__ for phase in of for one in phase.passes} for of in (phases, fewer))
    assert ran - left == set(out)
    assert [phase.name for phase in fewer] == [phase.name for phase in phases]


def test_every_part_that_can_be_left_out_is_a_part_of_the_model_or_a_pass():
    passes = {one.__name__ for phase in schedule(SurfaceParams(), True) for one in phase.passes}
    assert set(PARTS[-4:]) == passes & set(PARTS)
    with pytest.raises(SurfaceError, match=r'surface\.without is "rim"; give self_shadowing or'):
        SurfaceParams(without=("rim",))


@pytest.mark.parametrize(("material", "together"), [(True, 400_000), (False, 400_000), (True, 400)])
def test_a_metal_ball_is_taken_for_metal(material: bool, together: int):
    """Also where its pixels are solved in tiles."""
    params = replace(
        SurfaceParams(), coarse_views=12, coarse_iterations=2, directions=600, object_distance=DISTANCE,
        without=("self_shadowing", "light_gains", *(() if material else METAL)), tile_above_pixels=together,
        probe_grid_xy=2, probe_resolution=32,
    )  # fmt: skip
    ball = scene(metal(0.5), views=16, lamps=8)
    found = solve(ball.captured, params, "cpu", 0, Progress())
    surface, report = found.surface, found.report
    off = np.degrees(angle_between(surface.normal[surface.mask], ball.normals))
    if not material:
        assert surface.material is None
        assert report.metal == 0
        assert np.median(off) > 5
        return
    assert surface.material is not None
    assert report.metal == pytest.approx(surface.material[surface.mask][:, 1].mean())
    assert report.metal > 0.95
    assert np.median(off) < (1 if together > 1000 else 3)


@pytest.mark.parametrize(("still", "expected"), [(np.pi, 1), (0.0, 3)])
def test_rounds_end_as_soon_as_the_surface_stands_still(
    monkeypatch: pytest.MonkeyPatch, still: float, expected: int
):
    usual = solving.schedule

    def stiller(*asked):
        return tuple(
            replace(phase, still_deg=np.degrees(still)) if phase.name == "fine" else phase
            for phase in usual(*asked)
        )

    monkeypatch.setattr(solving, "schedule", stiller)
    params = replace(
        SurfaceParams(), coarse_views=8, coarse_iterations=1, directions=400, object_distance=1.1, fine_iterations=3, probe_grid_xy=1,
        probe_grid_z=1, probe_resolution=32, without=("self_shadowing", "light_gains", *METAL),
    )  # fmt: skip
    report = solve(scene(lambert).captured, params, "cpu", 0, Progress()).report
    assert sum(one.phase == "fine" for one in report.history) == expected


def test_the_fewest_views_that_are_allowed_are_solved():
    """None is kept out of eight, and the rough turns have gathered the light of all."""
    params = replace(
        SurfaceParams(), object_distance=DISTANCE, coarse_iterations=2, directions=400, fine_iterations=1, probe_grid_xy=1,
        probe_grid_z=1, probe_resolution=32, without=METAL,
    )  # fmt: skip
    eight = scene(lambert, views=8)
    found = solve(eight.captured, params, "cpu", 0, Progress())
    surface, renders, report = found.surface, found.renders, found.report
    assert (report.fitted_views, renders.views) == (8, ())
    assert np.degrees(np.median(angle_between(surface.normal[surface.mask], eight.normals))) < 3
    assert surface.part is not None
    assert (surface.part[surface.mask] == 1).mean() == report.depth_parts[0] > 0.9
    assert not surface.part[~surface.mask].any()


def test_smoothing_of_the_normals_moves_no_depth(monkeypatch: pytest.MonkeyPatch):
    """Depth and parts are those that the fine phase judged: integrated once more, those of thin tubes were 19.6 pixel widths off, not 13.5."""
    params = replace(
        SurfaceParams(), object_distance=DISTANCE, coarse_iterations=1, directions=400, fine_iterations=1, probe_grid_xy=1,
        probe_grid_z=1, probe_resolution=32, without=("self_shadowing", "light_gains", *METAL),
    )  # fmt: skip
    room = scene(lambert, views=8).captured
    smooth, rough = (
        solve(room, replace(params, without=without), "cpu", 0, Progress()).surface
        for without in (params.without, (*params.without, "regularize"))
    )
    assert not np.array_equal(smooth.normal, rough.normal)
    np.testing.assert_array_equal(smooth.depth, rough.depth)


def test_of_three_solves_every_pixel_has_the_answer_nearest_to_all():
    lit = scene(lambert)
    params = replace(
        SurfaceParams(), coarse_views=8, coarse_iterations=1, directions=400, object_distance=1.1, fine_iterations=1, probe_grid_xy=1,
        probe_grid_z=1, probe_resolution=32, without=("self_shadowing", *METAL),
    )  # fmt: skip
    solved = [solve(lit.captured, replace(params, solves=count), "cpu", 0, Progress()) for count in (1, 3)]
    (once, thrice), mask = solved, solved[0].surface.mask
    apart = angle_between(once.surface.normal, thrice.surface.normal)[mask]
    assert 0 < np.degrees(apart).mean() < 2
    assert [one.phase for one in thrice.report.history[-2:]] == ["fine", "finish"]
