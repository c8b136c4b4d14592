"""Two facts about points on a chart: which of them no other beats, and how fast a quantity grows."""

from collections.abc import Sequence

import numpy as np


def pareto(seconds: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the points that no other equals or beats in both and beats in one, by rising seconds.

    Of points alike the first stands for all; a point with NaN is never on the front.
    """
    front: list[int] = []
    least = np.inf
    known = [i for i in range(len(seconds)) if seconds[i] < np.inf and errors[i] < np.inf]
    for i in sorted(known, key=lambda i: (seconds[i], errors[i])):
        if errors[i] < least:
            front.append(i)
            least = errors[i]
    return front


def exponent(sizes: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """(p, its standard error) of value = c * size^p by least squares of logarithms; the error is NaN for two points.

    Raises:
        ValueError: fewer than two sizes, or something not positive.
    """
    x, y = np.asarray(sizes, float), np.asarray(values, float)
    if len(np.unique(x)) < 2 or not ((x > 0) & (y > 0)).all():
        raise ValueError("an exponent needs positive values at two sizes at least")
    x, y = np.log(x), np.log(y)
    x = x - x.mean()
    slope = float(x @ y / (x @ x))
    rest = y - y.mean() - slope * x
    spread = float(np.sqrt(rest @ rest / (len(x) - 2) / (x @ x))) if len(x) > 2 else float("nan")
    return slope, spread
