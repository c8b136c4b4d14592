"""How many Gaussians a room is worth: as many as even patches would paint its photographs.

Every picture is parted into squares, and those into quarters, for as long as a square's pixels differ by more than EVEN
from their mean; what is left over are patches. A view holds part of the room and views overlap, so it is patches per
pixel that count, over all pixels of the sphere that some view shows. A bare room so takes few Gaussians, a crowded
one many, and the more the finer the pictures are that the fit is trained on. Log radiance is as in Eq. (5) of the paper.
"""

import numpy as np
from jaxtyping import Float

from engine.geometry import fibonacci_sphere
from engine.light.photographs import Photographs
from engine.light.sweep import knee_of

EVEN = 0.2
"""Mean difference in log radiance up to which a square is one patch: twice what fits are off by on views they never saw.
Shot noise stays below it, and at half of it is most of what is counted."""
FEWEST, MOST = 6000, 100_000
"""Bounds of the answer: with fewer the irradiance itself suffers (ADR 30), and memory and time have an end."""
VIEWS = 24
"""Pictures that are parted, at most."""
_LARGEST = 64  # pixels along a square's edge, of the first
_DIRECTIONS = 2000


def worth(photographs: Photographs, everywhere: Photographs) -> int:
    """The number of Gaussians for a fit on pictures of this size.

    Args:
        photographs: some views, as large as they are trained on.
        everywhere: all views, small.
    """
    logs = np.log(knee_of(photographs) + np.maximum(photographs.radiance, 0))
    known = photographs.weight > 0
    patches = sum(patches_of(picture, shown) for picture, shown in zip(logs, known, strict=True))
    sphere = 4 * np.pi * float(photographs.lens[0] * photographs.lens[1]) * _seen(everywhere)
    return int(np.clip(patches / max(int(known.sum()), 1) * sphere, FEWEST, MOST))


def patches_of(picture: Float[np.ndarray, "h w c"], known: np.ndarray) -> int:
    """Even squares of one picture that show anything."""
    height, width = known.shape
    down, across = -(-height // _LARGEST), -(-width // _LARGEST)
    margin = ((0, down * _LARGEST - height), (0, across * _LARGEST - width))
    picture, known = np.pad(picture, (*margin, (0, 0))), np.pad(known, margin)
    asked, count, side = np.ones((down, across), bool), 0, _LARGEST
    while True:
        squares = (asked.shape[0], side, asked.shape[1], side)
        inside = known.reshape(squares)
        pixels = inside.sum((1, 3))
        values = picture.reshape(*squares, -1) * inside[..., None]
        mean = values.sum((1, 3)) / np.maximum(pixels, 1)[..., None]
        gap = np.abs(values - mean[:, None, :, None]) * inside[..., None]
        uneven = gap.mean(-1).sum((1, 3)) > EVEN * pixels
        count += int((asked & ~uneven & (pixels > 0)).sum())
        if side == 1:
            return count
        asked, side = np.repeat(np.repeat(asked & uneven, 2, 0), 2, 1), side // 2


def _seen(photographs: Photographs) -> float:
    """Share of the sphere of directions that some view shows, as if the room were far."""
    directions = fibonacci_sphere(_DIRECTIONS)
    seen = np.zeros(len(directions), bool)
    _, height, width = photographs.weight.shape
    for pose, weight in zip(photographs.cam_from_world, photographs.weight, strict=True):
        cam = directions @ pose[:, :3].T
        ahead = np.nonzero(cam[:, 2] > 0)[0]
        at = photographs.lens[:2] * cam[ahead, :2] / cam[ahead, 2:] + photographs.lens[2:]
        inside = (at >= 0).all(1) & (at < (width, height)).all(1)
        u, v = at[inside].astype(int).T
        seen[ahead[inside]] |= weight[v, u] > 0
    return float(seen.mean())
