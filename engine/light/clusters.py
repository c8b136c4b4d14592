"""Which points lie together."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree


def clusters(
    points: Float[np.ndarray, "k 3"] | Int[np.ndarray, "k 3"], reach: float
) -> Int[np.ndarray, " k"]:
    """The number of each point's cluster: points at most `reach` apart are of one."""
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    return connected_components(links, directed=False)[1]
