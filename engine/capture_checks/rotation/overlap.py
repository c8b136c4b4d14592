"""Does a shot show enough of the room that earlier shots show? Features of the background, matched and verified.

Source: SIFT (Lowe 2004) as RootSIFT; `two_view` for the geometry. Of the motions that may explain a pair up to four
are kept, and `rotation_averaging` chooses by what other pairs say. Pixels are those of a picture at most 640 wide.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int, UInt8

from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.rotation.two_view import RelativePose, agreeing, followed, motions
from engine.capture_checks.shot_preview import ShotPreview
from engine.hdr.develop import averaged
from engine.sfm.features import mutual, sift, tone_mapped
from engine.sfm.mapping import best_of_both
from engine.sfm.rig_alignment import angle_between

EDGE_PX = 640
MOST = 800  # features of a shot
PEAK = 0.0033  # of the tone-mapped picture, from 0 to 1: least contrast of a feature
MARGIN = 0.015  # of the longer side, kept free of features around the object
COARSE = 192  # features of each shot that vote on which to match
SIMILAR = 0.85 * 512**2  # of descriptors of length 512: may show the same point
PARTNERS = 4  # earlier shots that are matched in full
RATIO = 0.8
STOOD_PX = 1.5  # what moved less than this between two shots moves with the camera
STOOD_SHARE = 0.7  # unless so much of the picture did: then the camera did not move
ALIKE_DEG = 0.5
TURNS = 4
ENOUGH = 15  # inliers that the pipeline needs to place a view; here with fewer features
FEWEST_FEATURES = 60


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Features of one shot's background."""

    points: Float64[np.ndarray, "n 2"]  # from the picture's centre, in widths; x right, y down
    descriptors: UInt8[np.ndarray, "n 128"]
    coarse: Int[np.ndarray, " c"]  # the strongest ones
    pixel: float  # one pixel, in widths


@dataclass(frozen=True, slots=True, eq=False)
class ViewPair:
    """What two shots have in common."""

    earlier: int
    later: int
    inliers: int
    turns: tuple[RelativePose, ...]  # best first; empty without a motion
    points: tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, "n 2"]]  # what was matched, as in `Marks`
    pixel: float


def detect_features(glance: ShotPreview, object_mask: Bool[np.ndarray, "H W"] | None) -> Features:
    """Features of the background; of everything while nobody knows where the object is."""
    by = max(1, int(np.ceil(max(glance.fine.shape) / EDGE_PX)))
    light = averaged(np.maximum(glance.fine, 0), by)
    shot, floor = glance.noise
    level = max(10 * floor, 100 * shot, 0.2 * float(np.percentile(light[::4, ::4], 10)), 1e-30)
    picture = tone_mapped(np.repeat(light[..., None], 3, axis=-1), level, 1)
    free = None
    if object_mask is not None:
        radius = int(np.ceil(MARGIN * max(picture.shape)))
        small = averaged(object_mask.astype(np.float32), by) > 0
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1,) * 2)
        free = (cv2.dilate(small.astype(np.uint8), kernel) == 0).astype(np.uint8) * 255
    found = sift(picture, free, PEAK, MOST, lambda point: point.response)
    h, w = picture.shape
    return Features(
        (found.keypoints[:, :2].astype(np.float64) - [w / 2, h / 2]) / w,
        found.descriptors,
        np.argsort(-found.response, kind="stable")[:COARSE],
        1 / w,
    )


def likely(new: Features, earlier: Sequence[Features]) -> list[int]:
    """Indices of the earlier shots worth matching in full: the last one, and those most alike."""
    if not earlier:
        return []
    ours = new.descriptors[new.coarse].astype(np.float32)
    votes = [mutual(ours, one.descriptors[one.coarse].astype(np.float32), SIMILAR) for one in earlier]
    best = np.argsort(-np.array(votes), kind="stable")[:PARTNERS].tolist()
    return sorted({len(earlier) - 1, *best})


def matched(
    earlier: Features, later: Features
) -> tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, "n 2"]]:
    """Points of both that look alike and moved."""
    pairs = best_of_both(
        earlier.descriptors.astype(np.float32), later.descriptors.astype(np.float32), RATIO
    ).astype(np.int64)
    a, b = earlier.points[pairs[:, 0]], later.points[pairs[:, 1]]
    stood = np.linalg.norm(a - b, axis=1) < STOOD_PX * later.pixel
    return (a[~stood], b[~stood]) if len(stood) and stood.mean() < STOOD_SHARE else (a, b)


def match_pair(earlier: int, later: int, marks_of: Sequence[Features], focal: float) -> ViewPair:
    """Match two shots and find how the camera turned between them."""
    points = matched(marks_of[earlier], marks_of[later])
    pixel = marks_of[later].pixel
    return _told(earlier, later, points, pixel, motions(*points, focal, pixel), focal)


def with_focal(before: ViewPair, focal: float) -> ViewPair:
    """The same link through another lens."""
    turns = followed(before.turns, *before.points, focal, before.pixel)
    return _told(before.earlier, before.later, before.points, before.pixel, turns, focal)


def _told(
    earlier: int,
    later: int,
    points: tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, "n 2"]],
    pixel: float,
    turns: Sequence[RelativePose],
    focal: float,
) -> ViewPair:
    kept: list[RelativePose] = []
    for one in turns:
        known = any(
            angle_between(one.later_from_earlier, turn.later_from_earlier) < np.radians(ALIKE_DEG)
            for turn in kept
        )
        if not known and len(kept) < TURNS:
            kept.append(one)
    inliers = 0
    if kept:
        inliers = agreeing(kept[0], *points, focal, pixel)
    return ViewPair(earlier, later, inliers, tuple(kept), points, pixel)


def check(name: str, new: Features, links: Sequence[ViewPair], names: Sequence[str]) -> Finding | None:
    """Whether a shot can be tied to the earlier ones; nothing for the first shot."""
    if not names:
        return None
    best = max(links, key=lambda one: one.inliers, default=None)
    count = best.inliers if best is not None else 0
    if count >= ENOUGH:
        return None
    if len(new.points) < FEWEST_FEATURES:
        seen = f"the background shows only {len(new.points)} features"
    else:
        last = (
            f"{names[best.earlier]}, its best partner" if best is not None and count else "any earlier shot"
        )
        seen = f"only {count} points of the background agree with {last} ({ENOUGH} are needed)"
    remedy = (
        "photograph a pose half-way back to an earlier one, and where the view is of a bare wall turn so that"
        " furniture or corners come into it"
    )
    return Finding(name, "overlap", Severity.WARNING, float(count), "inliers", seen, remedy)
