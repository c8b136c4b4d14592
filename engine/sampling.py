"""Some of many views, pixels or shots."""

import numpy as np
from jaxtyping import Bool, Int

from engine.conventions import LEAST_VIEWS
from engine.errors import SurfaceError


def evenly_spaced(of: int, most: int) -> Int[np.ndarray, " k"]:
    """Indices of at most so many `of` so many, evenly spread, the first and the last among them."""
    return np.arange(of) if of <= most else np.linspace(0, of - 1, most).round().astype(int)


def held_out(registered: Bool[np.ndarray, " n"], count: int) -> tuple[Int[np.ndarray, " f"], tuple[int, ...]]:
    """(fitted, held out) view indices: the held-out ones evenly spread over the registered.

    Raises:
        SurfaceError: too few are registered.
    """
    usable = np.nonzero(registered)[0]
    if len(usable) < LEAST_VIEWS:
        raise SurfaceError(
            f"only {len(usable)} views have a pose and light; at least {LEAST_VIEWS} are needed, add photographs"
        )
    count = min(count, len(usable) // 8, len(usable) - LEAST_VIEWS)  # one in eight at most
    out = usable[np.linspace(0, len(usable) - 1, count + 2).astype(int)[1:-1]]
    return np.setdiff1d(usable, out), tuple(int(i) for i in out)
