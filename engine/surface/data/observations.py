"""The object's pixels as the solver reads them: radiance per view with how far each value can be trusted.

Values are compared as logarithms, log(x + eps), so that a shadow counts as much as a highlight; eps is a
small share of the pixel's own median, below which ratios mean nothing.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_erosion, distance_transform_edt, label

from engine.types import Frames

CAUCHY, PLAIN = 2.0, 1e6
"""Width of the Cauchy weight in units of the pixel's own residual spread; and one so wide that every residual counts
in full: plain least squares."""


def connected_regions(
    mask: Bool[np.ndarray, "h w"], corners: bool = False
) -> tuple[Int[np.ndarray, " p"], int]:
    """Which connected part every pixel of the mask belongs to, from 0, and how many there are; also by `corners`."""
    touching = np.ones((3, 3)) if corners else None
    found: tuple[np.ndarray, int] = label(mask, touching)
    return found[0][mask] - 1, found[1]


def pixel_index(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """The pixels of a mask in row order; -1 off it."""
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(mask.sum())
    return index


def parent_index(small: Bool[np.ndarray, "h2 w2"], mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, " p"]:
    """For each of the mask's pixels the nearest of those of half the size."""
    nearest = distance_transform_edt(~small, return_distances=False, return_indices=True)
    index = pixel_index(small)[tuple(nearest)]  # pyrefly: ignore[bad-argument-type]
    v, u = np.nonzero(mask)
    return index[np.minimum(v // 2, small.shape[0] - 1), np.minimum(u // 2, small.shape[1] - 1)]


def shifted_neighbours(
    mask: Bool[np.ndarray, "h w"], steps: Int[np.ndarray, "k 2"]
) -> Int[np.ndarray, "p k"]:
    """For every pixel of a mask the ones that stand so many rows and columns off, in row order; -1 off it."""
    margin = int(np.abs(steps).max())
    padded = np.pad(pixel_index(mask), margin, constant_values=-1)
    v, u = np.nonzero(padded >= 0)
    return padded[v[:, None] + steps[:, 0], u[:, None] + steps[:, 1]]


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """`p` object pixels in `n` fitted views; the view-and-channel axis `v` = 3 n is view-major."""

    radiance: Float[np.ndarray, "p v"]  # float32
    weight: Float[np.ndarray, "p v"]  # 1 / variance of log radiance, model error included; 0 = unusable
    eps: Float[np.ndarray, " p"]
    saturated: Float[np.ndarray, " p"]  # share of views clipped
    edge: Bool[np.ndarray, " p"]  # the pixel may hold some background
    row: Int[np.ndarray, " p"]  # of `beside`; -1: nothing is beside it
    beside: Float[np.ndarray, "b v"]  # float32, radiance photographed just outside the object's rim
    cauchy: float = CAUCHY  # width of the weight that residuals are given

    def part(
        self, pixels: Int[np.ndarray, " k"], views: Int[np.ndarray, " m"] | None = None
    ) -> "Observations":
        """The same of a few pixels, in some or all views."""
        columns = slice(None)
        if views is not None:
            columns = (3 * views[:, None] + np.arange(3)).ravel()
        row = self.row[pixels]
        kept = np.where(row >= 0, np.cumsum(row >= 0) - 1, -1)
        radiance, weight, beside = (
            np.ascontiguousarray(x[which][:, columns])
            for x, which in ((self.radiance, pixels), (self.weight, pixels), (self.beside, row[row >= 0]))
        )
        eps, saturated, edge = (x[pixels] for x in (self.eps, self.saturated, self.edge))
        return Observations(radiance, weight, eps, saturated, edge, kept, beside, self.cauchy)

    def with_exposure_compensated(self, drift: Float[np.ndarray, " n"]) -> "Observations":
        """As photographed had no view's log exposure drifted; weights, in logarithms, stay."""
        radiance, beside = (compensate_exposure(x, drift) for x in (self.radiance, self.beside))
        return replace(self, radiance=radiance, beside=beside)


def compensate_exposure(
    radiance: Float[np.ndarray, "q v"], drift: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "q v"]:
    """Radiance without the drift of the views' log exposure (float32)."""
    return radiance * np.repeat(np.exp(-drift), 3).astype(np.float32)


def observe(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    views: Int[np.ndarray, " n"],
    model_error: float,
    cauchy: float = CAUCHY,
    mixed: bool = True,
) -> Observations:
    """Gather the mask's pixels (row order). `model_error` is the relative misfit expected of a good model:
    it keeps a bright, nearly noiseless value from outvoting all others. `mixed`: pixels of the rim may hold a
    share of what is beside them."""
    v, u = np.nonzero(mask)
    radiance = gather_radiance(frames, views, (v, u))
    usable = ~(frames.clipped[views] | frames.dark[views])[:, mask].T
    positive = np.maximum(radiance, 0)
    level = np.median(positive.reshape(len(radiance), -1), axis=1)
    eps = 0.02 * np.maximum(level, 1e-12)
    shot, floor = frames.noise
    variance = (shot * positive + floor**2) / (positive + eps[:, None, None]) ** 2 + model_error**2
    weight = usable[..., None] / variance
    edge = mask & ~np.asarray(binary_erosion(mask, np.ones((3, 3), bool)), bool)
    count = len(radiance)
    row, place = beside_rim(mask)
    outside = np.maximum(gather_radiance(frames, views, place), 0).reshape(len(place[0]), 3 * len(views))
    # What is beside a pixel tells its share if it is not much darker: of black, a share and a lower albedo look alike.
    tells = mixed & (np.median(outside, axis=1) > 0.1 * level[row >= 0])
    row[row >= 0] = np.where(tells, np.cumsum(tells) - 1, -1)
    return Observations(
        positive.reshape(count, -1), weight.astype(np.float32).reshape(count, -1), eps.astype(np.float32),
        frames.clipped[views][:, mask].mean(0).astype(np.float32), edge[mask], row, outside[tells], cauchy,
    )  # fmt: skip


def gather_radiance(
    frames: Frames, views: Int[np.ndarray, " n"], place: tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]
) -> Float[np.ndarray, "p n 3"]:
    """Radiance (float32) at rows and columns, in some views, which may be none."""
    return np.ascontiguousarray(frames.radiance[views[:, None], *place].transpose(1, 0, 2), np.float32)


def beside_rim(
    mask: Bool[np.ndarray, "h w"],
) -> tuple[Int[np.ndarray, " p"], tuple[Int[np.ndarray, " b"], Int[np.ndarray, " b"]]]:
    """Which of the pixels have one straight beside them that is not the object's, numbered; and where that one is."""
    v, u = np.nonzero(mask)
    place = np.stack([v, u])
    found = np.zeros(len(v), bool)
    for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        there = np.stack([v, u]) + np.reshape(step, (2, 1))
        framed = np.clip(there, 0, np.reshape(mask.shape, (2, 1)) - 1)
        fresh = (there == framed).all(0) & ~mask[tuple(framed)] & ~found
        place[:, fresh] = there[:, fresh]
        found |= fresh
    row = np.where(found, np.cumsum(found) - 1, -1)
    return row, (place[0, found], place[1, found])
