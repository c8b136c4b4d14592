"""What a stage's parameters may be: numbers between bounds, words out of a few; all else is refused in one line.

Parameters check themselves as they are made, so that a plan refuses what a stage could only fail at.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from engine.errors import RoomlightError

Bounds = Mapping[str, tuple[int | float, int | float]]
MORE = math.inf
"""The upper bound of what may be as large as one likes, but not infinite."""


def check(
    params: Any,
    stage: str,
    fault: type[RoomlightError],
    bounds: Bounds,
    choices: Mapping[str, Sequence[str]] | None = None,
    or_none: Collection[str] = (),
) -> None:
    """Hold parameters against their bounds, of a tuple each number; what is left to the stage passes: None, and 0 of
    those that are `or_none`.

    Raises:
        RoomlightError: of the class `fault`; it names the parameter as `--set` takes it.
    """
    for name, (least, most) in bounds.items():
        asked = getattr(params, name)
        if asked == 0 and name in or_none:
            continue
        numbers = asked if isinstance(asked, tuple) else () if asked is None else (asked,)
        if asked == () or not all(least <= number <= most and math.isfinite(number) for number in numbers):
            told = f"{least:.10g} or more" if most == MORE else f"{least:.10g} to {most:.10g}"
            each = "one number or more, each of " if isinstance(asked, tuple) else ""
            raise fault(f"{stage}.{name} is {_shown(asked)}; give {each}{told}")
    for name, words in (choices or {}).items():
        asked = getattr(params, name)
        for word in asked if isinstance(asked, tuple) else (asked,):
            if word not in words:
                raise fault(f'{stage}.{name} is "{word}"; give {" or ".join(words)}')


def _shown(asked: Any) -> str:
    return str(list(asked)) if isinstance(asked, tuple) else str(asked)
