"""From values to colours: radiance as the eye would have it, and the surface's maps with their legends.

Colours are sRGB, 0 to 255.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from app.inspect.falsecolour import table
from app.viewer.protocol import Legend
from engine.color import luminance
from engine.io.png import srgb, to_8_bit
from engine.types import Surface

CLAY = (196, 192, 186)
"""What a shaded surface is made of."""


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A surface's colours, pixel by pixel, and whether they are to be shaded."""

    colours: UInt8[np.ndarray, "h w 3"]
    lit: bool = False
    legend: Legend | None = None


def bright(radiance: Float[np.ndarray, "*n 3"], white: float) -> Float[np.ndarray, "*n"]:
    """0 (dark) to 1 (blinding); one half at luminance `white`."""
    level = np.maximum(luminance(radiance), 0) / white
    return level / (1 + level)


def toned(radiance: Float[np.ndarray, "*n 3"], white: float) -> UInt8[np.ndarray, "*n 3"]:
    """Compressed by luminance, so that a red lamp stays red; what blinds pales."""
    level = np.maximum(luminance(radiance), 0)
    share = bright(radiance, white)
    colour = np.maximum(radiance, 0) / np.maximum(level, 1e-12)[..., None]
    pale = (share**4)[..., None]
    return to_8_bit(srgb(np.clip(share[..., None] * (colour * (1 - pale) + pale), 0, 1)))


def layers(surface: Surface) -> dict[str, Layer]:
    """Every way to look at a surface."""
    mask = surface.mask
    errors = np.degrees(surface.stderr_normal)
    top = _round_up(float(np.percentile(errors[mask], 98))) if mask.any() else 1.0
    plain = np.empty((*mask.shape, 3), np.uint8)
    plain[:] = CLAY
    return {
        "shaded": Layer(plain, lit=True),
        "albedo": Layer(to_8_bit(srgb(np.asarray(surface.albedo)))),
        "normals": Layer(to_8_bit(surface.normal * [1, -1, -1] * 0.5 + 0.5)),
        "roughness": _measured(np.asarray(surface.roughness), Legend("viridis", 0.0, 1.0)),
        "confidence": _measured(errors, Legend("magma", 0.0, top, "°")),
    }


def painted(radiance: Float[np.ndarray, "h w 3"]) -> Layer:
    """A layer of colours from elsewhere; linear, 1 is white."""
    return Layer(to_8_bit(srgb(np.clip(radiance, 0, 1))))


def _measured(values: Float[np.ndarray, "h w"], legend: Legend) -> Layer:
    share = np.clip((values - legend.low) / (legend.high - legend.low), 0, 1)
    return Layer(table(legend.colours)[np.rint(share * 255).astype(np.uint8)], legend=legend)


def _round_up(value: float) -> float:
    """To 1, 2 or 5 times a power of ten."""
    if not np.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9)))
