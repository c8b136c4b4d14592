"""Look after linear images made elsewhere: refuse impossible values, estimate the noise that they carry.

Source: J. Immerkaer, "Fast noise variance estimation" (1996). Radiance in the files' own scale.
"""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from engine.color import REC709, luminance, xyz_from
from engine.errors import HdrError
from engine.sampling import evenly_spaced

# Blind to planes and edges along an axis; unit response to independent noise after division by 6.
NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
NOISE_VIEWS = 8

# The deepest filter in use, Lanczos of three lobes, falls to 0.13 of a bright pixel beside it, and reaches six pixels
# far where a picture was enlarged twofold.
UNDERSHOOT, REACH_PX = 0.2, 6
NOISE_SIGMAS = 6.0


def check_values(path: Path, radiance: Float32[np.ndarray, "h w 3"]) -> int:
    """How many values are negative, as colours outside Rec.709 are and what filters leave; refuse what light cannot be.

    Raises:
        HdrError: NaN, Inf, light below zero or nothing but zero; says how many and where the first is.
    """
    for what, wrong, remedy in (
        ("NaN", np.isnan, "fix the export"),
        ("Inf", np.isinf, "clip to the largest half float, 65504, on export"),
        ("negative", _below_zero, "switch off sharpening filters, or clip to zero"),
    ):
        bad = wrong(radiance)
        if bad.any():
            y, x, channel = (int(i) for i in np.argwhere(bad)[0])
            raise HdrError(
                f"{path}: {int(bad.sum())} of {bad.size} values are {what}, the first at x {x}, y {y}, in"
                f" {'RGB'[channel]}; {remedy}, and import again"
            )
    if not (radiance > 0).any():
        raise HdrError(f"{path}: every value is zero; export the view again or remove it")
    return int((radiance < 0).sum())


def _below_zero(radiance: Float32[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w 3"]:
    """Negative values of pixels that are no light.

    Red, green or blue of a real colour may be negative, CIE X, Y and Z never are. Below zero go only undershoots of
    filters, in proportion to what is bright beside them or to the picture's mean, and noise.
    """
    negative = radiance < 0
    if not negative.any():
        return negative
    xyz = radiance @ xyz_from(REC709).T.astype(np.float32)
    beside = cv2.dilate(xyz.max(axis=-1), np.ones((2 * REACH_PX + 1,) * 2, np.uint8))
    below = xyz.min(axis=-1) < -UNDERSHOOT * np.maximum(beside, xyz[..., 1].mean())
    if below.any():  # noise takes its time to be told, and rarely need be
        below &= xyz.min(axis=-1) < -NOISE_SIGMAS * noise(radiance[None])[1]
    return negative & below[..., None]


def noise(radiance: Float32[np.ndarray, "n h w 3"]) -> tuple[float, float]:
    """(shot, floor) such that the variance of a radiance x is about shot * x + floor**2.

    Fine texture looks like noise and is counted in: an upper bound.
    """
    levels, errors = [], []
    for view in radiance[evenly_spaced(len(radiance), NOISE_VIEWS)]:
        levels.append(cv2.blur(luminance(view), (3, 3)).ravel())
        errors.append(np.abs(cv2.filter2D(view, cv2.CV_32F, NOISE_KERNEL)).mean(axis=-1).ravel())
    level, error = np.concatenate(levels), np.concatenate(errors)
    place = np.searchsorted(np.quantile(level, np.linspace(0, 1, 17)[1:-1]), level)
    means = np.array([level[place == i].mean() for i in range(16) if (place == i).any()])
    # The mean of |x| of a normal variable is 0.798 of its standard deviation; the median shuns edges.
    spread = np.array([np.median(error[place == i]) / 0.798 for i in range(16) if (place == i).any()])
    # The darkest levels are rarely the quietest in textured rooms: the quietest level sets the floor.
    floor = float(spread.min())
    lit = means >= 0  # below zero lies only noise
    shot = float(np.median(np.maximum(spread**2 - floor**2, 0)[lit] / np.maximum(means[lit], 1e-12)))
    return shot, max(floor, 1e-6 * float(means.mean()))
