"""What is made of radiance in many rooms: its luminance, and how far one picture is from another.

Linear Rec.709, any scale; numpy alone, so that whoever needs these loads nothing else.
"""

import numpy as np
from jaxtyping import Bool, Float

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec.709
FLOOR = 0.01
"""Of the object's median luminance: the least that an error is taken relative to."""


def luminance(radiance: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
    return np.asarray(radiance @ LUMINANCE.astype(radiance.dtype))


def relative_error(
    photographed: Float[np.ndarray, "h w 3"],
    rendered: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "h w"]:
    """(rendered - photographed) / photographed of luminance, float32; NaN outside the mask."""
    error = np.full(mask.shape, np.nan, np.float32)
    true, made = luminance(photographed[mask]), luminance(rendered[mask])
    if true.size:
        error[mask] = (made - true) / np.maximum(true, max(FLOOR * float(np.median(true)), 1e-12))
    return error
