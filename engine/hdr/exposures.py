"""The exposures of one bracket: how they relate, how noisy they are, and their merge site by site.

Source: Hanji, Zhong, Mantiuk, "Noise-Aware Merging of High Dynamic Range Image Stacks without Camera
Calibration" (2020): for Poisson noise the ratio of sums is the maximum-likelihood ratio; EMVA 1288 for the
photon transfer line, variance = gain * mean + read**2. The merged estimate is the sum of electrons over the
sum of exposure where shot noise rules; read noise turns that into inverse-variance weights. Counts have
black subtracted.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64

from engine.hdr.demosaic import sites
from engine.io.raw import Mosaic

SAMPLED_SITES = (
    200_000  # of each photograph, enough for the noise of a sensor and for how two exposures relate
)
MIN_SITES = 500  # a ratio from fewer sites says less than EXIF does
TINY = np.float32(1e-30)  # keeps what no exposure shows from dividing by zero
ROUNDING = 1 / 12  # variance that rounding to whole counts alone leaves


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """One exposure of a bracket, black subtracted."""

    counts: Float32[np.ndarray, "h w"]
    unsaturated: Bool[np.ndarray, "h w"]
    full: float  # counts from black to white


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Variance of a count x: gain * x + read**2."""

    gain: float  # counts per electron
    read: float  # counts


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """One view's mosaic: counts per unit of exposure."""

    light: Float32[np.ndarray, "h w"]
    time: Float32[
        np.ndarray, "h w"
    ]  # exposure that counted; 0: saturated in all, `light` is then a lower bound
    floor: float  # error of `light` where nothing is saturated and there is no light
    shortest: float  # exposure

    @property
    def clipped(self) -> Bool[np.ndarray, "h w"]:
        return self.time == 0

    def gathered(self) -> float:
        """Exposure that counted, median over the sites that are not clipped."""
        usable = self.time[self.time > 0]
        return float(np.median(usable)) if usable.size else self.shortest


def white_share(mosaic: Mosaic) -> float:
    """Share of the stated white level at which the sensor really saturates, told by the pile of sites there.

    Some cameras saturate below the level their files state. 1 when nothing piles up lower.
    """
    top = int(mosaic.counts.max())
    piled = int((mosaic.counts >= top - 1).sum())
    share = (top - 1 - mosaic.black[1]) / (mosaic.white[1] - mosaic.black[1])
    # Below half of the range the top of a dim picture is no saturation, whatever piles up there.
    return share if 0.5 < share < 1 and piled > max(50, 2e-4 * mosaic.counts.size) else 1.0


def exposure(mosaic: Mosaic, saturation: float) -> Exposure:
    """Counts without black; saturated above the share `saturation` of black to white."""
    shape = mosaic.counts.shape
    black, white = (np.array(level, np.float32)[mosaic.pattern] for level in (mosaic.black, mosaic.white))
    counts = mosaic.counts - sites(black, shape)
    full = float(np.float32(mosaic.white[1]) - np.float32(mosaic.black[1]))
    return Exposure(counts, counts < sites(saturation * (white - black), shape), full)


def sampled(mosaic: Mosaic) -> Mosaic:
    """About `SAMPLED_SITES` of its sites in whole Bayer cells, evenly spread."""
    h, w = mosaic.counts.shape
    step = int(math.sqrt(h * w / SAMPLED_SITES))
    if step <= 1:
        return mosaic
    cells = mosaic.counts[: h // 2 * 2, : w // 2 * 2].reshape(h // 2, 2, w // 2, 2)[::step, :, ::step]
    return replace(mosaic, counts=cells.reshape(2 * cells.shape[0], -1))


def times(stated: Float64[np.ndarray, " k"], steps: Float64[np.ndarray, " k-1"]) -> Float64[np.ndarray, " k"]:
    """Exposures that keep the fitted `steps` (ratios) exactly and agree with most of the `stated` ones."""
    log_times = np.concatenate([[0.0], np.cumsum(np.log(steps))])
    return np.exp(log_times + np.median(np.log(stated) - log_times))


def merge(exposures: Sequence[Exposure], times: Float64[np.ndarray, " k"], noise: SensorNoise) -> Merged:
    """The best estimate of light at every site from its unsaturated exposures; `times` ascend."""
    known = list(zip(exposures, times.astype(np.float32), strict=True))
    zero = np.zeros_like(exposures[0].counts)
    gathered = sum((one.unsaturated * time for one, time in known), zero)
    counted = sum((one.unsaturated * one.counts for one, _ in known), zero)
    first = np.maximum(counted / np.maximum(gathered, TINY), 0)
    total, light = zero.copy(), zero.copy()
    for one, time in known:
        # Variance of counts / time is (gain * light * time + read**2) / time**2; no count is surer than its rounding.
        variance = np.float32(noise.gain) * time * first + np.float32(noise.read**2)
        weight = one.unsaturated * (np.square(time) / np.maximum(variance, np.float32(ROUNDING)))
        total += weight
        light += weight * one.counts / time
    light /= np.maximum(total, TINY)
    shortest, time = known[0]
    np.copyto(light, shortest.counts / time, where=gathered == 0)
    return Merged(light, gathered, noise.read / float(np.sqrt(np.square(times).sum())), float(times[0]))


def ratio(short: Exposure, long: Exposure) -> float:
    """How many times more light `long` gathered; NaN where too few sites are well exposed in both.

    Sites are chosen by the long exposure alone: choosing by the noisy short one would bias the ratio.
    Whatever moved or flickered between the two is an outlier and is dropped.
    """
    for low, high in ((0.2, 0.9), (0.05, 0.97)):
        good = long.unsaturated & short.unsaturated
        good &= (long.counts > low * long.full) & (long.counts < high * long.full)
        if good.sum() >= MIN_SITES:
            break
    else:
        return float("nan")
    a, b = short.counts[good].astype(np.float64), long.counts[good].astype(np.float64)
    keep = np.ones(len(a), bool)
    fitted = np.median(b) / max(np.median(a), 1e-9)
    for _ in range(4):
        # Dividing by the root of the signal gives shot noise one size over all levels.
        misfit = (fitted * a - b) / np.sqrt(b)
        off = np.abs(misfit - np.median(misfit))
        keep = off <= 4 * max(1.4826 * float(np.median(off)), 1e-12)
        if not a[keep].sum() > 0:
            return float("nan")
        fitted = b[keep].sum() / a[keep].sum()
    return float(fitted)


def sensor_noise(pairs: Sequence[tuple[Exposure, Exposure, float]]) -> SensorNoise | None:
    """The photon transfer line through pairs (short, long, ratio) of exposures; None if they do not tell.

    The long exposure, scaled, predicts the short one; what is left is the noise of both.
    """
    levels, variances, counts, shares = [], [], [], []
    for short, long, times_more in pairs:
        if not times_more > 1.5:
            continue
        good = long.unsaturated & short.unsaturated
        expected = long.counts[good] / times_more
        residual = short.counts[good] - expected
        edges = np.quantile(expected, np.linspace(0, 1, 25)) if len(expected) else []
        place = np.searchsorted(edges, expected)
        for step in range(1, len(edges)):
            inside = residual[place == step]
            if len(inside) < 200:
                continue
            middle = np.median(inside)
            levels.append(float(expected[place == step].mean()))
            variances.append(float(1.4826 * np.median(np.abs(inside - middle))) ** 2)
            counts.append(len(inside))
            shares.append(1 / times_more)
    if len(levels) < 8:
        return None
    level, variance, share = np.array(levels), np.array(variances), np.array(shares)
    # Var(short - long / times) = gain * level * (1 + 1 / times) + read**2 * (1 + 1 / times**2)
    design = np.stack([np.maximum(level, 0) * (1 + share), 1 + share**2], axis=1)
    weight = np.sqrt(np.array(counts)) / np.maximum(variance, np.median(variance) * 1e-2)
    for _ in range(10):
        answer = np.linalg.lstsq(design * weight[:, None], variance * weight, rcond=None)[0]
        fitted = np.maximum(design @ answer, 1e-6 * variance.max())
        # Edges that moved by a fraction of a pixel only add variance: weigh them down.
        excess = np.abs(variance / fitted - 1)
        weight = np.sqrt(np.array(counts)) / fitted / np.sqrt(1 + np.square(excess / 0.1))
    gain, read_squared = float(answer[0]), float(answer[1])
    if not gain > 0:
        return None
    return SensorNoise(gain, float(np.sqrt(max(read_squared, ROUNDING))))


def learn(
    brackets: Sequence[Sequence[Mosaic]], stated: Float64[np.ndarray, "v k"], saturation: float
) -> tuple[SensorNoise | None, Float64[np.ndarray, " k-1"]]:
    """The sensor's noise (None if single exposures hide it) and the usual exposure steps, from a few views.

    Each view lists its photographs and its `stated` exposures in ascending order.
    """
    pairs: list[tuple[Exposure, Exposure, float]] = []
    steps = stated[:, 1:] / stated[:, :-1]
    off = np.full(steps.shape, np.nan, dtype=np.float64)
    for n, bracket in enumerate(brackets):
        stack = [exposure(mosaic, saturation) for mosaic in bracket]
        for i, (short, long) in enumerate(itertools.pairwise(stack)):
            fitted = ratio(short, long)
            if not math.isnan(fitted):
                off[n, i] = fitted / steps[n, i]
                pairs.append((short, long, fitted))
    told = np.flatnonzero(np.any(~np.isnan(off), axis=0))
    correction = np.ones(steps.shape[1])
    correction[told] = np.nanmedian(off[:, told], axis=0)
    return sensor_noise(pairs), np.median(steps, axis=0) * correction
