"""How a camera turned between two shots, from points that both show.

Source: the essential matrix (Nister 2004; MAGSAC++, Barath et al. 2020) and the homography of a plane (Malis and
Vargas 2007), refined on the Sampson error. A wall that fills the view fits two motions alike: all are given, for
others to choose. Points count from the picture's centre in widths of the picture, x right, y down, and so does
`focal`; camera frames are OpenCV's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64

from engine.sfm.rig_alignment import angle_between, mean_rotation

FEWEST_MATCHES = 12  # fewer cannot carry a motion
INLIER_PX = 1.5
ROBUST_PX = 0.5
FAR_RAD = 0.035  # two degrees of parallax are common in a room
MOST_OFF_DEG = 30.0  # between a motion's turn and the turn that explains most as if there were no parallax
ROUNDS = 12
SMALL = 1e-6
# ACROSS @ v is the matrix of the cross product with v; NUDGES turn by `SMALL` about each axis.
ACROSS = np.array([
    [[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], [[0, -1, 0], [1, 0, 0], [0, 0, 0]],
], np.float64).transpose(1, 2, 0)  # fmt: skip
NUDGES = np.eye(3) + SMALL * ACROSS.transpose(2, 0, 1)


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """One motion that explains a pair."""

    later_from_earlier: Float64[np.ndarray, "3 3"]
    way: Float64[np.ndarray, " 3"]  # of the earlier camera, in the later one's frame; unit
    misfit: float  # Cauchy's loss, in squared `ROBUST_PX`


def agreeing(
    turn: RelativePose,
    a: Float64[np.ndarray, "n 2"],
    b: Float64[np.ndarray, "n 2"],
    focal: float,
    pixel: float,
) -> int:
    """How many points lie where the motion says."""
    essential = (ACROSS @ turn.way @ turn.later_from_earlier)[None]
    rest = _sampson(essential, _rays(a, focal), _rays(b, focal))[0] * focal / pixel
    return int((np.abs(rest) < INLIER_PX).sum())


def motions(
    a: Float64[np.ndarray, "n 2"], b: Float64[np.ndarray, "n 2"], focal: float, pixel: float
) -> list[RelativePose]:
    """Each motion that may explain a pair of points, best first; none where there are too few."""
    if len(a) < FEWEST_MATCHES:
        return []
    starts: list[RelativePose] = []
    lens = np.diag([focal, focal, 1.0])
    matrix, _ = cv2.findEssentialMat(
        a, b, lens, method=cv2.USAC_MAGSAC, prob=0.9999, threshold=ROBUST_PX * pixel
    )
    if matrix is not None and matrix.shape == (3, 3):
        first, second, way = cv2.decomposeEssentialMat(matrix)
        starts += [RelativePose(turn, way.ravel(), 0.0) for turn in (first, second)]
    flat, _ = cv2.findHomography(a, b, cv2.USAC_MAGSAC, INLIER_PX * pixel)
    if flat is not None and np.isfinite(flat).all() and abs(np.linalg.det(flat)) > 1e-9:
        _, rotations, ways, _ = cv2.decomposeHomographyMat(flat, lens)
        for rotation, way in zip(rotations, ways, strict=True):
            size = float(np.linalg.norm(way))
            starts.append(
                RelativePose(rotation, way.ravel() / size if size > 1e-9 else np.array([1.0, 0, 0]), 0.0)
            )
    return followed(starts, a, b, focal, pixel)


def followed(
    starts: Sequence[RelativePose],
    a: Float64[np.ndarray, "n 2"],
    b: Float64[np.ndarray, "n 2"],
    focal: float,
    pixel: float,
) -> list[RelativePose]:
    """Motions refined on points through a lens, best first."""
    if not starts:
        return []
    ray_a, ray_b = _rays(a, focal), _rays(b, focal)
    unit_a, unit_b = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in (ray_a, ray_b))
    about = _turned_only(unit_a, unit_b)
    refined = [_refined(start, ray_a, ray_b, focal / pixel) for start in starts]
    # The essential matrix fits the turn's twin, half a turn about the way between the cameras, as well.
    plausible = (
        one for one in refined if angle_between(one.later_from_earlier, about) < np.radians(MOST_OFF_DEG)
    )
    return sorted(plausible, key=lambda one: one.misfit)


def _turned_only(a: Float64[np.ndarray, "n 3"], b: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "3 3"]:
    """The turn that explains most of it as if everything were far away; unit directions."""
    weight = np.ones(len(a))
    for _ in range(8):
        turn = mean_rotation((b * weight[:, None])[:, :, None] * a[:, None, :])
        weight = 1 / (1 + np.square(b - a @ turn.T).sum(axis=1) / FAR_RAD**2)
    return turn


def _rays(points: Float64[np.ndarray, "n 2"], focal: float) -> Float64[np.ndarray, "n 3"]:
    return np.column_stack([points / focal, np.ones(len(points))])


def _sampson(essential: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """First-order distance [k n] of each pair from each of k epipolar geometries, on the plane z = 1."""
    line_b = a @ essential.transpose(0, 2, 1)
    line_a = b @ essential
    size = line_b[..., 0] ** 2 + line_b[..., 1] ** 2 + line_a[..., 0] ** 2 + line_a[..., 1] ** 2
    return (b * line_b).sum(axis=2) / np.sqrt(size + 1e-18)


def _loss(rest: np.ndarray) -> float:
    return float(np.log1p(np.square(rest / ROBUST_PX)).sum())


def _refined(start: RelativePose, a: np.ndarray, b: np.ndarray, scale: float) -> RelativePose:
    """Levenberg-Marquardt on turn (3) and way (2)."""
    turn, way, damping = start.later_from_earlier, start.way, 1e-3
    rest = scale * _sampson((ACROSS @ way @ turn)[None], a, b)[0]
    loss = _loss(rest)
    for _ in range(ROUNDS):
        # Two directions across the way: turns of it about the axes least along it.
        across = np.delete(ACROSS @ way, np.abs(way).argmax(), axis=0)
        ways = ACROSS @ (way + SMALL * across).T  # i j k: matrix i j of way k
        tries = np.concatenate([ACROSS @ way @ (NUDGES @ turn), ways.transpose(2, 0, 1) @ turn])
        slopes = ((scale * _sampson(tries, a, b) - rest) / SMALL).T
        weighted = slopes / (1 + np.square(rest / ROBUST_PX))[:, None]
        information = weighted.T @ slopes
        information += np.diag(damping * np.diag(information) + 1e-9)
        step = -np.linalg.solve(information, weighted.T @ rest)
        new_turn = cv2.Rodrigues(step[:3])[0] @ turn
        new_way = way + step[3:] @ across
        new_way = new_way / np.linalg.norm(new_way)
        new_rest = scale * _sampson((ACROSS @ new_way @ new_turn)[None], a, b)[0]
        new_loss = _loss(new_rest)
        if new_loss < loss:
            settled = loss - new_loss < 1e-3 * loss
            turn, way, rest, loss, damping = new_turn, new_way, new_rest, new_loss, 0.3 * damping
            if settled:
                break
        else:
            damping *= 10
            if damping > 1e3:
                break
    return RelativePose(turn, way, loss)
