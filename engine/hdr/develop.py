"""Turn a merged mosaic into linear Rec.709, and say how noisy the result is.

Source: DNG 1.4's colour model; error propagation. Units: counts per unit of exposure (s * ISO / 100 / f^2)
unless a name says radiance.
"""

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from engine.hdr.demosaic import demosaic, sites
from engine.hdr.exposures import Merged, SensorNoise
from engine.io.raw import Mosaic

TOE_OF_MEDIAN = 0.05  # a tenth of the light of a shadow: ratios below it tell little
TOE_ERRORS = 5.0  # and never so low that noise bends the curve


def develop(mosaic: Mosaic, merged: Merged, toe: float) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709 of a merged mosaic; `mosaic` lends pattern and colour matrix."""
    rgb = demosaic(_balanced(mosaic, merged), mosaic.pattern, toe)
    matrix = (mosaic.rec709_from_camera * camera_white(mosaic)).astype(np.float32)
    return cv2.transform(rgb, matrix)


def toe(mosaic: Mosaic, merged: Merged, noise: SensorNoise) -> float:
    """The balanced level below which `develop` counts light as near zero, for one view."""
    median = float(np.median(_balanced(mosaic, merged)))
    gain, white = noise.gain / merged.gathered(), camera_white(mosaic)
    return max(TOE_OF_MEDIAN * median, TOE_ERRORS**2 * gain, TOE_ERRORS * merged.floor / float(white.min()))


def _balanced(mosaic: Mosaic, merged: Merged) -> Float32[np.ndarray, "h w"]:
    white = camera_white(mosaic)[np.where(mosaic.pattern == 3, 1, mosaic.pattern)]
    # The bound of a saturated site is taken as if it were of the brightest channel: balanced by its own, red and
    # blue would outshine green, and every clipped lamp would turn magenta.
    balanced = merged.light / sites(white, merged.light.shape)
    np.copyto(balanced, merged.light / np.float32(white.max()), where=merged.clipped)
    return balanced


def variance(mosaic: Mosaic, merged: Merged, noise: SensorNoise) -> Float64[np.ndarray, "2"]:
    """(a, b): a grey of light x has the variance a * x + b, mean over the channels of Rec.709.

    The median over sites of the exposures that counted stands for all; demosaicing keeps the noise.
    """
    squared = np.square(mosaic.rec709_from_camera)
    return np.array(
        [
            noise.gain / merged.gathered() * float((squared @ camera_white(mosaic)).mean()),
            merged.floor**2 * float(squared.sum(axis=1).mean()),
        ]
    )


def camera_white(mosaic: Mosaic) -> Float64[np.ndarray, "3"]:
    """Camera RGB of linear Rec.709 white."""
    return np.linalg.inv(mosaic.rec709_from_camera).sum(axis=1)


def averaged(image: Float32[np.ndarray, "h w *c"], by: int) -> Float32[np.ndarray, "H W *c"]:
    """Means of `by` x `by` blocks; rows and columns that fill no block are dropped."""
    if by == 1:
        return image
    h, w = image.shape[0] // by, image.shape[1] // by
    return cv2.resize(image[: h * by, : w * by], (w, h), interpolation=cv2.INTER_AREA)
