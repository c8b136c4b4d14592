import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.capture_checks.rotation import rotation_averaging
from engine.capture_checks.rotation.overlap import ViewPair
from engine.capture_checks.rotation.two_view import RelativePose
from engine.sfm.rig_alignment import angle_between, mean_rotation

NO_POINTS = (np.zeros((0, 2)), np.zeros((0, 2)))
WAY = np.array([1.0, 0, 0])


def journey(count: int) -> np.ndarray:
    """cam_from_world of a camera that turns once around, nodding."""
    angles = 2 * np.pi * np.arange(count) / count
    return Rotation.from_euler("yx", np.column_stack([angles, 0.4 * np.sin(3 * angles)])).inv().as_matrix()


def link(
    truth: np.ndarray, earlier: int, later: int, rng: np.random.Generator, off_deg: float = 1.0,
    twin_deg: float = 0.0, inliers: int = 40,
) -> ViewPair:  # fmt: skip
    """What a pair tells, off by about `off_deg`; with a twin `twin_deg` away that fits a little better."""
    noise = Rotation.from_rotvec(np.radians(off_deg) * rng.standard_normal(3) / np.sqrt(3)).as_matrix()
    turn = noise @ truth[later] @ truth[earlier].T
    turns = [RelativePose(turn, WAY, 10.0)]
    if twin_deg:
        away = Rotation.from_rotvec([0, np.radians(twin_deg), 0]).as_matrix()
        turns.insert(0, RelativePose(away @ turn, WAY, 8.0))
    return ViewPair(earlier, later, inliers, tuple(turns), NO_POINTS, 1 / 640)


def walked(
    truth: np.ndarray, links: list[ViewPair], logged: dict[int, np.ndarray] | None = None
) -> rotation_averaging.RotationGraph:
    turned = rotation_averaging.NOTHING
    for number in range(len(truth)):
        so_far = [one for one in links if one.later <= number]
        new = [one for one in so_far if one.later == number]
        turned = rotation_averaging.with_shot(turned, new, so_far, (logged or {}).get(number))
    return turned


def off_deg(turned: rotation_averaging.RotationGraph, truth: np.ndarray) -> np.ndarray:
    world = mean_rotation(truth.transpose(0, 2, 1) @ turned.cam_from_world)
    return np.degrees(angle_between(turned.cam_from_world, truth @ world))


def test_links_are_chained_exactly():
    truth = journey(10)
    rng = np.random.default_rng(0)
    turned = walked(truth, [link(truth, i, i + 1, rng, off_deg=0.0) for i in range(9)])
    assert off_deg(turned, truth).max() < 0.01
    assert set(turned.group) == {turned.group[0]}


def test_a_closed_round_is_better_than_its_chain():
    truth = journey(24)
    rng = np.random.default_rng(1)
    chain = [link(truth, i, i + 1, rng, off_deg=3.0) for i in range(23)]
    closed = [
        *chain,
        *(link(truth, i, i + 2, rng, off_deg=1.0) for i in range(22)),
        link(truth, 0, 23, rng, off_deg=1.0),
    ]
    assert np.median(off_deg(walked(truth, closed), truth)) < 0.6 * np.median(
        off_deg(walked(truth, chain), truth)
    )


def test_a_wrong_twin_is_outvoted_by_other_links():
    truth = journey(16)
    rng = np.random.default_rng(2)
    links = [link(truth, i, i + 1, rng, twin_deg=14.0 if i == 7 else 0.0) for i in range(15)]
    links += [link(truth, i, i + 2, rng) for i in range(14)]
    assert off_deg(walked(truth, links), truth).max() < 3
    alone = walked(truth, links[:15])
    assert off_deg(alone, truth).max() > 5


def test_many_twins_are_told_by_what_others_say():
    """Every other step has a twin that fits a little better, always to the same side."""
    truth = journey(16)
    rng = np.random.default_rng(8)
    links = [link(truth, i, i + 1, rng, twin_deg=14.0 * (i % 2)) for i in range(15)]
    links += [link(truth, i, i + 2, rng, inliers=30) for i in range(14)]
    assert off_deg(walked(truth, links), truth).max() < 4


def test_one_false_link_does_not_bend_the_rest():
    truth = journey(16)
    rng = np.random.default_rng(3)
    links = [link(truth, i, i + step, rng) for step in (1, 2) for i in range(16 - step)]
    false = ViewPair(2, 12, 20, (RelativePose(np.eye(3), WAY, 5.0),), NO_POINTS, 1 / 640)
    assert off_deg(walked(truth, [*links, false]), truth).max() < 3


def test_shots_without_a_link_stand_apart_until_one_ties_them():
    truth = journey(9)
    rng = np.random.default_rng(4)
    links = [link(truth, i, i + 1, rng, off_deg=0.0) for i in (0, 1, 2, 4, 5, 6)]
    apart = walked(truth[:8], links)
    assert apart.main == apart.group[0]
    assert (apart.group == apart.main).sum() == 4
    tied = walked(truth, [*links, link(truth, 2, 8, rng, off_deg=0.0), link(truth, 6, 8, rng, off_deg=0.0)])
    assert (tied.group == tied.main).all()
    assert off_deg(tied, truth).max() < 0.01


def test_weak_links_tie_nothing():
    truth = journey(3)
    rng = np.random.default_rng(5)
    turned = walked(truth, [link(truth, 0, 1, rng, inliers=8)])
    assert len(set(turned.group)) == 3


def test_what_the_rig_tells_is_never_changed():
    truth = journey(6)
    rng = np.random.default_rng(6)
    links = [link(truth, i, i + 1, rng, off_deg=8.0) for i in range(5)]
    turned = walked(truth, links, {n: truth[n] for n in (0, 1, 2, 4)})
    np.testing.assert_array_equal(turned.cam_from_world[[0, 1, 2, 4]], truth[[0, 1, 2, 4]])
    assert turned.logged.tolist() == [True, True, True, False, True, False]
    assert (turned.group == 0).all()
    assert np.degrees(angle_between(turned.cam_from_world[3], truth[3])) == pytest.approx(0, abs=15)
