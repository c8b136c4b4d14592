"""How photographs differ from their renderings: in brightness, and in where the object stands."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from engine.color import luminance
from engine.types import Frames, ValidationRenders


@dataclass(frozen=True, slots=True)
class DisplacementConfig:
    """Of the photographs, beside their renderings."""

    floor: float = 0.05  # of the median: radiance from which on logarithms are linear
    eroded_px: int = 2  # of the mask's border, where the room shows through
    steps: int = 8  # of reweighting
    cauchy: float = 2.0  # width of the weight, in the residuals' spread
    blocks: int = 8  # along the mask's longer side: residuals are alike within them


CONFIG = DisplacementConfig()


def rerendering_error(frames: Frames, renders: ValidationRenders, mask: Bool[np.ndarray, "h w"]) -> float:
    """Median relative error of the views' renderings; 0 without any."""
    if not renders.views:
        return 0.0
    truth, answer = frames.radiance[list(renders.views)][:, mask], renders.radiance[:, mask]
    return float(np.median(np.abs(answer - truth) / np.maximum(truth, 0.02 * np.median(truth))))


def object_shift(frames: Frames, renders: ValidationRenders, mask: Bool[np.ndarray, "h w"]) -> float:
    """Pixels that the object stands apart in two of the views, at least: two standard errors less than measured, the
    largest of all pairs. NaN with fewer than two views, or nothing to tell it by."""
    window = tuple(slice(at.min(), at.max() + 1) for at in np.nonzero(mask))
    told = [
        displacement(picture[window], frames.radiance[view][window], (mask & ~frames.clipped[view])[window])
        for view, picture in zip(renders.views, renders.radiance, strict=True)
    ]
    apart = [
        np.linalg.norm(one[0] - other[0]) - 2 * np.sqrt(np.sum(one[1] ** 2 + other[1] ** 2) / 2)
        for one, other in combinations(told, 2)
    ]
    known = [float(px) for px in apart if np.isfinite(px)]
    return max(0.0, *known) if known else np.nan


def displacement(
    rendered: Float[np.ndarray, "h w 3"],
    photographed: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "2 2"]:
    """Pixels down and right by which a photographed object is displaced from its rendering, and their standard errors.

    One step of Lucas and Kanade (1981) between logarithms of luminance, whose offset is the exposure's. Cauchy weights let
    glints and shadows that were not rendered count little. Neighbours misfit alike: standard errors are those of blocks of pixels
    (White 1980, clustered).
    """
    within = ndimage.binary_erosion(mask, iterations=CONFIG.eroded_px)
    if within.sum() < CONFIG.blocks**2:
        return np.full((2, 2), np.nan)
    pictures = luminance(photographed), luminance(rendered)
    floor = CONFIG.floor * max(float(np.median(pictures[0][mask])), np.finfo(np.float32).tiny)
    photo, made = (np.log(np.maximum(picture, 0) + floor) for picture in pictures)
    slopes = np.gradient((photo + made) / 2)
    terms = np.stack([-slopes[0][within], -slopes[1][within], np.ones(within.sum())], axis=1)
    off = (photo - made)[within]
    weight, rest, normal = np.ones(len(off)), off, np.zeros((3, 3))
    found = np.zeros(3)
    for _ in range(CONFIG.steps):
        normal = (terms * weight[:, None]).T @ terms
        found = np.linalg.lstsq(normal, terms.T @ (weight * off), rcond=None)[0]
        rest = off - terms @ found
        weight = 1 / (1 + (rest / (CONFIG.cauchy * 1.4826 * np.median(np.abs(rest)) + 1e-9)) ** 2)
    side = -(-max(mask.shape) // CONFIG.blocks)
    row, column = np.nonzero(within)
    block = row // side * CONFIG.blocks + column // side
    scores = np.stack([np.bincount(block, weight * rest * term) for term in terms.T], axis=1)
    inverse = np.linalg.pinv(normal, hermitian=True)
    return np.stack([found[:2], np.sqrt(np.diag(inverse @ scores.T @ scores @ inverse))[:2]])
