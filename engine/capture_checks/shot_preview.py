"""A shot at a glance: its bracket read once, merged and made small, so that every check can look at it.

Sensors up to 800 sites wide are developed in full (`engine/hdr/develop.py`). On larger ones each 2 x 2 Bayer cell
becomes one pixel, its two green sites the sharp picture, and cells are averaged until that picture is at most
1200 pixels wide. Light is in shares of a full green site per unit of exposure (s * ISO / 100 / f^2); x right,
y down as the sensor lies.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64

from engine.hdr import exposures, linear_input
from engine.hdr.develop import averaged, camera_white, develop, toe
from engine.hdr.exposures import Exposure, Merged, SensorNoise
from engine.hdr.merge import ASSUMED_FULL_ELECTRONS, ASSUMED_READ_COUNTS, HALF_MAX
from engine.io.raw import Facts, Mosaic, read_mosaic

WHOLE_EDGE_PX = 800  # sensors this wide are developed in full
FINE_EDGE_PX = 1200  # long edge of the sharp picture
SMALL_EDGE_PX = 320  # of the coloured one
SATURATION = 0.98  # of black to white, as in the merge
RATIO_SITES = 50_000  # that tell how two exposures relate
DARK_SIGMAS = 2.0  # noise floors of the longest exposure
# Light is counted in steps of a sixth of a stop, from 2^-40 to 2^20 full sites per unit of exposure.
LEVELS_PER_EV, LOWEST_EV, HIGHEST_EV = 6, -40, 20


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the session's first shots told of the sensor."""

    white_share: float  # of the stated white level, where it really saturates
    noise: SensorNoise  # counts


@dataclass(frozen=True, slots=True, eq=False)
class ShotPreview:
    """One shot, small."""

    name: str
    width: int  # sites of the sensor
    height: int
    facts: tuple[Facts, ...]  # shortest exposure first
    exposures: tuple[float, ...]  # stated, ascending
    pitch: float  # sites per pixel of `fine`
    fine: Float32[np.ndarray, "H W"]  # green light
    fine_clipped: Bool[np.ndarray, "H W"]
    noise: tuple[float, float]  # (shot, floor): a pixel x of `fine` has the variance shot * x + floor**2
    small: Float32[
        np.ndarray, "h w 3"
    ]  # light in the camera's colours, white balanced; negative only by noise
    clipped: Float32[
        np.ndarray, "h w"
    ]  # of `small`: share of the sites below that no exposure shows unsaturated
    dark: Bool[np.ndarray, "h w"]  # of `small`: below noise in the longest exposure
    full_counts: float  # of a green site, from black to white
    share_clipped: float  # of all sites: saturated in the shortest exposure
    share_dark: float  # of all pixels of `small`
    histogram: Float64[np.ndarray, " b"]  # share of the pixels of `fine` at each level of light


def learn(mosaics: Sequence[Mosaic]) -> Sensor:
    """White level and noise from one bracket, shortest exposure first; typical values where it does not tell."""
    share = exposures.white_share(mosaics[-1])
    thin = [exposures.exposure(exposures.sampled(mosaic), SATURATION * share) for mosaic in mosaics]
    pairs = [(a, b, exposures.ratio(a, b)) for a, b in itertools.pairwise(thin)]
    noise = exposures.sensor_noise([pair for pair in pairs if pair[2] > 0])
    return Sensor(share, noise or SensorNoise(thin[0].full / ASSUMED_FULL_ELECTRONS, ASSUMED_READ_COUNTS))


def read(files: Sequence[Path]) -> list[Mosaic]:
    """The exposures of a bracket, shortest first.

    Raises:
        RawError: a file cannot be read or is no Bayer mosaic.
    """
    return sorted((read_mosaic(path) for path in files), key=lambda mosaic: mosaic.facts.exposure())


def glance_linear(name: str, radiance: Float32[np.ndarray, "h w 3"]) -> ShotPreview:
    """The same of a linear image, which is one exposure of light as it is: full is what its format can hold."""
    height, width = radiance.shape[:2]
    lost = np.any(radiance >= HALF_MAX, axis=-1)
    by, small_by = (max(1, round(max(height, width) / edge)) for edge in (FINE_EDGE_PX, SMALL_EDGE_PX))
    fine, small = averaged(radiance, by), averaged(radiance, small_by)
    light = np.maximum(fine[..., 1], 0)
    return ShotPreview(
        name, width, height, (), (1.0,), float(by), light, averaged(lost.astype(np.float32), by) > 0,
        linear_input.noise(fine[None]), small, averaged(lost.astype(np.float32), small_by), small[..., 1] <= 0,
        1.0, float(lost.mean()), float((radiance[..., 1] <= 0).mean()), _histogram(light),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Merge:
    """One view in counts per unit of exposure, before it is scaled."""

    fine: Float32[np.ndarray, "H W"]
    fine_clipped: Bool[np.ndarray, "H W"]
    small: Float32[np.ndarray, "h w 3"]
    clipped: Float32[np.ndarray, "h w"]
    share_clipped: float
    full: float
    shot: float  # variance of `fine` is shot * x + floor**2
    floor: float


def preview(name: str, mosaics: Sequence[Mosaic], sensor: Sensor) -> ShotPreview:
    """Merge a bracket (shortest exposure first) and make it small."""
    facts = tuple(mosaic.facts for mosaic in mosaics)
    height, width = mosaics[0].counts.shape
    stated = np.array([fact.exposure() for fact in facts])
    if max(width, height) <= WHOLE_EDGE_PX:
        cells, merge = 0, _whole(mosaics, stated, sensor)
    else:
        cells = int(np.ceil(max(width, height) / 2 / FINE_EDGE_PX))
        merge = _in_blocks(mosaics, stated, sensor, cells)
    dark = merge.small[..., 1] < DARK_SIGMAS * sensor.noise.read / stated[-1]
    light = np.maximum(merge.fine, 0) / np.float32(merge.full)
    return ShotPreview(
        name, width, height, facts, tuple(stated.tolist()), float(max(1, 2 * cells)), light,
        merge.fine_clipped, (merge.shot / merge.full, merge.floor / merge.full),
        merge.small / np.float32(merge.full), merge.clipped, dark, merge.full, merge.share_clipped,
        float(dark.mean()), _histogram(light),
    )  # fmt: skip


def _whole(mosaics: Sequence[Mosaic], stated: Float64[np.ndarray, " k"], sensor: Sensor) -> _Merge:
    """Every site developed."""
    stack = [exposures.exposure(mosaic, SATURATION * sensor.white_share) for mosaic in mosaics]
    merged = _merged(stack, stated, sensor.noise)
    developed = develop(mosaics[0], merged, toe(mosaics[0], merged, sensor.noise))
    colours = developed @ _camera_from_rec709(mosaics[0]).T
    # The colours of a site lean on those around it.
    spoiled = cv2.dilate(merged.clipped.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    by = max(1, round(max(spoiled.shape) / SMALL_EDGE_PX))
    return _Merge(
        np.ascontiguousarray(colours[..., 1]), spoiled, averaged(colours, by),
        averaged(merged.clipped.astype(np.float32), by), float(merged.clipped.mean()), stack[0].full,
        sensor.noise.gain / merged.gathered(), merged.floor,
    )  # fmt: skip


def _in_blocks(
    mosaics: Sequence[Mosaic], stated: Float64[np.ndarray, " k"], sensor: Sensor, cells: int
) -> _Merge:
    """Blocks of `cells` x `cells` Bayer cells averaged."""
    planes = [_planes(mosaic, SATURATION * sensor.white_share, cells) for mosaic in mosaics]
    green = [_exposure(view[1], view[3]) for view in planes]
    merged = _merged(green, stated, sensor.noise)
    by = max(1, round(max(merged.light.shape) / SMALL_EDGE_PX))
    lost = np.stack([plane.saturated for plane in planes[0]]).mean(axis=0)
    sites = 2 * cells**2
    return _Merge(
        merged.light, merged.clipped, _coloured(planes, stated, sensor.noise, by, mosaics[0]),
        averaged(lost, by), float(lost.mean()), green[0].full,
        sensor.noise.gain / merged.gathered() / sites, merged.floor / np.sqrt(sites),
    )  # fmt: skip


def _merged(stack: Sequence[Exposure], stated: np.ndarray, noise: SensorNoise) -> Merged:
    """Shutters are engraved in rounded numbers: the pixels say how exposures relate, where they can."""
    thin = [_thinned(one) for one in stack]
    steps = np.array([exposures.ratio(a, b) for a, b in itertools.pairwise(thin)]).reshape(-1)
    steps = np.where(np.isnan(steps), stated[1:] / stated[:-1], steps)
    return exposures.merge(stack, exposures.times(stated, steps), noise)


def _thinned(exposure: Exposure) -> Exposure:
    """About `RATIO_SITES` of its sites, evenly spread; an odd step meets all colours."""
    pick = slice(None, None, exposure.counts.size // RATIO_SITES | 1)
    return Exposure(
        exposure.counts.reshape(1, -1)[:, pick], exposure.unsaturated.reshape(1, -1)[:, pick], exposure.full
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    """One channel of one exposure, averaged over blocks of its sites."""

    counts: Float32[np.ndarray, "h w"]  # black subtracted
    saturated: Float32[np.ndarray, "h w"]  # share of the block's sites
    full: float


def _planes(mosaic: Mosaic, saturation: float, cells: int) -> list[_Plane]:
    """The four channels (red, green, blue, second green), averaged over blocks of `cells` Bayer cells."""
    planes: list[_Plane] = []
    places = [(y, x) for y in (0, 1) for x in (0, 1)]
    greens = [place for place in places if mosaic.pattern[place] in (1, 3)]
    red, blue = (next(place for place in places if mosaic.pattern[place] == channel) for channel in (0, 2))
    h, w = (edge // 2 for edge in mosaic.counts.shape)
    for y, x in (red, greens[0], blue, greens[1]):
        channel = int(mosaic.pattern[y, x])
        black, white = mosaic.black[channel], mosaic.white[channel]
        counts = np.ascontiguousarray(mosaic.counts[y::2, x::2][:h, :w])
        saturated = averaged((counts >= black + saturation * (white - black)).astype(np.float32), cells)
        mean = averaged(counts.astype(np.float32), cells) - np.float32(black)
        planes.append(_Plane(mean, saturated, float(white - black)))
    return planes


def _exposure(a: _Plane, b: _Plane, by: int = 1) -> Exposure:
    """Two channels as one, averaged further by `by`; a block with one saturated site is saturated."""
    saturated = averaged(a.saturated + b.saturated, by) > 0
    return Exposure(averaged((a.counts + b.counts) / 2, by), ~saturated, (a.full + b.full) / 2)


def _coloured(
    planes: Sequence[Sequence[_Plane]], stated: np.ndarray, noise: SensorNoise, by: int, mosaic: Mosaic
) -> Float32[np.ndarray, "h w 3"]:
    """Balanced camera colours from the planes of all exposures, averaged down by `by`."""
    white = camera_white(mosaic)
    channels = []
    for one, two in ((0, 0), (1, 3), (2, 2)):
        merged = _merged([_exposure(view[one], view[two], by) for view in planes], stated, noise)
        channels.append(merged.light / np.float32(white[min(one, 2)]))
    return np.stack(channels, axis=-1)


def _camera_from_rec709(mosaic: Mosaic) -> Float32[np.ndarray, "3 3"]:
    """Undo the colour matrix but not the balance: a camera's own colours are never negative."""
    back = np.linalg.inv(mosaic.rec709_from_camera) / camera_white(mosaic)[:, None]
    return back.astype(np.float32)


def log_light(glance: ShotPreview) -> Float32[np.ndarray, "H W"]:
    """Logarithm of `fine`, level where noise would rule."""
    shot, floor = glance.noise
    light = np.maximum(glance.fine, 0)
    offset = max(10 * floor, 100 * shot, 1e-3 * float(np.median(light)), 1e-30)
    return np.log(light + np.float32(offset))


def _histogram(light: Float32[np.ndarray, "H W"]) -> Float64[np.ndarray, " b"]:
    """Shares of the pixels at each level; the lowest level takes all that is darker."""
    ev = np.log2(np.maximum(light, 2.0**LOWEST_EV))
    bins = (HIGHEST_EV - LOWEST_EV) * LEVELS_PER_EV
    counts, _ = np.histogram(ev, bins=bins, range=(LOWEST_EV, HIGHEST_EV))
    return counts / light.size
