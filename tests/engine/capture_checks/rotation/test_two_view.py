import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.capture_checks.rotation import two_view
from engine.sfm.rig_alignment import angle_between

FOCAL, PIXEL = 0.85, 1 / 640


def pair(
    seed: int, turn_deg: float, flat: bool = False, noise_px: float = 0.2, wrong: int = 0, step: float = 0.12
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a room 2 to 4 away seen before and after a turn and a step, and the turn."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(np.radians(turn_deg) * unit(rng.standard_normal(3))).as_matrix()
    points = np.column_stack([rng.uniform(-2.5, 2.5, (4000, 2)), np.zeros(4000)])
    points[:, 2] = 3.0 + (0.3 * points[:, 0] if flat else rng.uniform(-1, 1, 4000))
    moved = points @ turn.T + step * unit(rng.standard_normal(3))
    a, b = (FOCAL * p[:, :2] / p[:, 2:] for p in (points, moved))
    inside = (np.abs(a) < [0.5, 0.375]).all(1) & (np.abs(b) < [0.5, 0.375]).all(1) & (moved[:, 2] > 0)
    a, b = a[inside][:150], b[inside][:150]
    b = b + noise_px * PIXEL * rng.standard_normal(b.shape)
    b[:wrong] = rng.uniform(-0.4, 0.4, (wrong, 2))
    return a, b, turn


def unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


@pytest.mark.parametrize("seed", range(6))
def test_the_turn_is_found_among_wrong_matches(seed):
    a, b, turn = pair(seed, 20.0, wrong=40)
    found = two_view.motions(a, b, FOCAL, PIXEL)
    assert np.degrees(angle_between(found[0].later_from_earlier, turn)) < 0.7
    assert 100 <= two_view.agreeing(found[0], a, b, FOCAL, PIXEL) <= 125


@pytest.mark.parametrize("seed", range(4))
def test_a_wall_leaves_the_true_turn_among_those_offered(seed):
    a, b, turn = pair(seed, 15.0, flat=True)
    off = [
        np.degrees(angle_between(one.later_from_earlier, turn))
        for one in two_view.motions(a, b, FOCAL, PIXEL)
    ]
    assert min(off) < 1.5


@pytest.mark.parametrize("seed", range(4))
def test_half_a_turn_about_the_way_is_never_offered(seed):
    a, b, turn = pair(seed, 10.0)
    off = [
        np.degrees(angle_between(one.later_from_earlier, turn))
        for one in two_view.motions(a, b, FOCAL, PIXEL)
    ]
    assert max(off) < 40


def test_a_turn_without_a_step_is_found_too():
    a, b, turn = pair(1, 20.0, step=0.0)
    assert np.degrees(angle_between(two_view.motions(a, b, FOCAL, PIXEL)[0].later_from_earlier, turn)) < 0.7


def test_too_few_points_have_no_motion():
    a, b, _ = pair(0, 10.0)
    assert two_view.motions(a[:8], b[:8], FOCAL, PIXEL) == []


def test_refining_through_another_lens_fits_worse():
    a, b, _ = pair(2, 20.0)
    best = two_view.motions(a, b, FOCAL, PIXEL)
    wrong = two_view.followed(best, a, b, 1.2 * FOCAL, PIXEL)
    assert wrong[0].misfit > 1.3 * best[0].misfit
