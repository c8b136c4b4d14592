"""How far a stroke speaks for the pixels around it: a pull that falls off along paths through pixels that are alike.

Source: geodesic distances to strokes, after Bai and Sapiro, "A geodesic framework for fast interactive image and
video segmentation and matting" (2007). A step costs its length, and more where more changes across it from view to
view, or its two pixels look less alike on average, than under the stroke itself. Masks are on the pixel grid of the
steadiness they are used with.
"""

import numpy as np
from jaxtyping import Bool, Float64
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from engine.segmentation.temporal_stability import FEATURES, TemporalStability

REACH = 0.1  # of the longer side: over so many pixels that are alike the pull falls to 1/e
UNSTEADY = 1.0  # cost of a step across which e times as much changes as under the stroke
UNLIKE = 3.0  # cost of a step whose pixels differ by one more, in the logarithm of brightness or colour
USUAL = 75  # percentile of the steps under a stroke that those around are held against
FARTHEST = 4.0  # the pull beyond is nothing
FAINT = 0.1  # a pull that is hardly worth hearing


def pull(steadiness: TemporalStability, painted: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "h w"]:
    """1 on what was painted, falling to 0 where it has nothing to say."""
    return np.exp(-_distance(steadiness, painted))


def reduced(painted: Bool[np.ndarray, "h w"], by: int) -> Bool[np.ndarray, "a b"]:
    """Strokes on a grid averaged down: every pixel that they touch, for thin strokes count too."""
    h, w = (size // by for size in painted.shape)
    return np.asarray(painted[: h * by, : w * by].reshape(h, by, w, by).any(axis=(1, 3)))


def _distance(steadiness: TemporalStability, painted: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "h w"]:
    """Cost of the cheapest path to a painted pixel; infinite beyond FARTHEST."""
    if not painted.any():
        return np.full(painted.shape, np.inf)
    h, w = painted.shape
    index = np.arange(h * w).reshape(h, w)
    a = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    b = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])
    changes = np.log(np.concatenate([steadiness.link_x.ravel(), steadiness.link_y.ravel()]))
    looks = steadiness.features[..., [FEATURES.index(name) for name in ("mean", "red", "blue")]].reshape(
        h * w, 3
    )
    unlike = np.abs(looks[a] - looks[b]).sum(axis=1)
    under = painted.ravel()[a] | painted.ravel()[b]
    cost = 1 / (REACH * max(h, w)) + sum(
        weight * np.maximum(each - np.percentile(each[under], USUAL), 0)
        for weight, each in ((UNSTEADY, changes), (UNLIKE, unlike))
    )
    steps = csr_matrix((cost.astype(np.float64), (a, b)), (h * w, h * w))
    found = dijkstra(steps, directed=False, indices=np.flatnonzero(painted), limit=FARTHEST, min_only=True)
    return np.asarray(found).reshape(h, w)
