"""The illustrations of the report: arrays to pictures that live inside the page, with their scales.

Maps are cropped to the object and transparent outside it, so that they sit on a light or a dark page.
Radiance is shown with one exposure for all pictures that are compared.
"""

import base64
import io

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib import colormaps
from PIL import Image

from engine.color import luminance
from engine.io.png import srgb, to_8_bit
from engine.types import Panorama

HATCH_PX = 8
OUTSIDE = 128  # grey


def crop(mask: Bool[np.ndarray, "h w"], margin: float = 0.06) -> tuple[slice, slice]:
    """Rows and columns around the object, with a margin as a share of its size."""
    rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
    if len(rows) == 0:
        return slice(None), slice(None)
    pad = int(np.ceil(margin * max(np.ptp(rows), np.ptp(columns), 1)))
    return (
        slice(max(rows[0] - pad, 0), rows[-1] + pad + 1),
        slice(max(columns[0] - pad, 0), columns[-1] + pad + 1),
    )


def white(radiance: Float[np.ndarray, "*batch 3"]) -> float:
    """The radiance to show as white: the 99th percentile of the brightest channel."""
    return float(np.percentile(radiance.max(-1), 99)) or 1.0


def photograph(radiance: Float[np.ndarray, "h w 3"], white_at: float) -> str:
    """A picture as the eye would have it; brighter than white stays white."""
    return _jpeg(to_8_bit(srgb(radiance / white_at)))


def albedo(values: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> str:
    return _cut_out(to_8_bit(srgb(values)), mask)


def render(radiance: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], white_at: float) -> str:
    return _cut_out(to_8_bit(srgb(radiance / white_at)), mask)


def normals(values: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> str:
    """Red right, green up, blue towards the viewer."""
    return _cut_out(to_8_bit(values * [1, -1, -1] * 0.5 + 0.5), mask)


def scalar(
    values: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], low: float, high: float, colours: str
) -> str:
    """A map of numbers between `low` and `high`; those beyond take the end's colour."""
    share = np.clip((values - low) / max(high - low, 1e-30), 0, 1)
    return _cut_out(_coloured(share, colours), mask)


def bar(colours: str) -> str:
    """The colour map from its low to its high end, one pixel high."""
    return _png(_coloured(np.linspace(0, 1, 256)[None], colours))


def panorama(light: Panorama) -> str:
    """The light on a logarithmic scale (a lamp and a wall both show), hatched where it is a guess."""
    level = luminance(light.radiance)
    middle = float(np.median(level[level > 0])) if (level > 0).any() else 1.0
    # Radiance at the median becomes mid grey; a hundred times brighter is nearly white.
    shown = level / (level + 2.5 * middle)
    colour = light.radiance / np.maximum(level, 1e-12)[..., None]
    image = np.clip(shown[..., None] * (colour + 3 * shown[..., None]) / (1 + 3 * shown[..., None]), 0, 1)
    image = np.repeat(np.repeat(srgb(image), 2, 0), 2, 1) if light.radiance.shape[1] < 768 else srgb(image)
    scale = image.shape[0] // light.radiance.shape[0]
    guessed = np.repeat(np.repeat(light.seen < 0.5, scale, 0), scale, 1)
    row, column = np.indices(guessed.shape)
    stripe = guessed & ((row + column) % HATCH_PX < 2)
    image = np.where(guessed[..., None], image * 0.7, image)
    image = np.where(stripe[..., None], [0.95, 0.35, 0.2], image)
    return _jpeg(to_8_bit(image))


def seen_share(light: Panorama) -> float:
    """The share of the sphere (by solid angle) that photographs show."""
    height = light.seen.shape[0]
    weight = np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None] * np.ones_like(light.seen)
    return float((weight * light.seen).sum() / weight.sum())


def _coloured(share: np.ndarray, colours: str) -> UInt8[np.ndarray, "h w 3"]:
    return to_8_bit(colormaps[colours](share)[..., :3])


def _cut_out(image: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> str:
    # Grey where nothing is: a viewer that knows no transparency must not see a colour that means something.
    shown = np.where(mask[..., None], image, OUTSIDE).astype(np.uint8)
    return _png(np.concatenate([shown, mask[..., None].astype(np.uint8) * 255], axis=-1))


def _png(image: UInt8[np.ndarray, "h w c"]) -> str:
    return _embedded(image, "PNG", optimize=True)


def _jpeg(image: UInt8[np.ndarray, "h w 3"]) -> str:
    return _embedded(image, "JPEG", quality=88)


def _embedded(image: np.ndarray, kind: str, **options: object) -> str:
    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(stream, kind, **options)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(stream.getvalue()).decode()}"
