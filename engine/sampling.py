"""Some of many views, pixels or shots."""

import numpy as np
from jaxtyping import Int


def evenly_spaced(of: int, most: int) -> Int[np.ndarray, " k"]:
    """Indices of at most so many `of` so many, evenly spread, the first and the last among them."""
    return np.arange(of) if of <= most else np.linspace(0, of - 1, most).round().astype(int)
