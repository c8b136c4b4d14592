"""First Gaussians: SfM points, and cones of background rays at swept depths where there are none, far ones at openings.

World frame. Candidates are thinned on a grid of (direction, log distance) around the middle of the camera
path, so that primitives start evenly spread over what the object can see of the room.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from engine.errors import LightError
from engine.light.fitting.far_light import openings
from engine.light.fitting.free_space import (
    FreeSpace,
    free_space_of,
    inside_free_space,
    unsupported,
    upsampled,
)
from engine.light.fitting.plane_sweep import FEW_POINTS, knee_of, sweep
from engine.light.fitting.training_views import Photographs
from engine.light.gaussians.gaussians import Y00
from engine.light.gaussians.rasterize import ThreadPool
from engine.types import Gaussians


def _candidates(
    photographs: Photographs, depth: Float[np.ndarray, "n h w"]
) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, "c 3"]]:
    """World points of all background pixels, with their radiance."""
    view, v, u = np.nonzero(np.isfinite(depth))
    z = depth[view, v, u]
    lens = photographs.lens
    cam = np.stack([(u + 0.5 - lens[2]) / lens[0] * z, (v + 0.5 - lens[3]) / lens[1] * z, z], axis=1)
    pose = photographs.cam_from_world[view]
    world = np.einsum("nij,ni->nj", pose[:, :, :3], cam - pose[:, :, 3])
    return world, photographs.radiance[view, v, u].astype(np.float64)


def _with_far(
    depth: Float[np.ndarray, "n h w"], far: Float[np.ndarray, "n big_h big_w"]
) -> Float[np.ndarray, "n h w"]:
    """The depth, that of far light where most of a pixel shows some."""
    _, height, width = depth.shape
    found = depth.copy()
    for view, z in enumerate(far):
        if np.isfinite(z).any():
            share = cv2.resize(
                np.isfinite(z).astype(np.float32), (width, height), interpolation=cv2.INTER_AREA
            )
            here = (share > 0.5) & np.isfinite(depth[view])
            found[view][here] = np.nanmedian(z)
    return found


def _open(free_space: FreeSpace, fine: Photographs, far: Float[np.ndarray, "n h w"]) -> FreeSpace:
    """The same where views look through openings for sure: nothing stands in a pane."""
    shown = np.isfinite(far)
    if not shown.any():
        return free_space
    return replace(
        free_space,
        lens=fine.lens,
        depth=np.where(shown, far, upsampled(free_space.depth, fine)),
        sure=np.where(shown, 1.0, upsampled(free_space.sure, fine)),
    )


def mean_radiance(
    photographs: Photographs, points: Float[np.ndarray, "m 3"], fallback: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "m 3"]:
    """Mean radiance at which views show the points; the fallback where none does."""
    total, count = np.zeros((len(points), 3)), np.zeros(len(points))
    _, height, width = photographs.weight.shape
    for i, pose in enumerate(photographs.cam_from_world):
        cam = points @ pose[:, :3].T + pose[:, 3]
        z = np.where(cam[:, 2] > 0, cam[:, 2], np.nan)
        u = photographs.lens[0] * cam[:, 0] / z + photographs.lens[2]
        v = photographs.lens[1] * cam[:, 1] / z + photographs.lens[3]
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)  # NaN compares false
        rows = np.nonzero(inside)[0]
        column, row = u[rows].astype(int), v[rows].astype(int)
        shown = photographs.weight[i, row, column] > 0
        total[rows[shown]] += photographs.radiance[i, row[shown], column[shown]]
        count[rows[shown]] += 1
    return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], fallback)


def _thin(
    directions: Float[np.ndarray, "c 3"], distance: Float[np.ndarray, " c"], priority: np.ndarray, count: int
) -> np.ndarray:
    """At most about `count` of the candidates, one for each occupied cell; the lowest priority wins."""
    order = np.argsort(priority, kind="stable")
    low, high, chosen = 0.002, 1.0, order
    for _ in range(18):
        cell = np.sqrt(low * high)
        keys = np.concatenate(
            [np.floor(directions / cell), np.floor(np.log(distance) / (4 * cell))[:, None]], axis=1
        ).astype(np.int64)
        _, first = np.unique(keys[order], axis=0, return_index=True)
        chosen = order[np.sort(first)]
        if len(chosen) > count:
            low = cell
        else:
            high = cell
        if 0.93 * count <= len(chosen) <= count:
            break
    return chosen[:count] if len(chosen) > count else chosen


def initial_gaussians(
    photographs: Photographs,
    fine: Photographs,
    points: Float[np.ndarray, "m 3"],
    count: int,
    keep_out: float | None,
    run: ThreadPool,
) -> tuple[Gaussians, FreeSpace]:
    """About `count` Gaussians to start from, and where the room is empty; `fine`: the same views, larger.

    Raises:
        LightError: hardly any background pixel shows the room.
    """
    depth, sure = sweep(photographs, points, 40, run)
    far = openings(fine, upsampled(depth, fine), knee_of(fine))
    world, radiance = _candidates(photographs, _with_far(depth, far))
    if len(world) < 50:
        raise LightError(
            f"only {len(world)} background pixels show the room; mask less or photograph more of the room"
        )
    trusted = sure[np.isfinite(depth)] > 0.5
    surface = np.concatenate([points, world[trusted] if trusted.sum() > 50 else world])
    free_space = free_space_of(
        photographs, depth, sure, surface, keep_out, 1 if len(points) >= FEW_POINTS else 2
    )
    free_space = _open(free_space, fine, far)
    priority = np.where(trusted, 1, 2)
    if len(points):
        colours = mean_radiance(photographs, points, np.median(radiance, axis=0))
        world, radiance = np.concatenate([points, world]), np.concatenate([colours, radiance])
        priority = np.concatenate([np.zeros(len(points), int), priority])
    stands = ~inside_free_space(free_space, world, np.zeros(len(world)))
    stands &= ~unsupported(free_space, world)
    world, radiance, priority = world[stands], radiance[stands], priority[stands]
    if len(world) < 50:
        raise LightError(
            f"only {len(world)} points of the room lie beyond what is kept free around the cameras "
            f"({float(np.median(free_space.radii)):.3g} scene units); lower `light.camera_clearance`, or leave it out to have it found"
        )
    offset = world - np.median(free_space.centres, axis=0)
    distance = np.linalg.norm(offset, axis=1)
    chosen = _thin(offset / distance[:, None], distance, priority, count)
    world, radiance, distance = world[chosen], radiance[chosen], distance[chosen]
    gap = KDTree(world).query(world, k=min(4, len(world)))[0][:, 1:].mean(1)
    size = np.clip(0.6 * gap, 0.002 * distance, 0.08 * distance)
    floor = 1e-4 * radiance.mean() + 1e-12
    gaussians = Gaussians(
        means=world,
        quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (len(world), 1)),
        scales=np.repeat(size[:, None], 3, axis=1),
        density=np.full(len(world), 1.2),
        radiance=np.maximum(radiance, floor)[:, None, :] / Y00,
    )
    return gaussians, free_space
