"""How far matches lie from where poses put them, beside how far from where two views alone would.

Source: Sampson's distance to an epipolar geometry (Hartley and Zisserman 2004, ch. 11.4); the geometry that fits two views
best from five matches at a time (Nister 2004; MAGSAC++, Barath et al. 2020). Points lie on the plane z = 1 of their
cameras, and so do distances: near the centre of a picture they are angles in radians. Poses are cam_from_world.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

import cv2
import numpy as np
import pycolmap
from jaxtyping import Bool, Float

FEWEST = 50  # matches of a view that tell whether its pose is right
_NEAR_DEG = 3.0  # what lies further off shows another place that looks alike, or a pose that is wholly wrong
_NEAR_SHARE = (
    0.1  # of a view's matches are near at least, if its pose is: right ones had .3, of other views' .02
)
_OFF_DEG = 0.2  # right poses are within this; turned by 0.5 deg each, views have 0.3, by 0.1 deg 0.06
_TIMES = 3.0  # what photographs tell, right poses are within: they had 1.8 of it at most, in a room of things that look alike
_LEAST = 8  # matches that a geometry of two views is fitted to
_OWN_PX = 1.0  # noise of a match that the fit of two views expects


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """The verified matches of two views."""

    first: int
    second: int
    a: Float[np.ndarray, "m 2"]
    b: Float[np.ndarray, "m 2"]


class Facts(TypedDict):
    judged: int
    off: tuple[str, ...]
    off_deg: float | None
    told_deg: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """What photographs say of poses; degrees."""

    off_deg: Float[np.ndarray, " n"]  # how far a view's matches lie off, typically; NaN where too few tell
    told_deg: float  # the same under the geometry that fits each pair of views best; NaN without pairs

    @property
    def wrong(self) -> Bool[np.ndarray, " n"]:
        """Views whose pose the photographs contradict; none where they tell nothing."""
        return np.asarray(self.off_deg > np.maximum(_OFF_DEG, _TIMES * self.told_deg))

    def facts(self, names: Sequence[str]) -> Facts:
        """As the reports of poses have it, given or found."""
        off = self.off_deg[self.wrong]
        return {
            "judged": int(np.isfinite(self.off_deg).sum()),
            "off": tuple(name for name, wrong in zip(names, self.wrong, strict=True) if wrong),
            "off_deg": float(np.median(off)) if len(off) else None,
            "told_deg": self.told_deg if np.isfinite(self.told_deg) else None,
        }


def verified(
    database: Path, camera: pycolmap.Camera, cam_from_world: Float[np.ndarray, "n 3 4"]
) -> tuple[Pair, ...]:
    """The pairs of views that have poses and matches; `camera` is of the size of the database's photographs."""
    placed = np.asarray(np.isfinite(cam_from_world).all((1, 2)))
    with pycolmap.Database.open(database) as opened:
        keypoints = [
            opened.read_keypoints(i + 1)[:, :2].astype(np.float64) for i in range(len(cam_from_world))
        ]
        ids, geometries = opened.read_two_view_geometries()
    rays = [np.asarray(camera.cam_from_img(k)) if len(k) else np.zeros((0, 2)) for k in keypoints]
    pairs = []
    for pair, geometry in zip(ids, geometries, strict=True):
        i, j = (image - 1 for image in pycolmap.pair_id_to_image_pair(pair))
        matches = np.asarray(geometry.inlier_matches)
        if len(matches) and placed[i] and placed[j]:
            pairs.append(Pair(i, j, rays[i][matches[:, 0]], rays[j][matches[:, 1]]))
    return tuple(pairs)


def support(
    pairs: Sequence[Pair], cam_from_world: Float[np.ndarray, "n 3 4"], focal_px: float, most_px: float
) -> tuple[Float[np.ndarray, " n"], float]:
    """Share of each view's matches that lie within `most_px` of the epipolar lines that the poses imply (NaN unplaced); of all.

    A view that was placed by a few matches on a repeated piece of furniture disagrees with the rest of its matches.
    """
    agree, total = np.zeros(len(cam_from_world)), np.zeros(len(cam_from_world))
    for pair in pairs:
        fit = (_under_poses(pair, cam_from_world) * focal_px < most_px).sum()
        for view in (pair.first, pair.second):
            agree[view] += fit
            total[view] += len(pair.a)
    known = np.isfinite(cam_from_world).all((1, 2))
    each = np.where(known & (total > 0), agree / np.maximum(total, 1), np.where(known, 0.0, np.nan))
    return each, float(agree.sum() / max(total.sum(), 1))


def judge(pairs: Sequence[Pair], cam_from_world: Float[np.ndarray, "n 3 4"], focal_px: float) -> Judgement:
    """How far each view's matches lie off under the poses, and how far under what fits each pair of views best.

    The second is what noise and size of the photographs leave, whatever they are; right poses do about as well. Things that look
    alike (chairs, tiles) give pairs of views matches that fit each other and no pose: such lie far off and do not count,
    unless nearly all do.
    """
    views: list[list[np.ndarray]] = [[] for _ in cam_from_world]
    own = [np.zeros(0)]
    for pair in pairs:
        off = _under_poses(pair, cam_from_world)
        views[pair.first].append(off)
        views[pair.second].append(off)
        own.append(_under_own(pair, focal_px))
    told = np.concatenate(own)
    return Judgement(
        np.degrees([_typical(np.concatenate([np.zeros(0), *off])) for off in views]),
        float(np.degrees(np.median(told))) if len(told) else float("nan"),
    )


def _typical(off: Float[np.ndarray, " m"]) -> float:
    """Median of what is near, or of all where hardly anything is; NaN of too few."""
    off = off[np.isfinite(off)]  # points that no ray of a lens that bends much meets have no place on z = 1
    if len(off) < FEWEST:
        return float("nan")
    near = off < np.radians(_NEAR_DEG)
    return float(np.median(off[near] if near.mean() >= _NEAR_SHARE else off))


def _under_poses(pair: Pair, cam_from_world: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, " m"]:
    a_from_world, b_from_world = cam_from_world[pair.first], cam_from_world[pair.second]
    rotation = b_from_world[:, :3] @ a_from_world[:, :3].T
    x, y, z = b_from_world[:, 3] - rotation @ a_from_world[:, 3]
    return _distance(pair, np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation)


def _under_own(pair: Pair, focal_px: float) -> Float[np.ndarray, " _"]:
    """Under the geometry that fits this pair best; nothing where none is found."""
    sound = np.isfinite(pair.a).all(1) & np.isfinite(pair.b).all(1)
    if sound.sum() < _LEAST:
        return np.zeros(0)
    pair = replace(pair, a=pair.a[sound], b=pair.b[sound])
    found, _ = cv2.findEssentialMat(
        pair.a, pair.b, np.eye(3), method=cv2.USAC_MAGSAC, prob=0.999, threshold=_OWN_PX / focal_px
    )
    return np.zeros(0) if found is None or found.shape != (3, 3) else _distance(pair, found)


def _distance(pair: Pair, essential: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " m"]:
    """Sampson distance; finite also for cameras at one place."""
    one = np.ones((len(pair.a), 1))
    a, b = np.hstack([pair.a, one]), np.hstack([pair.b, one])
    line_b, line_a = a @ essential.T, b @ essential
    slope = (line_a[:, :2] ** 2).sum(1) + (line_b[:, :2] ** 2).sum(1)
    return np.abs((b * line_b).sum(1)) / np.sqrt(np.maximum(slope, 1e-300))
