"""Linear colours of any primaries to linear Rec.709, and what of them is no light.

Source: Lindbloom for primaries and Bradford's adaptation of white; primaries are the xy of red, green, blue, white.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32

from engine.errors import RawError

Primaries = tuple[float, ...]  # eight numbers

REC709: Primaries = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
CIE_XYZ: Primaries = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)  # X, Y and Z taken for red, green and blue
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def as_rec709(
    path: Path, rgb: Float32[np.ndarray, "h w 3"], primaries: Primaries
) -> Float32[np.ndarray, "h w 3"]:
    """The colours of the file `path`, whose primaries these are, as linear Rec.709; negative values stay.

    Raises:
        RawError: the primaries span no colours.
    """
    if np.allclose(primaries, REC709, atol=2e-3):
        return rgb
    x, y = primaries[6:]
    if not (np.isfinite(primaries).all() and y > 0 and _spans(primaries)):
        told = ", ".join(f"{value:g}" for value in primaries)
        raise RawError(
            f"{path}: its primaries (xy of red, green, blue and white: {told}) span no colours; export it with"
            " those of Rec.709"
        )
    return (rgb @ rec709_from(primaries).T).astype(np.float32)


def rec709_from(primaries: Primaries) -> Float[np.ndarray, "3 3"]:
    """Linear RGB of other primaries to Rec.709; white goes to white."""
    source, target = xyz_from(primaries), xyz_from(REC709)
    source_cone, target_cone = BRADFORD @ source.sum(axis=1), BRADFORD @ target.sum(axis=1)
    adapt = np.linalg.inv(BRADFORD) @ np.diag(target_cone / source_cone) @ BRADFORD
    return np.linalg.inv(target) @ adapt @ source


def xyz_from(primaries: Primaries) -> Float[np.ndarray, "3 3"]:
    """Linear RGB of the primaries, imaginary ones included, to CIE XYZ; white has Y = 1."""
    corners, white = _chromaticities(primaries)
    return corners * np.linalg.solve(corners, white / white[1])


def _spans(primaries: Primaries) -> bool:
    """Whether white is a mixture of the three: then they lie on no line, and white is light."""
    corners, white = _chromaticities(primaries)
    flat = abs(np.linalg.det(corners)) < 1e-6
    return not flat and bool((np.linalg.solve(corners, white) > 0).all() and (BRADFORD @ white > 0).all())


def _chromaticities(
    primaries: Primaries,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """x, y, z of red, green and blue as columns, and of white."""
    xy = np.array(primaries, np.float64).reshape(4, 2)
    xyz = np.column_stack([xy, 1 - xy.sum(axis=1)])
    return xyz[:3].T, xyz[3]


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
