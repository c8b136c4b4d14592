"""The paper's solver on a ball whose pictures our own transport made: its errors fall, and the same seed repeats it."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch

from engine.errors import Cancelled, SurfaceError
from engine.geometry import angle_between, rays
from engine.light.gaussians.gaussians import Y00
from engine.light.incident.probes import gather_probes
from engine.progress import Progress
from engine.reference import solver
from engine.reference.descent import rates
from engine.reference.emitter.two_stage import EmitterParams, EmitterReport
from engine.reference.monte_carlo.shadows import shadows_of
from engine.reference.params import ReferenceParams, scaled, title
from engine.reference.solver import part_of, solve
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.transport import (
    IncidentLight,
    LightTransport,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    pixel_blocks,
    predict,
)
from engine.types import Camera, CapturedScene, Frames, Gaussians, Lamps, Masks, Poses, Surface
from tests.engine.box_room import look
from tests.engine.light import clouds

CAMERA = Camera(16, 12, 22.0, 22.0, 8.0, 6.0)
VIEWS, DISTANCE = 14, 0.5
ALBEDO, ROUGHNESS = np.array([0.7, 0.45, 0.25]), 0.5
NO_LAMPS = Lamps(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, bool))


def light() -> Gaussians:
    """A dim sphere around the origin with two wide bright sides, which the views turn under."""
    shell = clouds.shell(1.0, 3.0, 300)
    shell = replace(shell, scales=1.6 * shell.scales)
    level = np.full(300, 0.3)
    for side, bright in (([0.3, -0.9, 0.3], 5.0), ([-0.8, -0.2, -0.6], 3.0)):
        level[np.argsort(-shell.means @ side)[:30]] = bright
    return replace(shell, radiance=np.repeat(level[:, None, None], 3, 2) / Y00)


def ball() -> Surface:
    """What is to be found."""
    ray, centre, radius = rays(CAMERA), np.array([0, 0, 0.6]), 0.11
    along = ray @ centre
    root = along**2 - centre @ centre + radius**2
    mask = root > 4e-4
    points = (along - np.sqrt(np.maximum(root, 0)))[..., None] * ray
    nothing = np.zeros(mask.shape)
    return Surface(
        mask, (points - centre) / radius * mask[..., None], ALBEDO * mask[..., None], ROUGHNESS * mask,
        points[..., 2] * mask, nothing, nothing, nothing, nothing, nothing.astype(np.uint8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def session() -> tuple[Frames, Masks, Poses]:
    """Pictures by the transport matrix, of light gathered in direction cells."""
    truth, cells = ball(), direction_cells(600)
    poses = np.stack(
        [look(2 * np.pi * i / VIEWS, 0.4 * np.sin(2.4 * i), 0.0, np.zeros(3)) for i in range(VIEWS)]
    )
    middle = np.array([[0, 0, DISTANCE]])
    energy = gather_probes(light(), poses, middle, cells, 32).energy
    lattice = ProbeGrid(np.array([0, 0, DISTANCE]), np.array([0, 0, DISTANCE]), (1, 1, 1))
    flat_energy = np.ascontiguousarray(energy[:, 0].transpose(1, 0, 2).reshape(1, len(cells), -1))
    incident = IncidentLight(lattice, cells, flat_energy, AreaLights.none(VIEWS, len(cells)))
    points = rays(CAMERA) / rays(CAMERA)[..., 2:] * truth.depth[..., None]
    sight = SurfaceGeometry(points[truth.mask], -rays(CAMERA)[truth.mask], None)
    count = int(truth.mask.sum())
    responses = LightTransport(incident, np.zeros((count, 3 * VIEWS), np.float32), False, False, "cpu")
    radiance = np.full((VIEWS, CAMERA.height, CAMERA.width, 3), 0.6, np.float32)
    for pixels, answer in predict(
        responses, sight, pixel_blocks(truth.mask), truth.normal[truth.mask], np.tile(ALBEDO, (count, 1)),
        np.full(count, ROUGHNESS),
    ):  # fmt: skip
        v, u = (x[pixels] for x in np.nonzero(truth.mask))
        radiance[:, v, u] = answer.transpose(1, 0, 2)
    nothing = np.zeros(radiance.shape[:3], bool)
    frames = Frames(tuple(map(str, range(VIEWS))), radiance, nothing, nothing, (1e-6, 1e-6))
    placed = Poses(CAMERA, poses, np.ones(VIEWS, bool), np.zeros((0, 3)), "given", np.nan)
    return frames, Masks(truth.mask, np.broadcast_to(~truth.mask, nothing.shape).copy()), placed


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A start that is wrong by some ten degrees, and knows no albedo."""
    lean = np.random.default_rng(0).normal(0, 0.15, (CAMERA.height, CAMERA.width, 3))
    path = tmp_path_factory.mktemp("start") / "maps.npz"
    normal = ball().normal + lean * [1, 1, 0.2]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    np.savez(path, normal=normal, roughness=np.full(lean.shape[:2], 0.6))
    return str(path)


def few(maps: str, **changes) -> ReferenceParams:
    """Few samples and epochs, and rates that get somewhere in them."""
    params = replace(
        scaled(48, 24), initial_normals=maps, object_distance=DISTANCE, normal_rate=6e-3, albedo_rate=5e-2,
        roughness_rate=5e-2, validation_views=2,
    )  # fmt: skip
    return replace(params, **changes)


def run(session, params: ReferenceParams, seed: int = 0, progress: Progress | None = None):
    frames, masks, poses = session
    captured = CapturedScene(frames, masks, poses, light(), NO_LAMPS)
    return solve(captured, params, "cpu", seed, progress or Progress())


def errors(found: Surface) -> tuple[float, float]:
    truth, at = ball(), found.mask
    angle = np.degrees(angle_between(found.normal[at], truth.normal[at]))
    return float(angle.mean()), float(np.abs(found.albedo[at] - truth.albedo[at]).mean())


def test_errors_fall_on_pictures_that_another_model_made(session, maps: str) -> None:
    before, found = run(session, few(maps, epochs=0)).surface, run(session, few(maps))
    after, renders, emitters, report = found.surface, found.renders, found.emitters, found.report
    (angle, albedo), (angle_now, albedo_now) = errors(before), errors(after)
    assert angle > 8
    assert angle_now < 0.7 * angle
    assert albedo_now < 0.4 * albedo
    assert report.colour_loss[-1] < 0.6 * report.colour_loss[0]
    assert renders.views == report.held_out_views
    assert report.held_out_error < 0.25
    np.testing.assert_allclose(np.linalg.norm(after.normal[after.mask], axis=1), 1, atol=1e-5)
    assert len(emitters.gaussians.means) == len(light().means)
    assert emitters.patches == 0
    assert report.pixels == report.object_pixels == after.mask.sum()
    drawn = report.pixels * report.fitted_views * report.samples * report.epochs
    assert report.seconds_per_sample == pytest.approx(report.seconds / drawn)
    assert report.published_seconds == pytest.approx(report.seconds / 48 / 24 * 256 * 100)


def test_the_same_seed_repeats_and_another_draws_otherwise(session, maps: str) -> None:
    params = few(maps, epochs=2, samples=8, pixels=20)
    one, two, other = (run(session, params, seed).surface for seed in (3, 3, 4))
    for name in ("mask", "normal", "albedo", "roughness", "depth"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert (one.normal != other.normal).any()
    assert one.mask.sum() == other.mask.sum() == 20


def test_the_ablation_finds_its_way_too(session, maps: str) -> None:
    report = run(session, few(maps, emitter_sampling=False, epochs=12, pixels=24)).report
    assert report.colour_loss[-1] < 0.7 * report.colour_loss[0]
    assert report.title == "reference at 48 samples, 12 epochs, without emitter sampling"


def test_a_view_kept_out_is_the_mean_of_several_renderings(
    session, maps: str, monkeypatch: pytest.MonkeyPatch
):
    drawn: list[np.ndarray] = []
    render = solver.render

    def spy(*given):
        drawn.append(render(*given)[0].cpu().numpy())
        return drawn[-1][None]

    monkeypatch.setattr(solver, "render", lambda *given: torch.as_tensor(spy(*given)))
    solved = run(session, few(maps, epochs=0, samples=4, pixels=16, validation_views=1))
    found, renders = solved.surface, solved.renders
    assert len(drawn) == solver.PICTURES > 1
    assert (drawn[0] != drawn[1]).any()
    np.testing.assert_allclose(renders.radiance[0][found.mask], np.mean(drawn, axis=0), rtol=1e-5)


@pytest.mark.parametrize("stages", ["two_stage", "one_stage"])
def test_the_papers_own_light_takes_the_place_of_ours(
    session, maps: str, stages: Literal["two_stage", "one_stage"], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[EmitterParams] = []
    other = replace(light(), radiance=3 * light().radiance)

    def train(frames, masks, poses, params: EmitterParams, seed: int, progress: Progress):
        asked.append(params)
        return other, EmitterReport(len(other.means), 1.0, 0.1, VIEWS)

    monkeypatch.setattr("engine.reference.emitter.light.train", train)
    params = few(maps, epochs=0, samples=4, pixels=16, emitter=stages, emitter_share=0.1, emitter_most=500)
    solved = run(session, params)
    emitters, report = solved.emitters, solved.report
    assert emitters.gaussians is other
    assert len(emitters.lamps.radii) == 0
    assert (report.emitter, report.gaussians) == (stages, 300)
    assert (asked[0].iterations, asked[0].most) == (3000, 500)
    assert asked[0].one_stage == (stages == "one_stage")
    assert report.title.endswith(
        f"the paper's light in {stages.replace('_', ' ')}{'s' * (stages == 'two_stage')},"
        " 0.1 of the iterations, 500 Gaussians at most"
    )
    run(session, replace(params, emitter="ours"))
    assert len(asked) == 1


def test_a_stop_is_heard_between_steps(session, maps: str) -> None:
    told: list[str] = []
    progress = Progress(lambda fraction, note: told.append(note), lambda: "epoch 2 of 24" in told)
    with pytest.raises(Cancelled):
        run(session, few(maps), progress=progress)
    assert not any("epoch 3" in note for note in told)


def test_the_mesh_is_made_anew_each_epoch(session, maps: str, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = []

    def spy(points: np.ndarray, *rest):
        meshes.append(points.copy())
        return shadows_of(points, *rest)

    monkeypatch.setattr(solver, "shadows_of", spy)
    run(session, few(maps, epochs=3, samples=4, depth_rate=1e-3))
    assert len(meshes) == 4  # and once for the views kept out
    assert all((a != b).any() for a, b in pairwise(meshes))


def test_rates_are_halved_every_so_many_epochs() -> None:
    first = (5e-4, 1e-2)
    assert rates(first, 24, 25) == first
    assert rates(first, 25, 25) == (2.5e-4, 5e-3)
    assert rates(first, 99, 25) == (6.25e-5, 1.25e-3)
    assert rates(first, 99, 0) == first


def test_a_scaled_schedule_keeps_its_proportions_and_says_so() -> None:
    assert scaled(256, 100) == ReferenceParams()
    assert title(ReferenceParams()) == "reference as published"
    short = scaled(16, 10)
    assert (short.halve_every, short.smooth_epochs) == (2, 5)
    assert title(short) == "reference at 16 samples, 10 epochs"


def test_a_part_of_the_pixels_comes_in_tiles_from_all_over() -> None:
    mask = np.zeros((60, 80), bool)
    mask[5:55, 10:70] = True
    part = part_of(mask, 320, 0)
    assert part.sum() == 320
    assert not (part & ~mask).any()
    beside = part[:, 1:] & part[:, :-1]
    assert beside.sum() > 0.6 * 320  # in tiles of 4 x 4, 12 of 16 have a neighbour to the right
    assert np.ptp(np.nonzero(part)[0]) > 30
    assert (part_of(mask, 320, 0) == part).all()
    assert (part_of(mask, 320, 1) != part).any()
    assert (part_of(mask, 0, 0) == mask).all()


def test_maps_that_do_not_fit_are_refused_before_anything_is_solved(session, tmp_path: Path) -> None:
    np.savez(tmp_path / "maps.npz", normal=-ball().normal)
    with pytest.raises(SurfaceError, match="look away"):
        run(session, few(str(tmp_path / "maps.npz")))
