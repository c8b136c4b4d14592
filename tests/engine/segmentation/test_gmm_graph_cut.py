import numpy as np
import pytest

from engine.segmentation import gmm_graph_cut


def test_a_mixture_of_two_is_found_again():
    rng = np.random.default_rng(0)
    samples = np.concatenate([rng.normal(-3, 1, (3000, 2)), rng.normal(4, 0.5, (1000, 2))]).astype(np.float32)
    mixture = gmm_graph_cut.fit(samples, 2, rng)
    order = np.argsort(mixture.weights)
    np.testing.assert_allclose(mixture.weights[order], [0.25, 0.75], atol=0.01)
    np.testing.assert_allclose(mixture.means[order], [[4, 4], [-3, -3]], atol=0.1)


def test_density_of_one_gaussian_by_hand():
    mixture = gmm_graph_cut.Mixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None])
    density = gmm_graph_cut.log_density(np.array([[0, 0], [1, 2]], np.float32), mixture)
    np.testing.assert_allclose(density, [-np.log(2 * np.pi), -np.log(2 * np.pi) - 2.5], rtol=1e-6)


def test_parts_without_support_are_dropped():
    rng = np.random.default_rng(0)
    samples = rng.normal(0, 1e-3, (50, 3)).astype(np.float32)
    assert len(gmm_graph_cut.fit(samples, 5, rng).weights) == 1


@pytest.mark.parametrize(("bridge", "expected"), [(1e-6, True), (1.0, False)])
def test_an_undecided_pixel_follows_the_neighbour_it_changes_with(bridge, expected):
    """Three pixels in a row: object, undecided, room. The link to the room is fixed, that to the object varies."""
    odds = np.array([[5.0, 0.0, -5.0]])
    links = np.array([[bridge, 0.01]], np.float32)
    found = gmm_graph_cut.cut(odds, links, np.zeros((0, 3), np.float32), smoothness=1.0, bound=5.0)
    assert found.tolist() == [[True, expected, False]]


def test_the_cut_is_the_cheapest_of_all_labellings():
    rng = np.random.default_rng(1)
    odds = rng.normal(0, 1, (3, 4))
    link_x, link_y = (
        rng.uniform(0, 2, (3, 3)).astype(np.float32),
        rng.uniform(0, 2, (2, 4)).astype(np.float32),
    )
    found = gmm_graph_cut.cut(odds, link_x, link_y, 0.8, 10.0)
    typical = np.median(np.concatenate([link_x.ravel(), link_y.ravel()]))

    def cost(mask: np.ndarray) -> float:
        price_x, price_y = (0.8 * typical / (typical + link) for link in (link_x, link_y))
        against = np.where(mask, np.maximum(-odds, 0), np.maximum(odds, 0)).sum()
        return against + price_x[mask[:, 1:] != mask[:, :-1]].sum() + price_y[mask[1:] != mask[:-1]].sum()

    every = ((np.arange(2**12)[:, None] >> np.arange(12)) & 1).astype(bool).reshape(-1, 3, 4)
    assert cost(found) == pytest.approx(min(cost(mask) for mask in every), abs=0.02)
