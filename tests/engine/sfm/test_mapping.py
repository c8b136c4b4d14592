import numpy as np

from engine.sfm.mapping import best_of_both


def descriptors(rng: np.random.Generator, count: int) -> np.ndarray:
    raw = rng.gamma(0.6, size=(count, 128))
    return np.rint(512 * raw / np.linalg.norm(raw, axis=1, keepdims=True)).astype(np.float32)


def by_the_book(a: np.ndarray, b: np.ndarray, ratio: float) -> set[tuple[int, int]]:
    angle = np.arccos(np.clip(a.astype(float) @ b.T.astype(float) / 512**2, 0, 1))
    pairs = set()
    for i, row in enumerate(angle):
        j = int(row.argmin())
        others = np.append(np.delete(row, j), np.delete(angle[:, j], i))
        if row[j] < 0.7 and row[j] < ratio * others.min():
            pairs.add((i, j))
    return pairs


def test_matches_are_mutual_clear_and_near():
    rng = np.random.default_rng(0)
    a = descriptors(rng, 60)
    noisy = a[:40] + rng.normal(scale=8, size=(40, 128)).clip(-20, 20).round()
    b = np.concatenate([noisy, noisy[:5], descriptors(rng, 30)]).astype(np.float32)[rng.permutation(75)]
    found = best_of_both(a, b, 0.8)
    assert {(int(i), int(j)) for i, j in found} == by_the_book(a, b, 0.8)
    assert 25 <= len(found) <= 35  # the five that show twice are not clear


def test_views_with_fewer_than_two_features_match_nothing():
    rng = np.random.default_rng(0)
    assert best_of_both(descriptors(rng, 1), descriptors(rng, 9), 0.8).shape == (0, 2)
    assert best_of_both(np.zeros((0, 128), np.float32), descriptors(rng, 9), 0.8).shape == (0, 2)
