"""A stroke speaks for what is alike around it, and no further."""

import numpy as np

from engine.segmentation import scribbles
from engine.segmentation.temporal_stability import TemporalStability

H, W = 24, 32
STEADY, UNSTEADY = np.float32(1e-4), np.float32(1e-2)
NONE = np.zeros((H, W), bool)


def two_halves(change: np.float32 = STEADY, brighter: float = 0.0) -> TemporalStability:
    """Alike everywhere but for the border between columns 15 and 16."""
    features = np.zeros((H, W, 6), np.float32)
    features[:, 16:, 0] = brighter
    link_x, link_y = np.full((H, W - 1), STEADY), np.full((H - 1, W), STEADY)
    link_x[:, 15] = change
    return TemporalStability(features, link_x, link_y, np.ones((8, H, W), np.float32))


def dab(column: int) -> np.ndarray:
    painted = NONE.copy()
    painted[10:13, column : column + 3] = True
    return painted


def test_the_pull_falls_off_with_the_way_alone_where_all_is_alike() -> None:
    pull = scribbles.pull(two_halves(), dab(4))
    np.testing.assert_array_equal(pull[10:13, 4:7], 1)
    reach = scribbles.REACH * W
    np.testing.assert_allclose(pull[11, 7:18], np.exp(-np.arange(1, 12) / reach), rtol=1e-6)
    assert not scribbles.pull(two_halves(), NONE).any()


def test_a_border_across_which_more_changes_stops_it() -> None:
    free, stopped = (scribbles.pull(two_halves(change), dab(10)) for change in (STEADY, 3 * STEADY))
    np.testing.assert_array_equal(stopped[:, :16], free[:, :16])
    np.testing.assert_allclose(
        stopped[11, 16], free[11, 16] * np.exp(-scribbles.UNSTEADY * np.log(3)), rtol=1e-5
    )
    assert not scribbles.pull(two_halves(1000 * STEADY), dab(10))[:, 16:].any()


def test_a_border_that_is_seen_stops_it() -> None:
    free, stopped = (scribbles.pull(two_halves(brighter=seen), dab(10)) for seen in (0.0, 0.5))
    np.testing.assert_allclose(stopped[11, 16], free[11, 16] * np.exp(-scribbles.UNLIKE * 0.5), rtol=1e-5)


def test_a_stroke_over_a_textured_thing_takes_texture_as_usual() -> None:
    rng = np.random.default_rng(0)
    plain = two_halves()
    features = plain.features.copy()
    features[..., 0] = rng.choice([0.0, 0.5], (H, W))
    textured = TemporalStability(features, plain.link_x, plain.link_y, plain.relative)
    painted = NONE.copy()
    painted[8:16, 4:12] = True
    np.testing.assert_allclose(scribbles.pull(textured, painted)[11], scribbles.pull(plain, painted)[11])


def test_thin_strokes_survive_a_coarser_grid() -> None:
    painted = np.zeros((9, 10), bool)
    painted[4, 2:8] = True
    expected = np.zeros((3, 3), bool)
    expected[1, 0:3] = True
    np.testing.assert_array_equal(scribbles.reduced(painted, 3), expected)
