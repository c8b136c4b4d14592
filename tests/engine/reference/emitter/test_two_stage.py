"""The paper's two stages: their losses by hand, what they reach in a painted room, and that ours ends where they do."""

from dataclasses import replace

import numpy as np
import pytest

from engine.errors import LightError
from engine.light.fitting.color_solve import epsilon_of, linear_renders, solve_colours
from engine.light.fitting.plane_sweep import knee_of
from engine.light.gaussians.gaussians import Y00
from engine.light.gaussians.rasterize import shapes, thread_pool
from engine.progress import Progress
from engine.reference.emitter.two_stage import (
    EmitterParams,
    descend,
    high_luminance,
    log_l1,
    pixels,
    relative_l1,
    scaled,
    stage_two,
    supervision,
    train,
)
from engine.types import Frames, Gaussians, Masks, Poses
from tests.engine.reference import shell_room

PARAMS = EmitterParams(
    iterations=160, refinements=60, width=48, degree=1, degree_every=80, densify_from=30, densify_until=110,
    densify_every=30, prune_every=20, most=600,
)  # fmt: skip


@pytest.fixture(scope="module")
def room() -> tuple[Frames, Masks, Poses]:
    return shell_room.room()


def trained(room: tuple[Frames, Masks, Poses], **changes) -> tuple[Gaussians, float]:
    gaussians, report = train(*room, replace(PARAMS, **changes), 0, Progress())
    return gaussians, report.log_l1


@pytest.fixture(scope="module")
def one_stage(room: tuple[Frames, Masks, Poses]) -> tuple[Gaussians, float]:
    return trained(room, one_stage=True)


def test_eq_5_worked_by_hand() -> None:
    photographed = np.array([[1.0, 3.0, 0.0], [5.0, 5.0, 5.0]])
    rendered = np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 5.0]])
    assert log_l1(photographed, rendered) == pytest.approx(1.5 * np.log(2))


def test_eq_6_worked_by_hand() -> None:
    photographed = np.array([[3.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    rendered = np.array([[1.0, 1.0, 1.0], [3.0, 3.0, 3.0]])
    assert relative_l1(photographed, rendered, 1.0) == pytest.approx((2 / 2 + 9 / 4) / 2)
    assert relative_l1(photographed, rendered, 1.0, np.zeros((2, 3))) == pytest.approx((2 + 9) / 2)


def test_the_loss_falls_from_start_to_end(
    room: tuple[Frames, Masks, Poses], one_stage: tuple[Gaussians, float]
) -> None:
    _, start = trained(room, iterations=1, one_stage=True)
    assert one_stage[1] < 0.3 * start


def test_the_cap_holds_and_harmonics_grow(one_stage: tuple[Gaussians, float]) -> None:
    assert 250 < len(one_stage[0].means) <= PARAMS.most
    assert one_stage[0].radiance.shape[1] == 4


def test_the_same_seed_gives_the_same_bits_and_held_out_views_teach_nothing(
    room: tuple[Frames, Masks, Poses], one_stage: tuple[Gaussians, float]
) -> None:
    frames, masks, poses = room
    radiance = frames.radiance.copy()
    radiance[4::8] = 0.001
    again, _ = trained((replace(frames, radiance=radiance), masks, poses), one_stage=True)
    for name in ("means", "quaternions", "scales", "density", "radiance"):
        assert getattr(again, name).tobytes() == getattr(one_stage[0], name).tobytes()
    other, _ = train(*room, replace(PARAMS, one_stage=True), 1, Progress())
    assert other.means.tobytes() != one_stage[0].means.tobytes()


def test_stage_two_changes_the_colours_of_the_bright_and_nothing_else(
    room: tuple[Frames, Masks, Poses], one_stage: tuple[Gaussians, float]
) -> None:
    both, _ = trained(room)
    for name in ("means", "quaternions", "scales", "density"):
        assert getattr(both, name).tobytes() == getattr(one_stage[0], name).tobytes()
    changed = (both.radiance != one_stage[0].radiance).any((1, 2))
    np.testing.assert_array_equal(changed, high_luminance(one_stage[0]))
    assert 0 < changed.sum() < 0.2 * len(changed)


def test_stage_two_brings_dimmed_lamps_back() -> None:
    photographs, truth = shell_room.photographs(), shell_room.truth()
    dim = truth.radiance.copy()
    lamps = dim[:, 0, 0] * Y00 > 20
    dim[lamps] *= 0.9
    given = replace(truth, radiance=dim)
    with thread_pool() as run:
        rng = np.random.default_rng(0)
        found = stage_two(given, photographs, replace(PARAMS, refinements=500), rng, Progress(), run)
    np.testing.assert_array_equal(high_luminance(given), lamps)
    np.testing.assert_allclose(found.radiance[lamps], truth.radiance[lamps], rtol=0.03)


def test_our_solve_and_adam_reach_the_same_minimum_of_eq_6() -> None:
    """Within 0.2 % of its value and 1 % of the lamps' mean radiance, on photographs that no colours render exactly."""
    photographs, truth = supervision(shell_room.photographs()), shell_room.truth()
    noise = np.random.default_rng(0).lognormal(0, 0.2, photographs.radiance.shape).astype(np.float32)
    photographs = replace(photographs, radiance=photographs.radiance * noise)
    dim = truth.radiance.copy()
    free = high_luminance(truth)
    dim[free] *= 0.85
    given = replace(truth, radiance=dim)
    with thread_pool() as run:
        rows = linear_renders(shapes(given), photographs, run)
        ours = dim.copy()
        ours[:, 0] = solved(rows, dim[:, 0] * Y00, free, run) / Y00
        steps = descend(given, rows, photographs, free, knee_of(photographs), np.random.default_rng(0), run)
        theirs = next(radiance for step, radiance in enumerate(steps, 1) if step == 1200)
        seen = {
            name: pixels(replace(given, radiance=radiance), photographs, run)
            for name, radiance in (("start", dim), ("ours", ours), ("theirs", theirs))
        }
    photographed, epsilon = seen["start"][0], epsilon_of(rows)
    for frozen in (seen["ours"][1], seen["theirs"][1]):
        value = {name: relative_l1(photographed, m, epsilon, frozen) for name, (_, m) in seen.items()}
        assert value["ours"] == pytest.approx(value["theirs"], rel=0.002)
        assert value["start"] > 1.02 * value["ours"]
    assert ours[free].mean() == pytest.approx(theirs[free].mean(), rel=0.01)


def solved(rows, start: np.ndarray, free: np.ndarray, run) -> np.ndarray:
    return solve_colours(rows, start, free, "relative", run, reweightings=30, hold=1e-4)


def test_a_scaled_training_keeps_its_proportions() -> None:
    short = scaled(1 / 20)
    assert (short.iterations, short.refinements, short.densify_until) == (1500, 1500, 750)
    assert (short.densify_every, short.prune_every, short.degree_every) == (15, 5, 50)
    assert scaled(1.0) == EmitterParams()


def test_a_room_that_no_view_shows_is_refused(room: tuple[Frames, Masks, Poses]) -> None:
    frames, masks, poses = room
    hidden = replace(masks, background=np.zeros_like(masks.background))
    with pytest.raises(LightError, match="no view shows any background"):
        train(frames, hidden, poses, PARAMS, 0, Progress())
