"""The light's benchmark adds up right: energy, irradiance, peaks and angles worked out by hand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.geometry import compose, fibonacci_sphere
from engine.hdr import merge
from engine.hdr.params import HdrParams
from engine.light.gaussians.gaussians import Y00
from engine.light.incident.probes import panorama_directions
from engine.pipeline import artifacts
from engine.progress import Progress
from engine.types import Camera, Emitters, Gaussians, Lamps, Masks, Poses
from hardware.errors import StudioError
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.rooms import Globe, Room
from hardware.virtual.studio.solids import Solid
from tests.bench import emitters, incident, light, light_sets
from tests.engine import brackets_on_disk
from tests.engine.light import clouds

DIRECTIONS = fibonacci_sphere(1024)
NORMALS = fibonacci_sphere(200)


@pytest.fixture(autouse=True)
def small_probes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(light_sets, "FACE", 48)


@pytest.fixture(scope="module")
def onto() -> incident.Binning:
    return incident.binning(DIRECTIONS, 32)


def test_cells_share_out_the_whole_sphere(onto: incident.Binning) -> None:
    assert onto.solid_angle.sum() == pytest.approx(4 * np.pi, rel=1e-12)
    np.testing.assert_allclose(onto.solid_angle, 4 * np.pi / 1024, rtol=0.25)
    even = incident.binned(np.full((32, 64, 3), 2.0), onto)
    assert even.sum(0) == pytest.approx(8 * np.pi, rel=1e-12)


def test_one_bright_pixel_keeps_its_energy_and_direction(onto: incident.Binning) -> None:
    panorama = np.zeros((32, 64, 3))
    panorama[9, 50] = 5.0
    energy = incident.binned(panorama, onto)
    edges = np.cos(np.pi * np.array([9, 10]) / 32)
    assert energy[:, 0].sum() == pytest.approx(5 * (edges[0] - edges[1]) * 2 * np.pi / 64, rel=1e-9)
    turn = incident.centroid(energy, DIRECTIONS) @ panorama_directions(32)[9, 50]
    assert np.degrees(np.arccos(turn)) < 0.3


def test_a_tenth_too_much_light_is_ten_percent_however_it_is_counted(onto: incident.Binning) -> None:
    true = incident.binned(np.random.default_rng(0).uniform(1, 2, (32, 64, 3)), onto)
    error = incident.irradiance_error(1.1 * true, true, DIRECTIONS, NORMALS)
    assert error.own_mean == pytest.approx(10)
    assert error.own_p95 == pytest.approx(10)
    assert error.mean == pytest.approx(10)
    assert error.p95 > error.mean


def test_irradiance_of_one_direction_worked_by_hand() -> None:
    directions = np.array([[0.0, 0, 1], [1, 0, 0]])
    normals = np.array([[0.0, 0, 1], [0.6, 0, 0.8]])
    true, ours = np.array([[2.0] * 3, [0] * 3]), np.array([[2.0] * 3, [1] * 3])
    # True 2 and 1.6, ours 2 and 2.2: off by 0 and 0.6, where the mean is 1.8.
    error = incident.irradiance_error(ours, true, directions, normals)
    assert error.mean == pytest.approx(100 * 0.3 / 1.8)
    assert error.own_mean == pytest.approx(50 * 0.6 / 1.6)


def test_the_brightest_are_those_of_most_radiance_and_fill_their_share() -> None:
    energy = np.array([[4.0] * 3, [3] * 3, [1] * 3, [1] * 3])
    solid_angle = np.array([8.0, 1, 1, 2])
    np.testing.assert_array_equal(incident.brightest(energy, solid_angle, 0.05), [False, True, False, False])
    np.testing.assert_array_equal(incident.brightest(energy, solid_angle, 0.15), [False, True, True, False])


def test_dim_peaks_are_told_apart_from_misplaced_ones(onto: incident.Binning) -> None:
    lamp = incident.within(DIRECTIONS, np.array([[0, 0, 1.0]]), 0.15)
    other = incident.within(DIRECTIONS, np.array([[1.0, 0, 0]]), 0.15)
    true, ours = np.full((1, 1024, 3), 1e-6), np.full((1, 1024, 3), 1e-6)
    true[0, lamp], true[0, other] = 1.0, 0.0  # nor may the rest of the brightest fall there by chance
    ours[0, other] = 0.5 * lamp.sum() / other.sum()
    scores = light.energy_scores(ours, true, onto.solid_angle, onto, NORMALS)
    assert scores["brightest"] == pytest.approx(0.5, rel=1e-3)
    assert scores["brightest_in_place"] == pytest.approx(0, abs=1e-3)
    assert scores["total"] == pytest.approx(0.5, rel=1e-2)


def test_cells_within_an_angle_are_counted_from_the_nearest_point() -> None:
    directions = np.array([[0.0, 0, 1], [0, np.sin(0.2), np.cos(0.2)], [0, np.sin(0.4), np.cos(0.4)]])
    np.testing.assert_array_equal(
        incident.within(directions, np.array([[0, 0, 3.0]]), 0.21), [True, True, False]
    )


# Our world: turned, shifted, and 0.25 of our units to the metre, so that a metre is lost if scale is.
SCALE = 4.0
OURS_FROM_TRUE = np.column_stack([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.3, -0.2, 0.5]])
TRUE_POSES = np.stack(
    [
        np.column_stack([np.eye(3), [0.1, 0.0, 0.2]]),
        np.column_stack([[[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]], [0.2, 0.1, 0.0]]),
        np.column_stack([[[1, 0, 0], [0, 0, -1.0], [0, 1, 0]], [-0.1, 0.1, 0.3]]),
    ]
)


def in_our_world(points: np.ndarray) -> np.ndarray:
    return (points @ OURS_FROM_TRUE[:, :3].T + OURS_FROM_TRUE[:, 3]) / SCALE


def our_poses() -> np.ndarray:
    back = OURS_FROM_TRUE[:, :3].T
    poses = compose(
        TRUE_POSES, np.broadcast_to(np.column_stack([back, -back @ OURS_FROM_TRUE[:, 3]]), (3, 3, 4))
    )
    return np.concatenate([poses[:, :, :3], poses[:, :, 3:] / SCALE], 2)


def test_lamp_angles_do_not_depend_on_the_world_and_see_parallax() -> None:
    corners = np.array([[0.0, 0, 0.4], [0, 0, 0.6]])
    lamp = np.array([[0.0, 0, 1.2]]) - TRUE_POSES[0, :, 3]  # (0, 0, 1.2) in the first camera
    aside = lamp + [0.01, 0, 0]
    angles = incident.lamp_angles(
        lamp, in_our_world(np.concatenate([lamp, aside])), TRUE_POSES, our_poses(), SCALE, corners
    )
    assert angles.shape == (1, 2, 3, 2)
    np.testing.assert_allclose(angles[0, 0], 0, atol=1e-9)
    np.testing.assert_allclose(angles[0, 1, 0], np.degrees(np.arctan([0.01 / 0.8, 0.01 / 0.6])), rtol=1e-9)


def test_lamps_are_matched_one_to_one_and_far_ones_not_at_all() -> None:
    angles = np.array([[1.0, 2.0], [0.5, 3.0], [40.0, 50.0]])[:, :, None, None]
    np.testing.assert_array_equal(incident.matched(angles), [1, 0, -1])


def set_of(true_lamp: np.ndarray, our_lamp: np.ndarray, radiance: float) -> light_sets.Set:
    """An even room with one lamp, known in another world than the true one."""
    shell = clouds.shell(0.5)
    centre, radius = in_our_world(our_lamp)[None], np.array([0.1 / SCALE])
    gaussians = Gaussians(
        np.concatenate([in_our_world(shell.means), centre]),
        np.concatenate([shell.quaternions, [[1.0, 0, 0, 0]]]),
        np.concatenate([shell.scales / SCALE, np.full((1, 3), 0.08 / SCALE)]),
        np.append(shell.density, 20.0),
        np.concatenate([shell.radiance, np.full((1, 1, 3), radiance / Y00)]),
    )
    corners = np.stack(np.meshgrid([-0.1, 0.1], [-0.1, 0.1], [0.4, 0.6]), -1).reshape(-1, 3)
    solid = Solid(corners, corners, np.zeros((0, 3), int))
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0)
    poses = Poses(camera, our_poses(), np.ones(3, bool), np.zeros((0, 3)), "unknown", 0.5)
    masks = Masks(np.zeros((48, 64), bool), np.ones((3, 48, 64), bool))
    back = OURS_FROM_TRUE[:, :3].T
    return light_sets.Set(
        name="even-box", light=Path("stages/light/none"), version=1, gaussians=gaussians,
        lamps=Lamps(centre, radius, np.full((1, 3), radiance), np.zeros(1, bool)), masks=masks, poses=poses,
        cam_from_world=our_poses(), views=np.arange(3), true_cam_from_world=TRUE_POSES,
        true_from_ours=np.column_stack([back, -back @ OURS_FROM_TRUE[:, 3]]), scale=SCALE, panoramas=(),
        session_per_studio=2.0, room=Room("even", (), (Globe(true_lamp, 0.1, np.full(3, 20.0)),), (), np.zeros(3)),
        body=Body("box", solid, corners, corners[:, 0]),
    )  # fmt: skip


def true_light(s: light_sets.Set) -> np.ndarray:
    """What a panorama at the object's middle shows of that room."""
    fine, (globe,) = panorama_directions(128), s.room.globes
    onto = incident.binning(DIRECTIONS, 128)
    lights = []
    for pose in s.true_cam_from_world:
        towards = pose[:, :3] @ globe.centre + pose[:, 3] - s.body.solid.vertices.mean(0)
        distance = np.linalg.norm(towards)
        inside = fine @ (towards / distance) > np.sqrt(1 - (globe.radius_m / distance) ** 2)
        lights.append(incident.binned(np.where(inside[..., None], 40.0, [0.5] * 3), onto))
    return np.stack(lights)


def test_a_light_that_is_right_in_another_world_scores_as_right() -> None:
    lamp = np.array([0.5, -0.4, 1.6])
    s = set_of(lamp, lamp, 40.0)
    (fitted,) = light_sets.lights(s)
    ours, opaque = light_sets.our_energy(s, fitted, DIRECTIONS)
    true = true_light(s)
    solid_angle = incident.probe_solid_angle(DIRECTIONS, 96)
    even = ~incident.within(DIRECTIONS, lamp[None] + TRUE_POSES[0, :, 3] - [0, 0, 0.5], 0.3)
    np.testing.assert_allclose((ours[0] / solid_angle[:, None])[even], 0.5, rtol=0.05)
    scores = light.energy_scores(ours, true, solid_angle, incident.binning(DIRECTIONS, 128), NORMALS)
    assert scores["irradiance_mean"] < 1.0
    assert scores["total"] == pytest.approx(1, rel=0.01)
    assert float(opaque.min()) > 0.95
    (found,) = emitters.emitters_of(s, fitted, ours, true, DIRECTIONS)
    assert found.ratio == pytest.approx(1, rel=0.02)
    assert found.off_deg < 0.4
    assert found.lamp is not None
    assert found.lamp.corners_worst_deg < 1e-6
    assert found.lamp.off_cm == pytest.approx(0, abs=1e-6)
    assert (found.lamp.radius, found.lamp.radiance) == (pytest.approx(1), pytest.approx(1))


def test_a_lamp_that_is_dim_and_off_is_told_by_how_much() -> None:
    lamp = np.array([0.5, -0.4, 1.6])
    s = set_of(lamp, lamp + [0, 0.05, 0], 10.0)
    (fitted,) = light_sets.lights(s)
    ours, _ = light_sets.our_energy(s, fitted, DIRECTIONS)
    (found,) = emitters.emitters_of(s, fitted, ours, true_light(s), DIRECTIONS)
    assert found.lamp is not None
    assert found.lamp.radiance == pytest.approx(0.25)
    assert found.lamp.off_cm == pytest.approx(5)
    assert 1 < found.lamp.corners_worst_deg < 5
    assert found.ratio < 0.35
    scores = light.lamp_scores([found], ours=3)
    assert (scores["lamps_found"], scores["lamps_true"], scores["lamps_false"]) == (1, 1, 2)


def test_a_refined_light_takes_the_gains_of_the_surface_that_was_solved_with_it(tmp_path: Path) -> None:
    lamp = np.array([0.5, -0.4, 1.6])
    s = replace(set_of(lamp, lamp, 40.0), light=tmp_path / "light" / "mine")
    finish(tmp_path / "surface" / "other", 9.0, inputs={"light": "another"})
    made = finish(tmp_path / "surface" / "made", 1.0, inputs={"light": "mine"})
    brighter = replace(s.gaussians, radiance=2 * s.gaussians.radiance)
    lamps = replace(s.lamps, radiance=3 * s.lamps.radiance)
    artifacts.save(made, "emitters", Emitters(brighter, lamps, 0))
    fitted, refined = light_sets.lights(s)
    np.testing.assert_allclose(refined.field.radiance, 2 * fitted.field.radiance)
    np.testing.assert_allclose(refined.lamps.radiance, 3 * fitted.lamps.radiance)


def test_studio_radiance_becomes_what_the_merge_makes_of_it(tmp_path: Path) -> None:
    grey = brackets_on_disk.write(tmp_path, "grey", np.full((64, 96, 3), 0.4), 0.21)
    frames, report = merge.merge([grey], HdrParams(), Progress())
    assert np.median(frames.radiance) == pytest.approx(
        0.4 * light_sets.session_per_studio(report.scale), rel=0.01
    )


def finish(folder: Path, at: float, **facts: object) -> Path:
    folder.mkdir(parents=True)
    (folder / "record.json").write_text(json.dumps({"finished": at, "inputs": {}, **facts}))
    return folder


def test_the_light_that_was_finished_last_is_the_one(tmp_path: Path) -> None:
    finish(tmp_path / "stages" / "light" / "b", 2.0)
    finish(tmp_path / "stages" / "light" / "a", 3.0)
    finish(tmp_path / "stages" / "light" / "c.partial", 4.0)
    found = light_sets.newest_light(tmp_path)
    assert found is not None
    assert found.name == "a"


def test_a_set_without_light_is_named_with_the_command_that_makes_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for part in ("session", "truth"):
        (tmp_path / "study-blob" / part).mkdir(parents=True)
    assert light.main([str(tmp_path)]) == 2
    assert f"roomlight process {tmp_path / 'study-blob' / 'session'}" in capsys.readouterr().err


def test_fitted_and_refined_lights_have_a_mean_each() -> None:
    rows = [
        light.Row(name, refined, 4, 96, dict.fromkeys((key for _, key, _ in light.COLUMNS), value), ())
        for name, refined, value in (
            ("a-b", False, 1.0),
            ("a-b", True, 5.0),
            ("c-d", False, 3.0),
            ("c-d", True, 9.0),
        )
    ]
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in light.table(rows).splitlines()[2:]
    ]
    told = {line[0]: line[1] for line in lines}
    assert (told["a-b"], told["a-b, refined"]) == ("1.00", "5.00")
    assert (told["mean"], told["mean, refined"]) == ("2.00", "7.00")


def test_the_light_of_a_set_of_the_benchmark_lies_where_poses_were_given(tmp_path: Path) -> None:
    assert light_sets.session_of(tmp_path) is None
    finish(tmp_path / "given.session" / "stages" / "light" / "a", 1.0)
    assert light_sets.session_of(tmp_path) == tmp_path / "given.session"
    finish(tmp_path / "session" / "stages" / "light" / "a", 0.5)
    assert light_sets.session_of(tmp_path) == tmp_path / "session"
    assert light_sets.names_of("study-blob-gimbal-48x320x240-seed0-studio4") == ("study", "blob")
    with pytest.raises(StudioError, match="ROOM-OBJECT"):
        light_sets.names_of("study")


def scored(refined: bool, clipped: bool, irradiance: float, deg: float = 0.5) -> light.Row:
    scores: dict[str, float | None] = {
        "irradiance_mean": irradiance,
        "irradiance_p95": 9.0,
        "brightest_off": 6.0,
        "lamps_worst_deg": deg,
    }
    lamp = emitters.Lamp(deg, deg, 1.0, 1.0, 1.0, clipped)
    globes = tuple(emitters.Emitter("globe", (0.0, 0.0, 0.0), 1.0, 1.0, 0.1, found) for found in (lamp, None))
    return light.Row("lamps-blob", refined, 6, 48, scores, globes)


def test_a_lower_bound_is_judged_by_its_refined_row_and_directions_as_fitted() -> None:
    (said,) = light.judged([scored(False, True, 35.0), scored(True, True, 3.0)])
    assert "1 lamps clipped, a lower bound" in said
    assert "of the refined row, mean met, p95 met, brightest MISSED; lamps as fitted met, 1 not found" in said
    (said,) = light.judged([scored(False, True, 3.0, 1.2)])
    assert said.endswith("there is none of: process on to the surface; lamps as fitted MISSED, 1 not found")
    (said,) = light.judged([scored(False, False, 35.0), scored(True, False, 3.0)])
    assert "as fitted, mean MISSED" in said
