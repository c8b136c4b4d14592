"""A camera's sensor: from linear Rec.709 radiance to the counts of a RAW file, noise and clipping included.

Source: EMVA 1288 (shot and read noise, linear response); ISO 12232 (saturation-based speed: a sensor at
ISO S is full at 78/S lux seconds); Lindbloom's Rec.709 primaries. Radiance is in units of 100 cd/m^2 for
a grey object; the image is upright, x right, y down, one mosaic site per radiance pixel, RGGB.
"""

import datetime
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, UInt16

from hardware.errors import StudioError
from hardware.virtual.dng import Photograph

XYZ_FROM_REC709 = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)  # D65 white

CD_PER_RADIANCE = 100.0
FULL_LUX_S_AT_ISO_1 = 78.0  # ISO 12232
LENS_TRANSMISSION = 0.65  # ISO 12232's q, with the pi/4 of the solid angle: H = q L t / f^2

STOPS = (-3.0, 0.0, 3.0)  # one bracket, relative to the metered exposure
METER_PERCENTILE = 97.0
METER_LEVEL = 0.5  # of a full pixel: where that percentile goes at 0 EV; -3 EV then holds 16 times as much
READOUT_S = 0.25  # between two exposures of a bracket


def _camera_from_xyz() -> Float[np.ndarray, "3 3"]:
    """A colour response typical of a full-frame CMOS camera under D65."""
    return np.array([[0.9539, -0.2795, -0.1224], [-0.4175, 1.1998, 0.2458], [-0.0465, 0.1755, 0.6048]])


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """What a full-frame camera at ISO 100 does to light; the defaults are that camera."""

    full_electrons: float = 50_000.0  # a pixel holding this many reads `white`
    read_electrons: float = 3.5  # standard deviation
    black: int = 512  # counts
    white: int = 16383  # counts, 14 bit
    iso: int = 100
    aperture: float = 8.0  # f-number
    vignetting: float = 0.0  # share of light lost in the corners, falling with the squared distance
    camera_from_xyz: Float[np.ndarray, "3 3"] = field(default_factory=_camera_from_xyz)

    def __post_init__(self) -> None:
        if not 0 <= self.vignetting < 1:
            raise StudioError(
                f"vignetting {self.vignetting}: it is the share of light lost in the corners; give 0 to below 1"
            )

    def camera_from_rec709(self) -> Float[np.ndarray, "3 3"]:
        """Camera RGB of linear Rec.709, scaled so that white has G = 1."""
        matrix = self.camera_from_xyz @ XYZ_FROM_REC709
        return matrix / matrix[1].sum()

    def neutral(self) -> tuple[float, float, float]:
        """Camera RGB of a D65 white sheet, G = 1: the white balance is fixed to daylight for the session."""
        r, g, b = self.camera_from_rec709().sum(axis=1)
        return float(r), float(g), float(b)

    def electrons_per_radiance_s(self) -> float:
        """Electrons in a green site per second and unit of white radiance."""
        full_lux_s = FULL_LUX_S_AT_ISO_1 / self.iso
        return self.full_electrons * LENS_TRANSMISSION * CD_PER_RADIANCE / self.aperture**2 / full_lux_s

    def counts_per_electron(self) -> float:
        return (self.white - self.black) / self.full_electrons


def expose(
    radiance: Float[np.ndarray, "h w 3"], shutter_s: float, sensor: Sensor, rng: np.random.Generator
) -> UInt16[np.ndarray, "h w"]:
    """The counts of one exposure; `rng` draws its shot and read noise.

    Raises:
        StudioError: radiance that is not finite or is negative.
    """
    bad = int((~np.isfinite(radiance) | (radiance < 0)).sum())
    if bad:
        raise StudioError(f"{bad} of {radiance.size} radiances are negative or not finite; render again")
    h, w, _ = radiance.shape
    electrons = _mosaic(radiance @ sensor.camera_from_rec709().T) * _falloff(h, w, sensor.vignetting)
    electrons *= shutter_s * sensor.electrons_per_radiance_s()
    # Far beyond full the count is `white` whatever the noise; the bound keeps Poisson's argument in range.
    collected = rng.poisson(np.clip(electrons, 0.0, 4 * sensor.full_electrons))
    collected = collected + sensor.read_electrons * rng.standard_normal((h, w))
    counts = np.rint(sensor.black + sensor.counts_per_electron() * collected)
    return np.clip(counts, 0, sensor.white).astype(np.uint16)


def meter(radiances: Float[np.ndarray, "n h w 3"], sensor: Sensor) -> float:
    """Shutter time (s) of 0 EV for a whole session: walls and object well exposed, lamps left to the bracket.

    Raises:
        StudioError: there is no light.
    """
    peak = (radiances @ sensor.camera_from_rec709().T).max(axis=-1)
    level = float(np.percentile(peak, METER_PERCENTILE))
    if not level > 0:
        raise StudioError("the room is black in nearly every pixel; add a lamp or move it into reach")
    return METER_LEVEL * sensor.full_electrons / (level * sensor.electrons_per_radiance_s())


def bracket(
    radiance: Float[np.ndarray, "h w 3"],
    shutter_s: float,
    sensor: Sensor,
    start: datetime.datetime,
    rng: np.random.Generator,
) -> tuple[Photograph, ...]:
    """Three photographs at -3, 0 and +3 EV around `shutter_s`, taken one after the other from `start` on."""
    photographs = []
    for stop in STOPS:
        exposure_s = shutter_s * 2.0**stop
        photographs.append(
            Photograph(
                expose(radiance, exposure_s, sensor, rng),
                sensor.black,
                sensor.white,
                sensor.camera_from_xyz,
                sensor.neutral(),
                exposure_s,
                sensor.iso,
                sensor.aperture,
                start,
            )
        )
        start = start + datetime.timedelta(seconds=exposure_s + READOUT_S)
    return tuple(photographs)


def _mosaic(camera_rgb: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Keep the one channel that each RGGB site sees."""
    sites = camera_rgb[..., 1].copy()
    sites[0::2, 0::2] = camera_rgb[0::2, 0::2, 0]
    sites[1::2, 1::2] = camera_rgb[1::2, 1::2, 2]
    return sites


def _falloff(h: int, w: int, vignetting: float) -> Float[np.ndarray, "h w"]:
    """Relative illumination, 1 in the centre and 1 - vignetting in the corners."""
    y = (np.arange(h)[:, None] + 0.5 - h / 2) / (h / 2)
    x = (np.arange(w)[None, :] + 0.5 - w / 2) / (w / 2)
    return 1.0 - vignetting * (x * x + y * y) / 2
