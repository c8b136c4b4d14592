"""Some of many views, pixels or shots."""

import numpy as np
from jaxtyping import Int


def evenly_spaced(views: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " k"]:
    """At most so many of the views, evenly spread, the first and the last among them."""
    if len(views) <= most:
        return views
    return views[np.linspace(0, len(views) - 1, most).round().astype(int)]
