"""The scale that a person gives: `edits/scale.json`, two points of the object and their distance.

Only stage *export* reads it: everything before is right up to one factor, whatever that is.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from engine.errors import SessionError, reason
from engine.io.session import Session, drop_edit, lock, write_edit

FILE = "scale.json"

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ScaleBar:
    """The two points, the (width, height) in pixels of the picture that they are of, and their distance."""

    points: tuple[Point, Point]
    size: tuple[int, int]
    length_m: float


def read(folder: Path) -> ScaleBar | None:
    """The scale bar of the session in `folder`; None where nobody gave any.

    Raises:
        SessionError: the file is damaged.
    """
    path = folder / "edits" / FILE
    try:
        content = json.loads(path.read_bytes())
        (ax, ay), (bx, by) = content["points"]
        width, height = content["size"]
        bar = ScaleBar(
            ((float(ax), float(ay)), (float(bx), float(by))),
            (int(width), int(height)),
            float(content["length_m"]),
        )
        if not (math.isfinite(bar.length_m) and bar.length_m > 0 and min(bar.size) > 0):
            raise ValueError("lengths are above 0")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(
            f"{path}: cannot be read ({reason(error)}); remove it and give the scale again"
        ) from error
    return bar


def write(session: Session, bar: ScaleBar | None) -> None:
    """Keep this scale bar in place of another; None removes it.

    Raises:
        SessionError: the length is none, a point is off the picture, or the disk refuses.
        BusyError: another process works on the session, and its inputs must not change.
    """
    if bar is not None:
        _check(bar)
    with lock(session):
        if bar is None:
            drop_edit(session, FILE)
        else:
            content = {"points": bar.points, "size": bar.size, "length_m": bar.length_m}
            write_edit(session, FILE, json.dumps(content).encode())


def _check(bar: ScaleBar) -> None:
    if not (math.isfinite(bar.length_m) and bar.length_m > 0):
        raise SessionError(f"a length of {1000 * bar.length_m:g} mm fixes no scale; give one above 0")
    width, height = bar.size
    for x, y in bar.points:
        if not (0 <= x < width and 0 <= y < height):
            raise SessionError(
                f"the scale's point {x:g}, {y:g} is off the picture of {width} x {height}; give points of the object"
            )
