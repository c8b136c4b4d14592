"""Two runs held against one another, pixel by pixel: signed maps of the difference, and its numbers.

The second less the first, where both hold a pixel. Depth is compared after the first run's median was given the
second's by one factor, since its scale is often free; the factor is told. A difference is "expected" where it lies
within the 95 % band of both runs' standard errors together (`engine.results.metrics`): runs of the same photographs share their noise, so that more
than 95 % should lie there.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from app.inspect.falsecolour import Scale
from app.inspect.maps import LAYERS, Maps
from app.words import QT_TRANSLATE_NOOP
from engine.errors import SessionError
from engine.geometry import angle_between
from engine.results.metrics import BAND, NORMAL_BAND

TOP_PERCENTILE = 98.0
DEGREES = LAYERS["stderr_normal"].unit


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """One quantity's difference."""

    key: str
    title: str
    values: Float[np.ndarray, "h w"]  # in `unit`; NaN where not both runs have it
    unit: str
    signed: bool  # False: an angle between directions
    expected: float  # share of the pixels within the standard errors; NaN where there are none

    @property
    def known(self) -> Float[np.ndarray, " p"]:
        return self.values[np.isfinite(self.values)]

    def scale(self) -> Scale:
        """From zero, or symmetrical around it, to nearly the largest size."""
        known = np.abs(self.known)
        top = float(np.percentile(known, TOP_PERCENTILE)) if known.size else 1.0
        top = top or 1e-6
        return Scale(-top, top, self.unit, "signed") if self.signed else Scale(0.0, top, self.unit, "magma")

    def summary(self) -> "Summary":
        """Its numbers."""
        known = self.known
        if not known.size:
            return Summary(self.key, self.title, self.unit, *([math.nan] * 5))
        size = np.abs(known)
        bias = float(known.mean()) if self.signed else math.nan
        return Summary(
            self.key, self.title, self.unit, float(np.median(size)), float(size.mean()),
            float(np.percentile(size, 95)), bias, self.expected,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Summary:
    """Numbers of a difference; of its size, `bias` excepted, which keeps the sign."""

    key: str
    title: str
    unit: str
    median: float
    mean: float
    most: float  # 95 % lie below
    bias: float  # mean with sign; NaN for angles
    expected: float  # share within the standard errors


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All quantities of two runs."""

    differences: tuple[Difference, ...]
    both: int  # pixels that both hold
    either: int
    depth_factor: float  # what the first's depth was multiplied by; NaN where one has none

    def of(self, key: str) -> Difference:
        return next(difference for difference in self.differences if difference.key == key)

    @property
    def iou(self) -> float:
        return self.both / max(self.either, 1)


def compare(a: Maps, b: Maps) -> Comparison:
    """b less a.

    Raises:
        SessionError: their photographs differ in size, or no pixel is in both.
    """
    first, second = a.surface, b.surface
    if first.mask.shape != second.mask.shape:
        sizes = " and ".join(f"{mask.shape[1]} x {mask.shape[0]}" for mask in (first.mask, second.mask))
        raise SessionError(
            f"the two are {sizes} pixels; only maps of one size can be compared pixel by pixel"
        )
    both = first.mask & second.mask
    if not both.any():
        raise SessionError("no pixel belongs to the object in both; these are different objects or places")

    angle = np.degrees(angle_between(first.normal[both], second.normal[both]))
    normal_error = np.degrees(np.hypot(first.stderr_normal, second.stderr_normal)[both])
    albedo = second.albedo[both].mean(-1) - first.albedo[both].mean(-1)
    albedo_error = np.hypot(first.stderr_albedo, second.stderr_albedo)[both]
    rough = second.roughness[both] - first.roughness[both]
    rough_error = np.hypot(first.stderr_roughness, second.stderr_roughness)[both]
    depth, factor = _depth(first.depth[both], second.depth[both])
    misfit = 100 * (second.residual[both] - first.residual[both])
    sure = np.degrees(second.stderr_normal[both] - first.stderr_normal[both])

    def made(key, title, values, unit, signed=True, error=None, band=BAND):
        within = math.nan if error is None else float((np.abs(values) <= band * error).mean())
        return Difference(key, title, _image(both, values), unit, signed, within)

    return Comparison(
        (
            made(
                "normal",
                QT_TRANSLATE_NOOP("maps", "Normal: angle between"),
                angle,
                DEGREES,
                False,
                normal_error,
                NORMAL_BAND,
            ),
            made(
                "albedo",
                LAYERS["albedo"].title,
                albedo,
                QT_TRANSLATE_NOOP("maps", "mean of R G B"),
                True,
                albedo_error,
            ),
            made(
                "roughness",
                LAYERS["roughness"].title,
                rough,
                QT_TRANSLATE_NOOP("maps", "0 to 1"),
                True,
                rough_error,
            ),
            made(
                "depth",
                LAYERS["depth"].title,
                depth,
                QT_TRANSLATE_NOOP("maps", "% of the depth, after one factor"),
            ),
            made("residual", LAYERS["residual"].title, misfit, LAYERS["residual"].unit),
            made("stderr_normal", LAYERS["stderr_normal"].title, sure, DEGREES),
        ),
        int(both.sum()),
        int((first.mask | second.mask).sum()),
        factor,
    )


def _depth(a: Float[np.ndarray, " p"], b: Float[np.ndarray, " p"]) -> tuple[Float[np.ndarray, " p"], float]:
    """Percent by which b is deeper than a times one factor, and the factor."""
    known = (a > 0) & (b > 0)
    if not known.any():
        return np.full(len(a), np.nan), math.nan
    a, b = a.astype(np.float64), b.astype(np.float64)
    factor = float(np.median(b[known] / a[known]))
    percent = np.full(len(a), np.nan)
    percent[known] = 100 * (b[known] / (factor * a[known]) - 1)
    return percent, factor


def _image(mask: Bool[np.ndarray, "h w"], values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "h w"]:
    full = np.full(mask.shape, np.nan, np.float32)
    full[mask] = values
    return full
