"""Stage *hdr*: each view's photographs become linear radiance, on one scale for the whole session.

Source: Hanji, Zhong, Mantiuk (2020), see `engine/hdr/exposures.py`. The merge works on the mosaic, before
demosaicing, so that no saturated site leaks into its neighbours. Radiance 1 is what fills a green site in the
session's middle exposure; linear Rec.709, daylight white; x right, y down as the sensor lies, whatever way up
the camera was held.
"""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from engine.color import luminance
from engine.errors import HdrError
from engine.hdr import exposures, linear_input
from engine.hdr.demosaic import REACH
from engine.hdr.develop import averaged, develop, toe, variance
from engine.hdr.exposures import Merged, SensorNoise
from engine.hdr.params import HdrParams
from engine.io.images import read_radiance
from engine.io.raw import Bracket, Facts, Mosaic, read_facts, read_mosaic
from engine.parallel import abreast
from engine.progress import Progress
from engine.sampling import evenly_spaced
from engine.types import Frames

HALF_MAX = 65504.0  # the largest half float: where an EXR writer itself clips
# Where no pair of exposures tells: 50 000 electrons fill a pixel of most large sensors at base ISO.
ASSUMED_FULL_ELECTRONS, ASSUMED_READ_COUNTS = 50_000.0, 2.0
TILE_EDGE = 384  # sites merged and developed at once by each thread: what the processor's cache holds
SITES_AT_ONCE = 600_000_000  # decoded, of all threads: counts of 1.2 GB


@dataclass(frozen=True, slots=True)
class Step:
    """Two neighbouring exposures of the bracket, as EXIF and as the pixels have it, in EV."""

    exif_ev: float
    fitted_ev: float  # median over the views
    spread_ev: float  # median absolute deviation over the views
    worst_ev: float  # the largest |fitted - EXIF| of any view
    worst_view: str


@dataclass(frozen=True, slots=True)
class HdrReport:
    """What the merge found out: plain numbers and names."""

    views: int
    exposures: int  # of each view
    steps: tuple[Step, ...]  # empty for single exposures
    suspect: tuple[str, ...]  # views whose pixels contradict EXIF; the pixels were believed
    unfitted: tuple[str, ...]  # views with a step that its own pixels could not tell
    gain_counts: float  # counts per electron, learnt from the pixels; 0 where they could not tell
    read_counts: float  # read noise, likewise
    white_share: float  # of the stated white level, where the sensor really saturates
    share_clipped: float  # of all pixels
    share_dark: float
    most_clipped: str  # view
    most_clipped_share: float
    scale: float  # radiance = (count - black) / (white - black) / (s * ISO / 100 / f^2) * scale
    reduced_by: int  # whole factor by which the photographs were averaged down


def _in_memory(shape: tuple[int, ...]) -> Float32[np.ndarray, "n h w 3"]:
    return np.empty(shape, np.float32)


def merge(
    shots: Sequence[Bracket],
    params: HdrParams,
    progress: Progress,
    left_out: Collection[str] = (),
    place: Callable[[tuple[int, ...]], Float32[np.ndarray, "n h w 3"]] = _in_memory,
) -> tuple[Frames, HdrReport]:
    """Radiance of every bracket, also of those `left_out`, by name, which alone may be unusable; `place` gives the array that it
    goes to, view by view.

    Raises:
        HdrError: an incomplete bracket, mixed cameras or sizes, or a view without usable pixels.
        RawError: a file cannot be read.
    """
    progress.step(0.0, "reading exposure data")
    paths, facts = _sorted_by_exposure(shots)
    _check_alike(shots, facts)
    stated = np.array([[fact.exposure() for fact in view] for view in facts])
    scale = float(np.median(stated[:, stated.shape[1] // 2]))
    width, height = facts[0][0].width, facts[0][0].height
    at_once = max(1, SITES_AT_ONCE // (stated.shape[1] * width * height))  # brackets

    chosen = evenly_spaced(len(shots), params.learning_views).tolist()
    decoded: dict[int, list[Mosaic]] = {}
    samples, shares = [], []
    for n, mosaics in zip(chosen, abreast(lambda n: _decoded(paths[n]), chosen, at_once), strict=True):
        progress.step(0.02 + 0.03 * len(shares) / len(chosen), "learning the sensor's noise")
        shares.append(exposures.white_share(mosaics[-1]))
        samples.append([exposures.sampled(mosaic) for mosaic in mosaics])
        if len(decoded) < at_once:
            decoded[n] = mosaics
    white_share = min(shares)
    saturation = params.saturation_share * white_share
    learnt, usual = exposures.learn(samples, stated[chosen], saturation)
    del samples

    reduce_by = max(1, math.ceil(max(width, height) / params.long_edge_px))
    shape = len(shots), height // reduce_by, width // reduce_by
    radiance, clipped = place((*shape, 3)), np.empty(shape, bool)
    fits = np.full((len(shots), stated.shape[1] - 1), np.nan)
    variances = np.empty((len(shots), 2))

    def merge_one(n: int) -> None:
        mosaics = decoded.pop(n, None) or _decoded(paths[n])
        sample = [exposures.exposure(exposures.sampled(mosaic), saturation) for mosaic in mosaics]
        fits[n] = [exposures.ratio(a, b) for a, b in itertools.pairwise(sample)]
        times = exposures.times(stated[n], np.where(np.isnan(fits[n]), usual, fits[n]))
        noise = learnt or SensorNoise(sample[0].full / ASSUMED_FULL_ELECTRONS, ASSUMED_READ_COUNTS)
        merged = exposures.merge(sample, times, noise)
        if shots[n].name not in left_out:
            _check_usable(shots[n].name, merged, params)
        to_radiance = scale / sample[0].full
        variances[n] = variance(mosaics[0], merged, noise) * [to_radiance, to_radiance**2]
        near_zero = toe(mosaics[0], merged, noise)
        for outer, inner, to in _tiles(height, width, reduce_by):
            tile = [replace(mosaic, counts=mosaic.counts[outer]) for mosaic in mosaics]
            merged = exposures.merge([exposures.exposure(one, saturation) for one in tile], times, noise)
            # Each colour of a pixel leans on the sites around it; a clipped one spoils all it was used for.
            spoiled = cv2.dilate(merged.clipped.astype(np.float32), np.ones((5, 5), np.uint8))[inner]
            developed = develop(tile[0], merged, near_zero)[inner]
            radiance[n][to] = averaged(developed, reduce_by) * np.float32(to_radiance)
            clipped[n][to] = averaged(spoiled, reduce_by) > 0

    for n, _ in enumerate(abreast(merge_one, range(len(shots)), at_once)):
        progress.step(0.05 + 0.95 * n / len(shots), f"merging {shots[n].name}")

    shot_noise, floor = np.median(variances, axis=0) / reduce_by**2
    dark = np.stack([luminance(view) < params.dark_sigmas * np.sqrt(floor) for view in radiance])
    frames = Frames(
        tuple(shot.name for shot in shots),
        radiance,
        clipped,
        dark,
        (float(shot_noise), float(np.sqrt(floor))),
    )
    off_ev = np.log2(fits * stated[:, :-1] / stated[:, 1:])
    too_far = np.any(np.abs(off_ev) > math.log2(1 + params.ratio_tolerance), axis=1)
    most = int(np.argmax(clipped.mean(axis=(1, 2))))
    return frames, HdrReport(
        views=len(shots),
        exposures=stated.shape[1],
        steps=_steps(stated, fits, off_ev, frames.names),
        suspect=_picked(frames.names, too_far),
        unfitted=_picked(frames.names, np.any(np.isnan(fits), axis=1)),
        gain_counts=learnt.gain if learnt else 0.0,
        read_counts=learnt.read if learnt else 0.0,
        white_share=white_share,
        scale=scale,
        reduced_by=reduce_by,
        share_clipped=float(clipped.mean()),
        share_dark=float(frames.dark.mean()),
        most_clipped=frames.names[most],
        most_clipped_share=float(clipped[most].mean()),
    )


def stack(
    names: Sequence[str], paths: Sequence[Path], params: HdrParams, progress: Progress
) -> tuple[Frames, HdrReport]:
    """Radiance from linear images, one per view, in the scale that they have.

    Such files do not say where a camera clipped: only values at the end of a half float count as clipped.

    Raises:
        HdrError: other sizes, NaN, Inf, negative values, or a black image; says how many and where.
        RawError: a file cannot be read.
    """
    views: list[Float32[np.ndarray, "h w 3"]] = []
    full_shape: tuple[int, ...] = ()
    for n, (name, path) in enumerate(zip(names, paths, strict=True)):
        progress.step(n / len(names), f"reading {name}")
        radiance = read_radiance(path)
        full_shape = full_shape or radiance.shape
        linear_input.check_values(path, radiance)
        if radiance.shape != full_shape:
            raise HdrError(
                f"{path}: is {radiance.shape[1]} x {radiance.shape[0]}, the first image is {full_shape[1]} x"
                f" {full_shape[0]}; import views of one camera and size only"
            )
        reduce_by = max(1, math.ceil(max(full_shape) / params.long_edge_px))
        views.append(averaged(radiance, reduce_by))
    if not views:
        raise HdrError("no linear images were given; import a folder with one .exr or .hdr image per view")
    radiance = np.stack(views)
    shot_noise, floor = linear_input.noise(radiance)
    clipped = np.any(radiance >= HALF_MAX, axis=-1)
    most = int(np.argmax(clipped.mean(axis=(1, 2))))
    frames = Frames(
        tuple(names),
        radiance,
        clipped,
        luminance(radiance) <= 0,
        (shot_noise, floor),
    )
    return frames, HdrReport(
        views=len(views),
        exposures=1,
        steps=(),
        suspect=(),
        unfitted=(),
        gain_counts=0.0,
        read_counts=0.0,
        white_share=1.0,
        scale=1.0,
        reduced_by=max(1, math.ceil(max(full_shape) / params.long_edge_px)),
        share_clipped=float(clipped.mean()),
        share_dark=float(frames.dark.mean()),
        most_clipped=frames.names[most],
        most_clipped_share=float(clipped[most].mean()),
    )


def _decoded(paths: Sequence[Path]) -> list[Mosaic]:
    return [read_mosaic(path) for path in paths]


Window = tuple[slice, slice]
"""Rows and columns."""


def _tiles(height: int, width: int, by: int) -> Iterator[tuple[Window, Window, Window]]:
    """Windows that cover a mosaic in whole cells and whole blocks of `by`: with the sites that count around each, the window
    inside of that, and where its blocks go. What fills no block is left out.
    """
    step = max(1, TILE_EDGE // (2 * by)) * 2 * by
    whole = [edge // by * by for edge in (height, width)]
    for corner in itertools.product(*(range(0, edge, step) for edge in whole)):
        inside = [(at, min(at + step, edge)) for at, edge in zip(corner, whole, strict=True)]
        around = [max(0, at - REACH) for at, _ in inside]
        yield (
            _window((at, end + REACH) for at, (_, end) in zip(around, inside, strict=True)),
            _window((at - first, end - first) for first, (at, end) in zip(around, inside, strict=True)),
            _window((at // by, end // by) for at, end in inside),
        )


def _window(edges: Iterable[tuple[int, int]]) -> Window:
    rows, columns = (slice(*edge) for edge in edges)
    return rows, columns


def _sorted_by_exposure(shots: Sequence[Bracket]) -> tuple[list[list[Path]], list[list[Facts]]]:
    """Files and facts of each bracket, shortest exposure first."""
    if not shots:
        raise HdrError("no photographs were given; import a folder with RAW files")
    usual = Counter(len(shot.exposures) for shot in shots).most_common(1)[0][0]
    paths, facts = [], []
    for shot in shots:
        if len(shot.exposures) != usual:
            raise HdrError(
                f"{shot.name}: has {len(shot.exposures)} exposures where the other views have {usual}; add"
                " the missing files or remove the view"
            )
        pairs = sorted(
            ((read_facts(path), path) for path in shot.exposures), key=lambda pair: pair[0].exposure()
        )
        paths.append([path for _, path in pairs])
        facts.append([fact for fact, _ in pairs])
    return paths, facts


def _check_alike(shots: Sequence[Bracket], facts: Sequence[Sequence[Facts]]) -> None:
    first = facts[0][0]
    for shot, view in zip(shots, facts, strict=True):
        for fact in view:
            if (fact.camera, fact.width, fact.height) != (first.camera, first.width, first.height):
                raise HdrError(
                    f"{shot.name}: {fact.camera} {fact.width} x {fact.height} beside {first.camera}"
                    f" {first.width} x {first.height} in {shots[0].name}; a session is of one camera and size"
                )


def _check_usable(name: str, merged: Merged, params: HdrParams) -> None:
    clipped = float(merged.clipped.mean())
    if clipped > params.hopeless_share:
        raise HdrError(
            f"{name}: {clipped:.0%} of its sites are saturated in every exposure; photograph it again with"
            f" shorter exposures, or leave it out (--without {name})"
        )
    dark = float((merged.light < params.dark_sigmas * merged.floor).mean())
    if dark > params.hopeless_share:
        raise HdrError(
            f"{name}: {dark:.0%} of its sites are below noise in every exposure; photograph it again with"
            f" longer exposures (lens cap on?), or leave it out (--without {name})"
        )


def _steps(
    stated: Float64[np.ndarray, "n k"],
    fits: Float64[np.ndarray, "n j"],
    off_ev: Float64[np.ndarray, "n j"],
    names: tuple[str, ...],
) -> tuple[Step, ...]:
    """One line for each neighbouring pair of exposures that any view could fit."""
    steps = []
    for j in range(fits.shape[1]):
        told = np.flatnonzero(~np.isnan(fits[:, j]))
        if not told.size:
            continue
        fitted_ev = np.log2(fits[told, j])
        middle = float(np.median(fitted_ev))
        worst = int(told[np.argmax(np.abs(off_ev[told, j]))])
        steps.append(
            Step(
                float(np.median(np.log2(stated[:, j + 1] / stated[:, j]))),
                middle,
                float(np.median(np.abs(fitted_ev - middle))),
                float(abs(off_ev[worst, j])),
                names[worst],
            )
        )
    return tuple(steps)


def _picked(names: tuple[str, ...], which: np.ndarray) -> tuple[str, ...]:
    return tuple(name for name, picked in zip(names, which, strict=True) if picked)
