"""Which Gaussians shine together: lamps one by one, the rest of the room by neighbourhood.

World frame. A group is what one gain of the light refinement moves; each bright cluster that carries a fair
share of the object's light is its own, and everything else is split by where it stands.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.vq import kmeans2
from scipy.spatial import KDTree

from engine.color import luminance
from engine.geometry import project, transform
from engine.light.clusters import clusters
from engine.light.fitting.training_views import pinhole_of
from engine.types import Frames, Gaussians, Masks, Poses

KNOWN, CLIPPED, UNSEEN, FILLED = 0, 1, 2, 3
"""What the background says of a group's brightness: what it is; the least it is; nothing, and something stands there to
be asked; nothing, between what it does show."""


@dataclass(frozen=True, slots=True)
class EmitterGroupsConfig:
    """What is a lamp, and in how many parts the rest comes."""

    lamps: int = 8  # bright clusters, at most, that get a gain of their own
    bright: float = 8.0  # a Gaussian is whose luminance exceeds the room's mean radiance so many times
    lamp_share: float = 0.005  # of all light, from which on a cluster is a lamp
    near_share: float = 0.15  # of their distance to the object, within which bright Gaussians are one lamp
    unseen_sr: float = 0.18  # of a group that no photograph shows, before any is divided: a cap of 14 degrees
    parts: int = 3  # that such a group is divided into, if it has so many patches
    clipped_share: float = 0.02  # of a group's light, from which on its brightness is open


CONFIG = EmitterGroupsConfig()


@dataclass(frozen=True, slots=True, eq=False)
class EnvironmentPatches:
    """What closes the room where no photograph looked, and which of it shine together."""

    towards: Float[np.ndarray, "q 3"]  # world, unit, from amid the cameras
    group: Int[np.ndarray, " q"]  # of each; these groups' numbers follow one another
    solid: float  # angle of each, steradians

    def extent(self, groups: int) -> Float[np.ndarray, " g"]:
        """The share that every group has of the solid angle of a whole one, at most 1; 1 of all other groups."""
        share = np.bincount(self.group, minlength=groups) * self.solid / CONFIG.unseen_sr
        return np.where(share > 0, np.minimum(share, 1), 1)

    def split(self, which: Int[np.ndarray, " d"]) -> Int[np.ndarray, " q"]:
        """The patches' groups, each of `which` in parts: one keeps its number, the others get new ones at the end."""
        group = self.group.copy()
        for one in which:
            (here,) = np.nonzero(self.group == one)
            if len(here) > 1:
                part = _parts(self.towards[here], min(CONFIG.parts, len(here)))
                group[here] = np.where(part > 0, group.max() + part, one)
        return group


def _parts(towards: Float[np.ndarray, "k 3"], count: int) -> Int[np.ndarray, " k"]:
    """Each direction's part of `count`: around the directions that are farthest apart, one after the other."""
    chosen = [int(np.argmin(towards @ towards.mean(0)))]
    while len(chosen) < count:
        chosen.append(int(np.argmin((towards @ towards[chosen].T).max(1))))
    return np.argmax(towards @ towards[chosen].T, axis=1)


def group_emitters(
    gaussians: Gaussians, centre: Float[np.ndarray, " 3"], rest: int, seed: int
) -> Int[np.ndarray, " k"]:
    """A group number for every Gaussian, as seen from `centre` (where the object is, on average)."""
    away = gaussians.means - centre
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    level = _luminance(gaussians)
    area = np.sort(gaussians.scales, axis=1)[:, 1:].prod(1)
    solid = np.minimum(area / distance**2, 1.0) * (1 - np.exp(-gaussians.density))
    energy = level * solid
    bright = np.nonzero(level > CONFIG.bright * energy.sum() / max(solid.sum(), 1e-30))[0]
    group = np.full(len(energy), -1)
    count = 0
    if len(bright):
        cluster = clusters(gaussians.means[bright] / (CONFIG.near_share * np.median(distance[bright])), 1.0)
        carried = np.bincount(cluster, energy[bright])
        for lamp in np.argsort(-carried)[: CONFIG.lamps]:
            if carried[lamp] > CONFIG.lamp_share * energy.sum():
                group[bright[cluster == lamp]] = count
                count += 1
    others = np.nonzero(group < 0)[0]
    # Direction and log distance: neighbours on the sphere that stand at a like distance.
    feature = np.column_stack([away[others] / distance[others, None], 0.3 * np.log(distance[others])])
    generator = np.random.default_rng(seed)
    take = generator.choice(len(others), min(4000, len(others)), replace=False, p=_shares(energy[others]))
    centres, _ = kmeans2(feature[take], min(rest, len(take)), rng=seed, minit="++")
    group[others] = count + KDTree(centres).query(feature)[1]
    return np.unique(group, return_inverse=True)[1]


def clipped_shares(
    gaussians: Gaussians, group: Int[np.ndarray, " k"], frames: Frames, masks: Masks, poses: Poses
) -> Float[np.ndarray, " g"]:
    """The share of every group's light that was photographed clipped, of which the background gives a lower bound only;
    in the views that look its way, for others may hide it."""
    count = int(group.max()) + 1
    seen, cut = np.zeros(len(group)), np.zeros(len(group))
    height, width = frames.clipped.shape[1:]
    for view in np.nonzero(poses.registered)[0]:
        grown = cv2.dilate(frames.clipped[view].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        inside, (u, v) = _pixels_of(poses.camera, poses.cam_from_world[view], gaussians.means, width, height)
        shown = masks.background[view][v, u]
        seen[inside] += shown
        cut[inside] += shown & grown[v, u]
    energy = _luminance(gaussians) * np.sort(gaussians.scales, axis=1)[:, 1:].prod(1)
    energy *= 1 - np.exp(-gaussians.density)
    share = np.bincount(group, energy * cut / np.maximum(seen, 1), minlength=count)
    known = np.bincount(group, energy * (seen > 0), minlength=count)
    return share / np.maximum(known, 1e-30)


def _pixels_of(camera, cam_from_world, points, width, height):
    """Which points lie in the picture, and in which pixel (u, v) each of those."""
    at = transform(cam_from_world, points)
    inside = at[:, 2] > 1e-6
    at = np.where(inside[:, None], at, [0, 0, 1])
    # Far outside the picture a lens's distortion folds back into it: an ideal lens knows what is outside.
    lens, wide, high = pinhole_of(camera, camera.width)
    ideal = at[:, :2] / at[:, 2:] * lens[:2] + lens[2:]
    inside &= ((ideal >= 0) & (ideal < [wide, high])).all(1)
    uv = project(camera, at[inside])
    within = ((uv >= 0) & (uv < [width, height])).all(1)
    inside[inside] = within
    return inside, uv[within].astype(int).T


def _shares(energy: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    softened = np.sqrt(energy) + 1e-9 * np.sqrt(energy).mean() + 1e-30
    return softened / softened.sum()


def nearest_emitter(
    places: Float[np.ndarray, "*c 3"], lit: Bool[np.ndarray, "*c"], gaussians: Gaussians
) -> Int[np.ndarray, "*c"]:
    """The Gaussian that each cell's light comes from, -1 where it is dark.

    `places` is the mean place that shines into a cell, by luminance: a lamp outshines the wall beside it, so that a
    cell which holds a lamp counts as the lamp's.
    """
    found = np.full(lit.shape, -1)
    # Faint Gaussians stand everywhere, also in front of lamps; those that shine say where the light is from.
    shining = np.nonzero(_luminance(gaussians) > 0)[0]
    found[lit] = shining[KDTree(gaussians.means[shining]).query(places[lit])[1]]
    return found


def group_patches(
    patches: Gaussians, centre: Float[np.ndarray, " 3"], sphere: int, seed: int
) -> Int[np.ndarray, " k"]:
    """A group number for every patch of the unseen (see `unseen_patches.py`), by direction; `sphere` of them would close it."""
    if not len(patches.means):
        return np.zeros(0, int)
    towards = patches.means - centre
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    count = max(1, round(4 * np.pi * len(towards) / sphere / CONFIG.unseen_sr))
    return np.unique(kmeans2(towards, count, rng=seed, minit="++")[1], return_inverse=True)[1]


def _luminance(gaussians: Gaussians) -> Float[np.ndarray, " k"]:
    return np.maximum(luminance(gaussians.radiance[:, 0]), 0)


def scale_groups(
    gaussians: Gaussians, group: Int[np.ndarray, " k"], gain: Float[np.ndarray, "g 3"]
) -> Gaussians:
    """Every group under its gain."""
    return replace(
        gaussians, radiance=gaussians.radiance * gain[group][:, None].astype(gaussians.radiance.dtype)
    )
