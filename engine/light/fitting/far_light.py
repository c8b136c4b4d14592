"""Which bright parts of the room show what lies far beyond it: sky through a window, a yard through a door.

A plane sweep gives them the depth of what has edges, the window's frame; light that is painted into the pane then hits the object
from wrong directions as the object moves. Of each bright part two hypotheses are compared by how views agree: what shines is fixed to
places at the swept depth, or to directions. World frame; misfits are in log radiance.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from engine.color import luminance
from engine.light.clusters import clusters
from engine.light.fitting.training_views import Photographs, camera_centres


@dataclass(frozen=True, slots=True)
class FarLightConfig:
    """When a part of the room counts as an opening."""

    bright: float = 2.0  # times the background's mean luminance that a pixel of it has at least
    gap: float = 0.05  # of the parts' distance, that separates two of them
    least: float = 0.01  # share of all light that a part is worth asking from
    telling: float = (
        0.8  # share of a part's light whose pixels, the brightest, are asked: frames and sills are not
    )
    footprint_px: float = 1.5  # side of the cells in which views are compared
    fewest: int = 50  # cells that two views see, under either hypothesis
    better: float = 0.5  # misfit by direction over misfit by place, at most
    distance: float = 25.0  # to which such light is put, times the part's own


def openings(
    photographs: Photographs,
    depth: Float[np.ndarray, "n h w"],
    knee: float,
    config: FarLightConfig = FarLightConfig(),
) -> Float[np.ndarray, "n h w"]:
    """The depth (z) of far light at the pixels that show some, NaN at all others; `knee` as of `plane_sweep.knee_of`."""
    light = np.stack([luminance(view.astype(np.float64)) for view in photographs.radiance])
    shown = (photographs.weight > 0) & np.isfinite(depth)
    found = np.full(depth.shape, np.nan)
    if not shown.any():
        return found
    view, v, u = at = np.nonzero(shown & (light > config.bright * light[shown].mean()))
    if len(view) < config.fewest:
        return found
    ray, z = _rays(photographs, *at), depth[at]
    centres = camera_centres(photographs)
    points, level = centres[view] + ray * z[:, None], light[at]
    length = np.linalg.norm(ray, axis=1)
    part, near = _parts(points, config.gap * float(np.median(z * length))), z * length
    logs = np.log(knee + np.maximum(photographs.radiance[at], 0)).mean(1).astype(np.float64)
    cell = config.footprint_px / float(photographs.lens[0])
    energy = np.bincount(part, level)
    for one in np.nonzero(energy >= config.least * light[shown].sum())[0]:
        (mine,) = np.nonzero(part == one)
        order = mine[np.argsort(-level[mine], kind="stable")]
        asked = order[: 1 + np.searchsorted(np.cumsum(level[order]), config.telling * energy[one])]
        distance = float(np.median(near[mine]))
        place, few = _misfit(points[asked] / (cell * distance), view[asked], logs[asked])
        way, others = _misfit(ray[asked] / (cell * length[asked, None]), view[asked], logs[asked])
        if min(few, others) >= config.fewest and way < config.better * place:
            found[view[mine], v[mine], u[mine]] = config.distance * distance / length[mine]
    return found


def _rays(
    photographs: Photographs, view: np.ndarray, v: np.ndarray, u: np.ndarray
) -> Float[np.ndarray, "k 3"]:
    """Directions of pixels, world, as long as makes their z of the view 1."""
    lens = photographs.lens
    ray = np.stack([(u + 0.5 - lens[2]) / lens[0], (v + 0.5 - lens[3]) / lens[1], np.ones(len(u))], 1)
    return np.einsum("kji,kj->ki", photographs.cam_from_world[view][:, :, :3], ray)


def _parts(points: Float[np.ndarray, "k 3"], gap: float) -> Int[np.ndarray, " k"]:
    """Which connected part each point belongs to: cells of the size `gap` that touch, also by corners, are one part."""
    cells, inside = np.unique(np.floor(points / gap).astype(np.int64), axis=0, return_inverse=True)
    return clusters(cells, 1.8)[inside.ravel()]  # sqrt(3) and a bit


def _misfit(
    at: Float[np.ndarray, "k 3"], view: Int[np.ndarray, " k"], logs: Float[np.ndarray, " k"]
) -> tuple[float, int]:
    """Median spread between the views that see the same cell of the unit grid, and how many cells several views see."""
    cell = np.unique(np.floor(at).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    views = int(view.max()) + 1
    seen, member = np.unique(cell * views + view, return_inverse=True)
    told = np.bincount(member.ravel(), logs) / np.bincount(member.ravel())
    count, total, squares = (np.bincount(seen // views, x) for x in (np.ones(len(told)), told, told * told))
    shared = count >= 2
    if not shared.any():
        return np.inf, 0
    variance = (squares[shared] - total[shared] ** 2 / count[shared]) / (count[shared] - 1)
    return float(np.sqrt(np.maximum(np.median(variance), 0))), int(shared.sum())
