"""Sort single exposures into brackets: which RAW files are one view.

Files are put in the order they were taken (EXIF time, then file name). A bracket of N is told by exposure
offsets that repeat every N files, in EV (powers of two) relative to the bracket's first file, so that a
camera that meters each view anew still shows its pattern.
"""

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.errors import ImportFault
from engine.raw import Facts

LONGEST_BRACKET = 9
TOLERANCE_EV = 0.2  # cameras round shutter times by up to a sixth of a stop


@dataclass(frozen=True, slots=True)
class Taken:
    """One exposure and what it says of itself."""

    path: Path
    facts: Facts

    @property
    def ev(self) -> float:
        return math.log2(self.facts.exposure())


def natural(path: Path) -> tuple[object, ...]:
    """Sort key that puts IMG_9 before IMG_10."""
    parts = re.split(r"(\d+)", str(path).lower())
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts)


def in_order(taken: Sequence[Taken]) -> list[Taken]:
    """By time and name; by name alone when any file has no time."""
    if any(math.isnan(item.facts.time_s) for item in taken):
        return sorted(taken, key=lambda item: natural(item.path))
    return sorted(taken, key=lambda item: (math.floor(item.facts.time_s), natural(item.path)))


def group(taken: Sequence[Taken], size: int | None) -> list[tuple[Taken, ...]]:
    """Brackets in the order they were taken; `size` None finds the number of exposures itself.

    Raises:
        ImportFault: the exposures do not repeat, or a bracket is incomplete.
    """
    files = in_order(taken)
    if size == 1:
        return [(item,) for item in files]
    if size is not None:
        pattern, covered = _best_pattern(files, size, distinct=False)
        return _brackets(files, pattern, covered)
    evs = [item.ev for item in files]
    if max(evs) - min(evs) <= TOLERANCE_EV:
        return [(item,) for item in files]
    found = [_best_pattern(files, n) for n in range(2, min(LONGEST_BRACKET, len(files) // 2) + 1)]
    if not found or max(len(covered) for _, covered in found) < 0.5 * len(files):
        raise ImportFault(
            f"{files[0].path.parent}: the exposures of {len(files)} files do not repeat in a pattern; say how"
            " many make one view with --bracket N"
        )
    # Twice the true length repeats as well: the shortest of those that explain the most files is the bracket.
    pattern, covered = max(found, key=lambda item: (len(item[1]), -len(item[0])))
    return _brackets(files, pattern, covered)


def _best_pattern(
    files: Sequence[Taken], size: int, distinct: bool = True
) -> tuple[tuple[float, ...], list[int]]:
    """Offsets of `size` exposures and the files (by index) that brackets of that pattern cover.

    `distinct` refuses a pattern with an exposure twice: nobody asked for one, so it is two brackets.
    """
    if len(files) < size:
        return (0.0,) * size, []
    evs = [item.ev for item in files]
    tries = []
    # The bracket at the very beginning may be the broken one; then the one at the end is not, or vice versa.
    for start in (0, len(files) - size):
        pattern = tuple(ev - evs[start] for ev in evs[start : start + size])
        gaps = sorted(pattern)
        if not distinct or all(b - a > TOLERANCE_EV for a, b in itertools.pairwise(gaps)):
            covered = _covered(evs, pattern)
            tries.append((len(covered), -_span_s(files, covered, size), pattern, covered))
    best = max(tries, default=(0, 0.0, (0.0,) * size, []))
    return best[2], best[3]


def _span_s(files: Sequence[Taken], covered: Sequence[int], size: int) -> float:
    """Time from first to last exposure, over all brackets: the true ones are taken in one go."""
    times = [files[i].facts.time_s for i in covered]
    spans = [times[i + size - 1] - times[i] for i in range(0, len(times), size)]
    return 0.0 if any(map(math.isnan, spans)) else sum(spans)


def _covered(evs: Sequence[float], pattern: Sequence[float]) -> list[int]:
    covered: list[int] = []
    i = 0
    while i + len(pattern) <= len(evs):
        off = max(abs(evs[i + k] - evs[i] - step) for k, step in enumerate(pattern))
        if off <= TOLERANCE_EV:
            covered += range(i, i + len(pattern))
            i += len(pattern)
        else:
            i += 1
    return covered


def _brackets(
    files: Sequence[Taken], pattern: Sequence[float], covered: Sequence[int]
) -> list[tuple[Taken, ...]]:
    left_out = sorted(set(range(len(files))) - set(covered))
    if left_out:
        item = files[left_out[0]]
        steps = ", ".join(f"{step:+.1f}" for step in pattern)
        told = f" ({steps} EV)" if covered else ""
        more = f" and {len(left_out) - 1} more" if len(left_out) > 1 else ""
        raise ImportFault(
            f"{item.path}: incomplete bracket: this file{more} ({item.ev - files[0].ev:+.1f} EV from the"
            f" first) belongs to no complete set of {len(pattern)} exposures{told}; add the missing exposure,"
            " remove the rest of that bracket, or say --bracket N"
        )
    size = len(pattern)
    return [tuple(files[i : i + size]) for i in range(0, len(files), size)]
