"""What moved or changed while the photographs were taken: how far each pixel of each view is to be believed.

A person who walks through is in one view of a place and not in the others. So every view is rendered under the fit so
far, and the log of photographed over rendered is held against what is usual at that place: its median over the views
that show the same Gaussians, and its spread around that. What is wrong in all views alike, as a fit that is not yet
sharp or a screen that flickers, is usual there and costs no belief. World frame; misfits in log radiance.
"""

# The stubs of scipy misstate what comes back here.
# pyright: reportArgumentType=false

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from engine.light.photographs import Photographs
from engine.light.rasterise import Run, Shapes, push_back, render

BLUR = 1 / 64
"""Reach of the smoothing (standard deviation), in picture widths: what moves is larger than what a fit leaves unsharp."""
FEWEST = 3  # views that must show a place for one of them to be doubted
SHOWN = 0.5  # of a pixel: a view shows a Gaussian that covers so much of its picture
USUAL = 4.0
"""So many robust standard deviations from the median are not strange."""
LEVEL = 0.15
"""Misfit in log radiance that is not strange anywhere, and the excess over it that halves a weight."""


def believed(
    photographs: Photographs, geometry: Shapes, colours: Float[np.ndarray, "k 3"], knee: float, run: Run
) -> Photographs:
    """The photographs with less weight where a view shows what the others do not; else the very same weights.

    Clipped pixels are lower bounds, which are not doubted; nor is what fewer than FEWEST views show.
    """
    count = len(photographs.weight)
    misfit = np.stack([_misfit(photographs, view, geometry, colours, knee, run) for view in range(count)])
    told = np.full((count, len(colours)), np.nan, np.float32)
    shares = np.where(photographs.clipped, 0, photographs.weight)
    nothing, none = np.zeros_like(shares[0]), np.zeros(shares[0].shape, bool)
    for view in range(count):
        # The linear loss of `push_back`: its slope by a Gaussian's colour is what the pixels hold, summed over its share.
        held = np.stack([shares[view] * misfit[view], shares[view], nothing], -1).astype(np.float32)
        _, sums = push_back(
            geometry, colours, photographs.pinhole(view), 0.0, held, nothing, none, 0.0, 0.0, nothing, run
        )
        seen = sums.colours[:, 1] > SHOWN
        told[view, sums.index[seen]] = sums.colours[seen, 0] / sums.colours[seen, 1]
    known = np.isfinite(told).sum(0) >= FEWEST
    usual, spread = np.zeros(len(known)), np.zeros(len(known))
    usual[known] = np.nanmedian(told[:, known], axis=0)
    spread[known] = 1.4826 * np.nanmedian(np.abs(told[:, known] - usual[known]), axis=0)
    places = np.stack([usual, spread, known], 1)
    weight = photographs.weight.copy()
    for view in range(count):
        at = render(geometry, places, photographs.pinhole(view), 0.0, run)[..., :3]
        sure = np.maximum(at[..., 2], 0.5)
        excess = np.abs(misfit[view] - at[..., 0] / sure) - np.maximum(LEVEL, USUAL * at[..., 1] / sure)
        strange = (excess > 0) & (at[..., 2] > 0.5) & ~photographs.clipped[view]
        weight[view][strange] /= 1 + (excess[strange] / LEVEL).astype(np.float32) ** 2
    return replace(photographs, weight=weight)


def _misfit(photographs, view, geometry, colours, knee, run) -> Float[np.ndarray, "h w"]:
    """Smoothed log of photographed over rendered, mean over channels; clipped pixels say nothing."""
    ours = render(geometry, colours, photographs.pinhole(view), 0.0, run)[..., :3]
    theirs = np.maximum(photographs.radiance[view], 0)
    share = np.where(photographs.clipped[view], 0, photographs.weight[view]).astype(np.float64)
    gap = np.log((knee + theirs) / (knee + ours)).mean(-1)
    reach = max(1.0, BLUR * share.shape[1])
    return gaussian_filter(share * gap, reach) / np.maximum(gaussian_filter(share, reach), 1e-6)
