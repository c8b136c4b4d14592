"""Which pose would help most next, and whether a plan turns about one axis only.

A pose helps by the unseen directions it would show, weighed by how much they light the object; it must overlap an
earlier shot enough to be tied to it, and of poses that help alike the nearer one is better. All by turns only, as if
the room were far away.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.planning.coverage import DIRECTIONS, UNSEEN, Coverage, Sight, need, seen_by
from engine.capture_checks.planning.plan_precision import LAMP_ERROR, certainty
from engine.geometry import fibonacci_sphere
from engine.sfm.rig_alignment import angle_between

OVERLAP = 0.35  # of what a pose shows, seen by one earlier shot as well
GAZES = 400  # that are tried for hands, 10 degrees apart
ENOUGH_GAIN = 0.01  # of the sphere; less is not worth a pose
STEEP_DEG = 65.0  # pointing more steeply, left and right mean little
SAME_AXIS_DEG = 10.0  # rms; axes of turns nearer to one another than that are one
GOLDEN_RAD = np.pi * (3 - 5**0.5)
ROWS_DEG = 70.0  # up and down to which the tilted rows go that a plan is compared with


@dataclass(frozen=True, slots=True)
class NextView:
    """The pose that would help most."""

    index: int  # of the poses offered; -1 for hands
    gain: float  # share of the sphere that it adds
    overlap: float  # share of what it shows that one earlier shot shows too
    sentence: str


def order(
    sight: Sight,
    done: Float[np.ndarray, "k 3 3"],
    left: Float[np.ndarray, "m 3 3"],
) -> list[int]:
    """Every pose of `left`, by index, the most helpful first, then the most helpful after that one ..."""
    directions = fibonacci_sphere(DIRECTIONS)
    shown = _shown(sight, left, directions)
    before = list(_shown(sight, done, directions))
    seen = np.any(before, axis=0) if before else np.zeros(DIRECTIONS, bool)
    weight = need(np.concatenate([done, left]), directions)
    # Share of each pose's directions that its best partner shows too.
    overlap = np.array([_overlap(one, before) for one in shown])
    last = done[-1] if len(done) else None
    open_poses = list(range(len(left)))
    if last is None and open_poses:
        overlap[:] = 0.0
        overlap[open_poses[0]] = 1.0  # nothing to overlap with yet: the plan's own beginning
    chosen = []
    while open_poses:
        rows = np.array(open_poses)
        near = _near(left[rows], last)
        fit = overlap[rows] >= OVERLAP
        gains = (shown[rows] @ (weight * ~seen) + 1e-6) * near
        scores = np.where(fit, gains, -1) if fit.any() else overlap[rows] + 1e-6 * near
        pick = int(rows[scores.argmax()])
        open_poses.remove(pick)
        chosen.append(pick)
        seen |= shown[pick]
        last = left[pick]
        own = np.maximum(shown.sum(axis=1), 1)
        overlap = np.maximum(overlap, (shown & shown[pick]).sum(axis=1) / own)
    return chosen


def best_pose(
    sight: Sight, coverage: Coverage, done: Float[np.ndarray, "k 3 3"], left: Float[np.ndarray, "m 3 3"]
) -> NextView | None:
    """The most helpful of a rig's poses; None without any."""
    if not len(left):
        return None
    index = order(sight, done, left)[0]
    shown = _shown(sight, left[index : index + 1], coverage.directions)[0]
    gain = float((shown & (coverage.state == UNSEEN)).mean())
    overlap = _overlap(shown, _shown(sight, done, coverage.directions))
    return NextView(index, gain, overlap, f"the next pose adds {gain:.0%} of the sphere")


def for_hands(
    sight: Sight,
    coverage: Coverage,
    done: Float[np.ndarray, "k 3 3"],
    level_from_world: Float[np.ndarray, "3 3"] | None,
    upright_from_cam: Float[np.ndarray, "3 3"],
) -> NextView | None:
    """Where a person should point next, from where the last shot pointed; None before the first.

    Without a level world, left and up are those of the upright picture as the camera was held.
    """
    if not len(done):
        return None
    directions = coverage.directions
    last = done[-1]
    gazes = fibonacci_sphere(GAZES)
    turns = np.stack([_pointed(last, gaze) for gaze in gazes])
    shown = _shown(sight, turns, directions)
    before = _shown(sight, done, directions)
    unseen = coverage.state == UNSEEN
    weight = 0.5 * coverage.weight + 0.5 / len(directions)
    overlap = (shown.astype(np.float32) @ before.T.astype(np.float32)).max(axis=1) / np.maximum(
        shown.sum(axis=1), 1
    )
    scores = np.where(overlap >= OVERLAP, (shown @ (weight * unseen)) * _near(turns, last), -1)
    pick = int(scores.argmax())
    gain = float((shown[pick] & unseen).mean())
    if gain < ENOUGH_GAIN:
        return NextView(
            -1, gain, float(overlap[pick]), "no pose would add 1 % of the sphere: the room is seen"
        )
    level = upright_from_cam @ last if level_from_world is None else level_from_world
    way = _way(level @ last[2], level @ gazes[pick], level_from_world is not None)
    return NextView(-1, gain, float(overlap[pick]), f"{way}: adds {gain:.0%} of the sphere")


def one_axis(cam_from_world: Float[np.ndarray, "n 3 3"], sight: Sight) -> Finding | None:
    """A warning where all turns of a plan are about one axis, with what that costs."""
    if len(cam_from_world) < 3:
        return None
    # An axis that all turns share is one direction of the camera's frame that stays put in the world.
    values, vectors = np.linalg.svd(cam_from_world.transpose(0, 2, 1).mean(axis=0))[1:]
    off_deg = np.degrees(np.sqrt(max(2 * (1 - float(values[0])), 0)))
    if off_deg > SAME_AXIS_DEG:
        return None
    directions = fibonacci_sphere(DIRECTIONS)
    shown = _shown(sight, cam_from_world, directions).any(axis=0)
    unseen = 1 - float(shown.mean())
    ours, rows = certainty(cam_from_world), certainty(_tilted_rows(len(cam_from_world), vectors[0]))
    worse = ours.worst / rows.worst
    seen = (
        f"all poses turn about one axis (within {off_deg:.0f} degrees): {unseen:.0%} of the room's directions"
        f" (floor and ceiling of a level rig) stay unseen, normals are {worse:.1f} times less certain in their"
        f" worst direction than with tilted rows, and lamps told {LAMP_ERROR:.0%} too dim cost"
        f" {ours.lamp_deg:.1f} degrees instead of {rows.lamp_deg:.1f}"
    )
    remedy = (
        "add rows of poses with the head tilted up and down by 30 degrees and more; without a tilt axis, prop the"
        " whole rig up and take a second round"
    )
    return Finding("", "plan", Severity.WARNING, worse, "times the error", seen, remedy)


def _shown(
    sight: Sight, turns: Float[np.ndarray, "n 3 3"], directions: Float[np.ndarray, "d 3"]
) -> Bool[np.ndarray, "n d"]:
    if not len(turns):
        return np.zeros((0, len(directions)), bool)
    return np.stack([seen_by(sight, turn, directions)[0] for turn in turns])


def _overlap(shown: Bool[np.ndarray, " d"], before: Iterable[np.ndarray]) -> float:
    return max((float((shown & one).sum()) for one in before), default=0.0) / max(int(shown.sum()), 1)


def _near(turns: Float[np.ndarray, "m 3 3"], last: np.ndarray | None) -> Float64[np.ndarray, " m"]:
    """1 for poses as the last one, half for those turned right round."""
    if last is None:
        return np.ones(len(turns))
    return 1 - angle_between(turns, np.broadcast_to(last, turns.shape)) / (2 * np.pi)


def _pointed(cam_from_world: np.ndarray, gaze: np.ndarray) -> Float64[np.ndarray, "3 3"]:
    """The camera turned by the shortest way until it looks along `gaze`."""
    axis = np.cross(cam_from_world[2], gaze)
    sine, cosine = float(np.linalg.norm(axis)), float(cam_from_world[2] @ gaze)
    if sine < 1e-9:
        axis, sine = cam_from_world[1], 1.0  # straight back, if at all: about the camera's own upright axis
        angle = np.pi if cosine < 0 else 0.0
    else:
        angle = np.arctan2(sine, cosine)
    turn = cv2.Rodrigues(axis / sine * angle)[0]
    return cam_from_world @ turn.T


def _way(now: Float64[np.ndarray, " 3"], then: Float64[np.ndarray, " 3"], level: bool) -> str:
    """From one gaze to another, in a frame with y down, as one would say it."""
    pitch_now, pitch = (float(np.degrees(np.arcsin(np.clip(-gaze[1], -1, 1)))) for gaze in (now, then))
    if level and abs(pitch) > STEEP_DEG:
        return f"point {'up to the ceiling' if pitch > 0 else 'down to the floor'}"
    yaw = np.degrees(np.arctan2(then[0], then[2]) - np.arctan2(now[0], now[2]))
    yaw = (float(yaw) + 180) % 360 - 180
    climb = pitch - pitch_now
    parts = [
        f"turn {abs(yaw):.0f} degrees {'right' if yaw > 0 else 'left'}" if abs(yaw) > 5 else "",
        f"point {abs(climb):.0f} degrees {'up' if climb > 0 else 'down'}" if abs(climb) > 5 else "",
    ]
    way = " and ".join(part for part in parts if part) or "stay about there"
    return way if level else f"{way}, as the camera was held last"


def _tilted_rows(count: int, axis: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Turns of a rig with two axes, its gazes evenly between `ROWS_DEG` down and up; pan about `axis`."""
    across = np.cross(axis, [0.0, 0.0, 1.0])
    across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-6 else np.array([1.0, 0, 0])
    heights = np.linspace(-1, 1, count) * np.sin(np.radians(ROWS_DEG))
    turns = []
    for number, tilt in enumerate(np.arcsin(heights)):
        pan = cv2.Rodrigues(axis * GOLDEN_RAD * number)[0]
        turns.append((pan @ cv2.Rodrigues(across * tilt)[0]).T)
    return np.stack(turns)
