"""Ours beside the paper's solver, in words and numbers: how much faster, and in which errors better.

Times are compared within one run only, and errors over the same pixels.
"""

from collections.abc import Sequence

from app.bench.rows import OURS
from app.bench.scores import SCORES, Scored, ratio


def told(points: Sequence[Scored], dearest: str) -> list[str]:
    """Every preset of ours beside the reference's row `dearest`, and ours beside its cheapest setting that is as good."""
    (slow,) = [one for one in points if one.method == dearest]
    lines = []
    for one in (one for one in points if one.kind == "ours"):
        share = ratio(slow, one)
        faster = "times of different runs" if share is None else f"{_times(share)} faster"
        worse = [kind.key for kind in SCORES if not better(one, slow, kind.key)]
        errors = f"worse in {', '.join(worse)}" if worse else "better in each error"
        lines.append(f"{one.title}, beside {slow.title}: {faster}; {errors}")
    usual = next((one for one in points if one.method == OURS), None)
    if usual is None:
        return lines
    rivals = [
        one for one in points if one.kind == "reference" and one.values["normal"] <= usual.values["normal"]
    ]
    if not rivals:
        return [*lines, f"no setting of the reference reaches the normals of {usual.title}"]
    cheapest = min(rivals, key=lambda one: one.seconds)
    share = ratio(cheapest, usual)
    faster = "times of different runs" if share is None else f"{usual.title} is {_times(share)} faster"
    return [*lines, f"the cheapest setting that reaches our normals is {cheapest.title}: {faster}"]


def dominates(points: Sequence[Scored], dearest: str) -> bool:
    """Whether ours at its defaults takes less time than the reference's row `dearest` and is better in each error."""
    (usual,) = [one for one in points if one.method == OURS]
    (slow,) = [one for one in points if one.method == dearest]
    return usual.seconds < slow.seconds and all(better(usual, slow, kind.key) for kind in SCORES)


def better(one: Scored, other: Scored, key: str) -> bool:
    """NaN is not."""
    (kind,) = [kind for kind in SCORES if kind.key == key]
    mine, theirs = one.values[key], other.values[key]
    return mine < theirs if kind.direction == "lower" else mine > theirs


def _times(share: float) -> str:
    """Two digits where there are no more before the point: 0.49 times is slower, and not 0 times."""
    return f"{share:,.0f} times" if share >= 10 else f"{share:.2g} times"
