"""Draws true and our incident light side by side, and by how many stops they differ: one row per view.

Equirectangular in each view's camera frame: the middle looks along +z, up is -y. Both panoramas share one
logarithmic scale; in the third, red is where ours is brighter, blue where it is darker, full at STOPS.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from PIL import Image, ImageDraw
from scipy.spatial import KDTree

from engine.color import luminance
from engine.io.png import to_8_bit
from engine.light.incident.probes import panorama_directions

ROWS = 256
STOPS = 2.0
TITLE = 16  # pixels


def write(
    path: Path,
    views: Int[np.ndarray, " k"],
    directions: Float[np.ndarray, "d 3"],
    true: Float[np.ndarray, "k d 3"],
    ours: Float[np.ndarray, "k d 3"],
) -> None:
    """One picture of some views' radiance per direction cell."""
    cell = KDTree(directions).query(panorama_directions(ROWS))[1]
    sheet = Image.new("RGB", (6 * ROWS, len(views) * (ROWS + TITLE)), "white")
    pen = ImageDraw.Draw(sheet)
    for row, (view, b, a) in enumerate(zip(views, true, ours, strict=True)):
        knee, white = float(np.median(luminance(b))), float(luminance(b).max())
        drawn = (
            (f"view {view}, true", tone(b, knee, white)),
            (f"ours; white is {white:.3g}", tone(a, knee, white)),
            (f"ours / true, full colour at {STOPS:g} stops", stops(a, b, knee)),
        )
        for column, (title, colours) in enumerate(drawn):
            at = column * 2 * ROWS, row * (ROWS + TITLE)
            pen.text((at[0] + 4, at[1] + 2), title, fill="black")
            sheet.paste(Image.fromarray(to_8_bit(colours[cell])), (at[0], at[1] + TITLE))
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path)


def tone(radiance: Float[np.ndarray, "d 3"], knee: float, white: float) -> Float[np.ndarray, "d 3"]:
    """Colours whose level is the logarithm of luminance: 0 for black, 1 for `white`, linear below `knee`."""
    level = luminance(radiance)
    shown = np.log1p(level / knee) / np.log1p(white / knee)
    return np.clip(radiance / np.maximum(level, 1e-12)[:, None], 0, 2) * shown[:, None]


def stops(
    ours: Float[np.ndarray, "d 3"], true: Float[np.ndarray, "d 3"], knee: float
) -> Float[np.ndarray, "d 3"]:
    """White where both agree, red where ours is brighter, blue where darker; a tenth of `knee` stills the dark."""
    floor = 0.1 * knee
    ratio = np.clip(np.log2((luminance(ours) + floor) / (luminance(true) + floor)) / STOPS, -1, 1)
    up, down = np.maximum(ratio, 0), np.maximum(-ratio, 0)
    return np.stack([1 - down, 1 - up - down, 1 - up], 1)
