"""Sort single exposures into brackets: which RAW files are one view.

Files are put in the order they were taken (EXIF time, then file name). A bracket of N is told by exposure
offsets that repeat every N files, in EV (powers of two) relative to the bracket's first file, so that a
camera that meters each view anew still shows its pattern. Where a file is lost, exposures alone may also repeat
across two poses: the pauses between the files decide first, and only then how many files a pattern covers.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64

from engine.errors import ImportFault
from engine.io.raw import Facts

LONGEST_BRACKET = 9
TOLERANCE_EV = 0.2  # cameras round shutter times by up to a sixth of a stop
FEWEST_COVERED = 0.5  # share of the files that a pattern must explain
APART = 1.5  # how many times longer than any pause inside a bracket those around it are, where pauses tell
TELLING_SHARE = 0.75  # of the brackets


@dataclass(frozen=True, slots=True)
class Taken:
    """One exposure and what it says of itself."""

    path: Path
    facts: Facts

    @property
    def ev(self) -> float:
        return math.log2(self.facts.exposure())


@dataclass(frozen=True, slots=True)
class Grouping:
    """Whole brackets in the order they were taken, and the files that belong to none."""

    brackets: tuple[tuple[Taken, ...], ...]
    left_out: tuple[Taken, ...]


@dataclass(frozen=True, slots=True)
class _Phase:
    """One way to cut the row of files into brackets."""

    pattern: tuple[float, ...]  # EV relative to the first exposure
    starts: tuple[int, ...]  # index of each bracket's first file

    @property
    def size(self) -> int:
        return len(self.pattern)

    @property
    def covered(self) -> int:
        return len(self.starts) * self.size


def natural(path: Path) -> tuple[object, ...]:
    """Sort key that puts IMG_9 before IMG_10."""
    parts = re.split(r"(\d+)", str(path).lower())
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts)


def in_order(taken: Sequence[Taken]) -> list[Taken]:
    """By time and name; by name alone when any file has no time."""
    if any(math.isnan(item.facts.time_s) for item in taken):
        return sorted(taken, key=lambda item: natural(item.path))
    return sorted(taken, key=lambda item: (math.floor(item.facts.time_s), natural(item.path)))


def group(taken: Sequence[Taken], size: int | None) -> Grouping:
    """Brackets of `size` exposures; None finds the number out.

    Raises:
        ImportFault: the exposures do not repeat, or they do in two ways and the times do not tell which is right.
    """
    files = in_order(taken)
    evs = np.array([item.ev for item in files])
    if size == 1 or (size is None and np.ptp(evs) <= TOLERANCE_EV):
        return Grouping(tuple((item,) for item in files), ())
    sizes = range(2, min(LONGEST_BRACKET, len(files) // 2) + 1) if size is None else (size,)
    phases = [phase for n in sizes for phase in _phases(evs, n, distinct=size is None)]
    phases = [phase for phase in phases if phase.covered >= FEWEST_COVERED * len(files)]
    if not phases:
        how = "in a pattern" if size is None else f"every {size} files"
        raise ImportFault(
            f"{files[0].path.parent}: the exposures of {len(files)} files do not repeat {how}; say how"
            " many make one view with --bracket N"
        )
    gaps = _gaps(files)
    told = [phase for phase in phases if gaps is not None and min(_apart(gaps, phase)) >= TELLING_SHARE]
    # Twice the true length repeats as well: the shortest of those that explain the most files is the bracket.
    best = max(told or phases, key=lambda phase: (phase.covered, -phase.size))
    if gaps is not None and told:
        best = _Phase(best.pattern, _starts(evs, best.pattern, 0, _moves(gaps, best)))
    else:
        _check_only_way(files, phases, best, gaps)
    brackets = tuple(tuple(files[i : i + best.size]) for i in best.starts)
    return Grouping(brackets, _left_out(files, best))


def _check_only_way(
    files: Sequence[Taken], phases: Sequence[_Phase], best: _Phase, gaps: "_Gaps | None"
) -> None:
    """Where times do not tell the brackets: nothing else may fit as well, nor may times speak against them."""
    remedy = "remove what is left of incomplete brackets and import again"
    for other in phases:
        if (other.covered, other.size) == (best.covered, best.size) and other.starts != best.starts:
            either, or_else = (_names(_left_out(files, phase)) for phase in (best, other))
            raise ImportFault(
                f"{files[0].path.parent}: brackets of {best.size} exposures fit in two ways, and the files' times do not"
                f" tell which is right: either {either} belong to no whole bracket, or {or_else}; {remedy}"
            )
    if gaps is not None:
        starts, pauses = _apart(gaps, best)
        if starts <= -TELLING_SHARE and pauses < TELLING_SHARE:
            first = _names(files[best.starts[0] :][: best.size])
            raise ImportFault(
                f"{files[0].path.parent}: by their exposures {first} are one bracket and so on, by their times they are not;"
                f" {remedy}"
            )


def note(grouping: Grouping) -> str:
    """A sentence on the files that belong to no whole bracket; "" when all do."""
    if not grouping.left_out:
        return ""
    verbs = ("belongs", "is") if len(grouping.left_out) == 1 else ("belong", "are")
    size = len(grouping.brackets[0])
    return f"{_names(grouping.left_out)} {verbs[0]} to no whole bracket of {size} exposures and {verbs[1]} left out."


def _phases(evs: Float64[np.ndarray, " n"], size: int, distinct: bool) -> list[_Phase]:
    """The ways that brackets like one near the beginning or the end fit; what is broken may be at either end.

    `distinct` refuses a pattern with an exposure twice: nobody asked for one, so it is two brackets.
    """
    last = len(evs) - size
    found = []
    for begin in sorted({*range(min(2 * size, last + 1)), *range(max(0, last + 1 - 2 * size), last + 1)}):
        pattern = tuple((evs[begin : begin + size] - evs[begin]).tolist())
        if not distinct:
            found += [_Phase(pattern, _starts(evs, pattern, first)) for first in range(size)]
        elif min(np.diff(sorted(pattern))) > TOLERANCE_EV:
            found.append(_Phase(pattern, _starts(evs, pattern, 0)))
    return found


def _starts(
    evs: Float64[np.ndarray, " n"],
    pattern: Sequence[float],
    first: int,
    moves: Bool[np.ndarray, " g"] | None = None,
) -> tuple[int, ...]:
    """First files of the brackets from file `first` on; none has one of the `moves` (from a file to its next) inside."""
    size = len(pattern)
    if len(evs) < size:
        return ()
    windows = np.lib.stride_tricks.sliding_window_view(evs, size)
    fits = np.abs(windows - windows[:, :1] - np.array(pattern)).max(axis=1) <= TOLERANCE_EV
    if moves is not None:
        fits &= ~np.lib.stride_tricks.sliding_window_view(moves, size - 1).any(axis=1)
    found, i = [], first
    while i < len(fits):
        if fits[i]:
            found.append(i)
        i += size if fits[i] else 1
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class _Gaps:
    """From each file to the next."""

    between_starts_s: Float64[np.ndarray, " g"]
    pauses_s: Float64[np.ndarray, " g"]  # from the end of an exposure
    resolution_s: float  # of the clock


def _gaps(files: Sequence[Taken]) -> _Gaps | None:
    """None where a file does not tell its time."""
    times = np.array([item.facts.time_s for item in files])
    if np.isnan(times).any():
        return None
    between = np.diff(times)
    exposed = np.array([item.facts.shutter_s for item in files[:-1]])
    return _Gaps(between, np.maximum(between - exposed, 0), 1.0 if np.all(times == np.floor(times)) else 0.05)


def _around(gaps: Float64[np.ndarray, " g"], phase: _Phase) -> Float64[np.ndarray, "b 2"]:
    """Of each bracket: the longest gap inside, the shortest beside it."""
    padded = np.concatenate([[np.inf], gaps, [np.inf]])  # file i lies between padded[i] and padded[i + 1]
    return np.array(
        [(padded[i + 1 : i + phase.size].max(), min(padded[i], padded[i + phase.size])) for i in phase.starts]
    )


def _apart(gaps: _Gaps, phase: _Phase) -> tuple[float, float]:
    """How far the files of a bracket follow one another faster than brackets do, by starts and by pauses.

    1: in all brackets; -1: the other way round in all. Both must say so: with an interval timer the starts are evenly
    spaced and the pauses are not, where a long exposure comes first in the bracket it is the other way round.
    """
    shares = []
    for kind in (gaps.between_starts_s, gaps.pauses_s):
        inside, beside = _around(kind, phase).T
        less, more = np.minimum(inside, beside), np.maximum(inside, beside)
        clear = (more > APART * less) & (more > less + gaps.resolution_s)
        shares.append(float(np.mean(np.where(clear, np.sign(beside - inside), 0.0))))
    return shares[0], shares[1]


def _moves(gaps: _Gaps, phase: _Phase) -> Bool[np.ndarray, " g"]:
    """Which gaps are too long to lie inside a bracket, for brackets that are told by their times."""
    inside, beside = _around(gaps.pauses_s, phase).T
    return gaps.pauses_s > (np.median(inside) + np.median(beside)) / 2


def _left_out(files: Sequence[Taken], phase: _Phase) -> tuple[Taken, ...]:
    covered = {i + k for i in phase.starts for k in range(phase.size)}
    return tuple(item for i, item in enumerate(files) if i not in covered)


def _names(items: Sequence[Taken]) -> str:
    names = [item.path.name for item in items]
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
