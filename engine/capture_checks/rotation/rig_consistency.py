"""Did the picture turn as the rig says? A motor that stalls or a belt that slips is not noticed by an open-loop rig.

Each pair of shots that shows the same background tells by how much the camera turned between them (`two_view`), to a
degree or two and a tenth of the turn where the lens is known (measured on the studio's rooms). That nothing turned at all is
told by any lens: then every point stays where it was. The pair with most in common decides, but where another
agrees with the rig nothing is said: one wrong match raises no alarm, and a slip is reported once, since later shots agree
with those after it. Angles are degrees; points as in `overlap`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.rotation.overlap import ENOUGH, STOOD_PX, ViewPair
from engine.sfm.rig_alignment import angle_between

LEAST_DEG = 1.0  # a turn of less moves points too little to tell
SLACK_DEG, SLACK_SHARE = 2.0, 0.3  # between the rig's turn and the picture's
SLACK_UNKNOWN = 0.75  # share, as long as the lens is only assumed
AGREE_SHARE = 0.1  # beside `SLACK_DEG`: pairs that are no further off agree with the rig
COLUMNS, ROWS = 4, 3  # cells of the picture
WHOLE_SHARE = 0.7  # of the cells: what stood still in so many is no object

Rotation = Float64[np.ndarray, "3 3"]


def check(
    name: str,
    links: Sequence[ViewPair],
    logged: Sequence[Rotation | None],
    names: Sequence[str],
    lens_known: bool,
    object_known: bool,
) -> Finding | None:
    """Whether the picture contradicts the rig.

    Args:
        links: of this shot with earlier ones.
        logged: cam_from_world of all shots as the rig tells it; the last is this shot's.
        names: of the earlier shots.
        object_known: its features were left out of the links; else they may be most of them, and stand still.
    """
    told = [pair for one in links if (pair := _told(one, logged, object_known)) is not None]
    if not told:
        return None
    best = max(told, key=lambda one: one.weight)
    if best.near(SLACK_SHARE if lens_known else SLACK_UNKNOWN) or any(one.near(AGREE_SHARE) for one in told):
        return None
    how = "did not turn" if best.shown_deg < LEAST_DEG else f"turned by {best.shown_deg:.0f} degrees"
    if abs(best.rig_deg - best.shown_deg) < best.off_deg / 2:
        how += ", another way"
    seen = f"the rig says it turned by {best.rig_deg:.0f} degrees since {names[best.earlier]}, but the picture {how}"
    remedy = (
        "see whether a motor is stuck or a belt slips, and whether steps per degree, directions and axes are those of"
        " this rig; then home it and take this pose again"
    )
    return Finding(name, "turn", Severity.STOP, best.off_deg, "degrees", seen, remedy)


@dataclass(frozen=True, slots=True)
class _Pair:
    """What the rig says of a pair of shots, and what they show; degrees."""

    earlier: int
    weight: int  # points in common
    rig_deg: float
    shown_deg: float
    off_deg: float  # between the two turns
    stood: bool = False

    def near(self, share: float) -> bool:
        """Is the picture's turn the rig's, but for `SLACK_DEG` and a share of it?"""
        return not self.stood and self.off_deg < SLACK_DEG + share * self.rig_deg


def _told(link: ViewPair, logged: Sequence[Rotation | None], object_known: bool) -> _Pair | None:
    """None where the pair tells nothing."""
    before, now = logged[link.earlier], logged[-1]
    if before is None or now is None:
        return None
    turn = now @ before.T
    rig_deg, count = _degrees(turn), len(link.points[0])
    if rig_deg < LEAST_DEG or count < ENOUGH:
        return None
    if _stood(link):
        sure = object_known or _everywhere(link)
        return _Pair(link.earlier, count, rig_deg, 0.0, rig_deg, stood=True) if sure else None
    if link.inliers < ENOUGH:
        return None
    off_deg = min(_degrees(one.later_from_earlier @ turn.T) for one in link.turns)
    return _Pair(link.earlier, link.inliers, rig_deg, _degrees(link.turns[0].later_from_earlier), off_deg)


def _degrees(turn: Rotation) -> float:
    return float(np.degrees(angle_between(turn, np.eye(3))))


def _stood(link: ViewPair) -> bool:
    """Most points are where they were: `overlap.matched` leaves them in only then."""
    earlier, later = link.points
    return float(np.median(np.linalg.norm(earlier - later, axis=1))) < STOOD_PX * link.pixel


def _everywhere(link: ViewPair) -> bool:
    """Points in nearly all of the picture: they are not the object's."""
    points = link.points[1]
    column = np.floor(COLUMNS * (points[:, 0] + 0.5))
    row = np.floor(COLUMNS * points[:, 1] + ROWS / 2)  # cells are square
    return len(set(zip(column, row, strict=True))) >= WHOLE_SHARE * COLUMNS * ROWS
