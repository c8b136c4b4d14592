"""One shot as a person wants to see it: developed as the screen shows it, what is clipped laid over it, a histogram.

One exposure of the bracket is shown, white where its sensor is full. Light is in full sites of that exposure;
of each pixel's channel the longest exposure that is not saturated tells it. x right, y down as the sensor lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

from engine.capture_checks.shot_preview import DARK_SIGMAS, SATURATION, Sensor, learn
from engine.hdr.demosaic import demosaic
from engine.hdr.develop import averaged, camera_white
from engine.io.png import srgb
from engine.io.raw import Mosaic

TOE = 0.01  # of full: where demosaicing takes differences instead of ratios
BINS, PER_EV, WHITE_BIN = 64, 4, 40  # 10 EV below white, 6 above
# Laid over what every exposure has saturated, and over what only the one shown has.
LOST_RGB, CLIPPED_RGB = (226, 48, 48), (240, 170, 40)


@dataclass(frozen=True, slots=True, eq=False)
class DisplayImage:
    """What the page shows of one shot; shares are of all its Bayer cells."""

    rgb: UInt8[np.ndarray, "h w 3"]  # sRGB
    overlay: UInt8[np.ndarray, "h w 4"]  # red, green, blue, opacity
    clipped: float  # in every exposure
    clipped_here: float  # in the one shown
    dark: float  # lost in noise in the longest exposure
    histogram: Int[np.ndarray, "3 b"]  # pixels at each step of log2 light; ends take what lies beyond
    shutter_s: float  # of the one shown


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """One exposure as red, green, blue of its Bayer cells, averaged over blocks of cells."""

    light: Float32[np.ndarray, "h w 3"]  # shares of full
    saturated: Bool[np.ndarray, "h w 3"]
    lost: Float32[np.ndarray, "h w"]  # share of its cells with a saturated site
    share_clipped: float  # of all sites, as `ShotPreview.share_clipped` counts


def picture(
    mosaics: Sequence[Mosaic], edge_px: int, exposure: int | None = None, sensor: Sensor | None = None
) -> DisplayImage:
    """A bracket of one shot, shortest exposure first; one photograph is a bracket too.

    Args:
        edge_px: its longest edge at most; sensors no larger are shown site by site.
        exposure: the one to show; None: the middle one.
        sensor: as `learn` tells it of these or other shots; None: of these.
    """
    sensor = sensor or learn(mosaics)
    shown = len(mosaics) // 2 if exposure is None else exposure
    middle = mosaics[shown]
    height, width = middle.counts.shape
    by = max(1, int(np.ceil(max(height, width) / 2 / edge_px)))
    cells = [_cells(mosaic, SATURATION * sensor.white_share, by) for mosaic in mosaics]
    if max(height, width) <= edge_px:
        balanced = demosaic(_balanced_sites(middle), middle.pattern, TOE)
    else:
        balanced = cells[shown].light / camera_white(middle).astype(np.float32)
    coded = np.rint(255 * srgb(_developed(balanced, middle, sensor.white_share))).astype(np.uint8)
    full = middle.white[1] - middle.black[1]
    dark = cells[-1].light[..., 1] * full < DARK_SIGMAS * sensor.noise.read
    return DisplayImage(
        coded, _overlay(cells[0].lost, cells[shown].lost, coded.shape[:2]), cells[0].share_clipped,
        cells[shown].share_clipped, float(dark.mean()), _histogram(mosaics, cells, shown),
        middle.facts.shutter_s,
    )  # fmt: skip


def _cells(mosaic: Mosaic, saturation: float, by: int) -> _Cells:
    height, width = (edge // 2 for edge in mosaic.counts.shape)
    light, saturated = {}, {}
    for y, x in ((0, 0), (0, 1), (1, 0), (1, 1)):
        channel = int(mosaic.pattern[y, x])
        full = mosaic.white[channel] - mosaic.black[channel]
        counts = mosaic.counts[y::2, x::2][:height, :width].astype(np.float32) - mosaic.black[channel]
        colour = 1 if channel == 3 else channel
        light.setdefault(colour, []).append(counts / np.float32(full))
        saturated.setdefault(colour, []).append(counts >= saturation * full)
    clipped = np.stack([np.any(saturated[colour], axis=0) for colour in range(3)], axis=-1)
    mean = np.stack([np.stack(light[colour]).mean(axis=0) for colour in range(3)], axis=-1)
    lost = averaged(np.asarray(clipped.any(axis=-1), np.float32), by)
    share = float(np.mean([plane.mean() for planes in saturated.values() for plane in planes]))
    return _Cells(averaged(mean, by), averaged(clipped.astype(np.float32), by) > 0, lost, share)


def _balanced_sites(mosaic: Mosaic) -> Float32[np.ndarray, "h w"]:
    """Shares of full of every site, in units in which a white sheet is the same in all channels."""
    height, width = mosaic.counts.shape
    channel = np.tile(mosaic.pattern, (height // 2 + 1, width // 2 + 1))[:height, :width]
    black, white = np.array(mosaic.black, np.float32), np.array(mosaic.white, np.float32)
    light = (mosaic.counts.astype(np.float32) - black[channel]) / (white - black)[channel]
    balance = camera_white(mosaic).astype(np.float32)
    return light / balance[np.where(channel == 3, 1, channel)]


def _developed(
    balanced: Float32[np.ndarray, "h w 3"], mosaic: Mosaic, white_share: float
) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709, 1 where the sensor is full; all channels end where the first of them does, so that lamps are white."""
    balance = camera_white(mosaic).astype(np.float32)
    ended = np.minimum(balanced * (balance.max() / np.float32(white_share)), np.float32(1))
    return ended @ (mosaic.rec709_from_camera * balance).astype(np.float32).T


def _overlay(
    lost: Float32[np.ndarray, "h w"], here: Float32[np.ndarray, "h w"], shape: tuple[int, int]
) -> UInt8[np.ndarray, "H W 4"]:
    opacity = np.maximum(here, lost)
    colour = np.where((lost > 0)[..., None], np.array(LOST_RGB, np.uint8), np.array(CLIPPED_RGB, np.uint8))
    overlay = np.dstack([colour, np.rint(255 * opacity).astype(np.uint8)])
    return np.asarray(cv2.resize(overlay, shape[::-1], interpolation=cv2.INTER_NEAREST))


def _histogram(mosaics: Sequence[Mosaic], cells: Sequence[_Cells], shown: int) -> Int[np.ndarray, "3 b"]:
    light = cells[0].light
    for mosaic, one in zip(mosaics, cells, strict=True):
        longer = mosaic.facts.exposure() / mosaics[shown].facts.exposure()
        light = np.where(one.saturated & (mosaic is not mosaics[0]), light, one.light / np.float32(longer))
    ev = np.log2(np.maximum(light, np.float32(1e-9)))
    place = np.clip(np.floor(ev * PER_EV).astype(int) + WHITE_BIN, 0, BINS - 1)
    return np.stack([np.bincount(place[..., colour].ravel(), minlength=BINS) for colour in range(3)])
