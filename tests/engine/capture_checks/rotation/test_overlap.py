import numpy as np

from engine.capture_checks.rotation import overlap
from engine.capture_checks.rotation.overlap import Features, ViewPair

PIXEL = 1 / 640


def marks(points: np.ndarray, looks: np.ndarray) -> Features:
    return Features(points, looks, np.arange(min(len(points), overlap.COARSE)), PIXEL)


def looks(count: int, seed: int) -> np.ndarray:
    """Descriptors of things that look unlike."""
    rng = np.random.default_rng(seed)
    raw = rng.exponential(size=(count, 128)) ** 2
    return np.minimum(np.rint(512 * np.sqrt(raw / raw.sum(1, keepdims=True))), 255).astype(np.uint8)


def link(earlier: int, inliers: int) -> ViewPair:
    return ViewPair(earlier, 9, inliers, (), (np.zeros((0, 2)), np.zeros((0, 2))), PIXEL)


def test_what_stands_still_in_the_picture_is_the_object_and_not_matched():
    rng = np.random.default_rng(0)
    places, same = rng.uniform(-0.5, 0.5, (90, 2)), looks(90, 1)
    later = places + [0.1, 0.02]
    later[:30] = places[:30] + 0.3 * PIXEL
    a, b = overlap.matched(marks(places, same), marks(later, same))
    np.testing.assert_allclose(b - a, np.tile([0.1, 0.02], (60, 1)), atol=1e-12)


def test_a_camera_that_did_not_move_keeps_its_matches():
    places, same = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 2)), looks(60, 1)
    a, _ = overlap.matched(marks(places, same), marks(places + 0.2 * PIXEL, same))
    assert len(a) == 60


def test_likely_partners_are_the_last_shot_and_those_alike():
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 2))
    others = [marks(places, looks(100, seed)) for seed in range(10)]
    assert overlap.likely(marks(places, looks(100, 3)), others)[-1] == 9
    assert 3 in overlap.likely(marks(places, looks(100, 3)), others)
    assert len(overlap.likely(marks(places, looks(100, 3)), others)) <= overlap.PARTNERS + 1
    assert overlap.likely(others[0], []) == []
    nothing = marks(np.zeros((0, 2)), looks(0, 0))
    assert overlap.likely(nothing, [nothing]) == [0]


def test_too_weak_a_tie_is_told_with_its_partner():
    new = marks(np.zeros((200, 2)), looks(200, 0))
    names = [f"shot{i}" for i in range(9)]
    assert overlap.check("new", new, [link(2, 40), link(4, 9)], names) is None
    found = overlap.check("new", new, [link(2, 6), link(4, 9)], names)
    assert found is not None
    assert (found.value, found.unit) == (9.0, "inliers")
    assert "shot4" in found.seen
    assert overlap.check("first", new, [], []) is None


def test_a_view_without_features_is_told_as_that():
    found = overlap.check("new", marks(np.zeros((20, 2)), looks(20, 0)), [], ["shot0"])
    assert found is not None
    assert "only 20 features" in found.seen
