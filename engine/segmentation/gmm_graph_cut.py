"""Tell two populations of pixels apart: a mixture of Gaussians for each, a minimum cut between them.

Source: Dempster, Laird, Rubin (1977) for the mixtures; Boykov and Jolly (2001) for the cut. Features are
dimensionless; odds are natural logarithms, positive for the object.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

TRAINING = 8000  # pixels a mixture is fitted to
FEWEST = 30  # pixels that a part of a mixture stands for
WIDTH = 0.05  # standard deviation added to every part, in units of the features' own spread
ROUNDS = 8
LEVELS = 1000  # of a capacity: the flow is counted in whole numbers


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Weighted Gaussians."""

    weights: Float64[np.ndarray, " k"]
    means: Float64[np.ndarray, "k f"]
    covariances: Float64[np.ndarray, "k f f"]


def fit(samples: Float32[np.ndarray, "m f"], parts: int, rng: np.random.Generator) -> Mixture:
    """Expectation maximisation from k-means; parts that no pixels support are dropped."""
    if len(samples) > TRAINING:
        samples = samples[rng.choice(len(samples), TRAINING, replace=False)]
    dims = samples.shape[1]
    cv2.setRNGSeed(int(rng.integers(1 << 30)))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
    labels = np.zeros((len(samples), 1), np.int32)
    cv2.kmeans(np.ascontiguousarray(samples), parts, labels, stop, 3, cv2.KMEANS_PP_CENTERS)
    share = (labels == np.arange(parts)).astype(np.float64)
    data = samples.astype(np.float64)
    mixture = Mixture(np.ones(1), data.mean(0)[None], (np.cov(data.T) + WIDTH**2 * np.eye(dims))[None])
    for _ in range(ROUNDS):
        share = share[:, share.sum(axis=0) >= FEWEST]
        if share.shape[1] == 0:
            return mixture
        total = share.sum(axis=0)
        means = share.T @ data / total[:, None]
        off = data[None] - means[:, None]
        covariances = np.einsum("mk,kmf,kmg->kfg", share, off, off, optimize=True) / total[:, None, None]
        mixture = Mixture(total / total.sum(), means, covariances + WIDTH**2 * np.eye(dims))
        each = _log_parts(data, mixture)
        share = np.exp(each - np.logaddexp.reduce(each, axis=1)[:, None])
    return mixture


def log_density(samples: Float32[np.ndarray, "m f"], mixture: Mixture) -> Float64[np.ndarray, " m"]:
    return np.logaddexp.reduce(_log_parts(samples.astype(np.float64), mixture), axis=1)


def cut(
    odds: Float[np.ndarray, "h w"],
    link_x: Float32[np.ndarray, "h a"],
    link_y: Float32[np.ndarray, "b w"],
    smoothness: float,
    bound: float,
) -> Bool[np.ndarray, "h w"]:
    """The object of least cost: pixels against their odds, clipped to +-`bound`, plus links cut.

    A link costs up to `smoothness`, less the more the ratio across it changes from view to view.
    """
    h, w = odds.shape
    typical = float(np.median(np.concatenate([link_x.ravel(), link_y.ravel()])))
    index = np.arange(h * w, dtype=np.int32).reshape(h, w)  # a graph has five times as many
    a = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    b = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    link = np.concatenate([link_x.ravel(), link_y.ravel()])
    price = smoothness * typical / (typical + link)
    pull = np.clip(odds, -bound, bound).ravel()
    ours, theirs = index.ravel()[pull > 0], index.ravel()[pull < 0]
    source, sink = np.int32(h * w), np.int32(h * w + 1)
    rows = np.concatenate([a, b, np.full_like(ours, source), theirs])
    columns = np.concatenate([b, a, ours, np.full_like(theirs, sink)])
    capacity = np.concatenate([price, price, pull[ours], -pull[theirs]])
    whole = np.rint(capacity * LEVELS).astype(np.int32)
    graph = csr_matrix((whole, (rows, columns)), (h * w + 2, h * w + 2))
    left = graph - maximum_flow(graph, source, sink, method="dinic").flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = np.zeros(h * w + 2, bool)
    reached[breadth_first_order(left, source, return_predecessors=False)] = True
    return reached[: h * w].reshape(h, w)


def _log_parts(data: Float64[np.ndarray, "m f"], mixture: Mixture) -> Float64[np.ndarray, "m k"]:
    columns = []
    for weight, mean, covariance in zip(mixture.weights, mixture.means, mixture.covariances, strict=True):
        root = np.linalg.cholesky(covariance)
        white = (data - mean) @ np.linalg.inv(root).T
        scale = np.log(weight) - np.log(np.diag(root)).sum() - 0.5 * len(mean) * np.log(2 * np.pi)
        columns.append(scale - 0.5 * np.square(white).sum(axis=1))
    return np.stack(columns, axis=1)
