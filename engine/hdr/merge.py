"""Stage *hdr*: each view's photographs become linear radiance, on one scale for the whole session.

Source: Hanji, Zhong, Mantiuk (2020), see `engine/hdr/exposures.py`. The merge works on the mosaic, before
demosaicing, so that no saturated site leaks into its neighbours. Radiance 1 is what fills a green site in the
session's middle exposure; linear Rec.709, daylight white; x right, y down as the sensor lies, whatever way up
the camera was held.
"""

import itertools
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64

from engine.color import luminance
from engine.errors import HdrError
from engine.hdr import exposures, linear_input
from engine.hdr.develop import averaged, develop, variance
from engine.hdr.exposures import Merged, SensorNoise
from engine.hdr.params import HdrParams
from engine.io.images import read_radiance
from engine.io.raw import Bracket, Facts, read_facts, read_mosaic
from engine.progress import Progress
from engine.types import Frames

HALF_MAX = 65504.0  # the largest half float: where an EXR writer itself clips
# Where no pair of exposures tells: 50 000 electrons fill a pixel of most large sensors at base ISO.
ASSUMED_FULL_ELECTRONS, ASSUMED_READ_COUNTS = 50_000.0, 2.0


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


def merge(
    shots: Sequence[Bracket], params: HdrParams, progress: Progress, left_out: Collection[str] = ()
) -> tuple[Frames, HdrReport]:
    """Radiance of every bracket, also of those `left_out`, by name, which alone may be unusable.

    Raises:
        HdrError: an incomplete bracket, mixed cameras or sizes, or a view without usable pixels.
        RawError: a file cannot be read.
    """
    progress.step(0.0, "reading exposure data")
    paths, facts = _sorted_by_exposure(shots)
    _check_alike(shots, facts)
    stated = np.array([[fact.exposure() for fact in view] for view in facts])
    scale = float(np.median(stated[:, stated.shape[1] // 2]))

    progress.step(0.02, "learning the sensor's noise")
    chosen = np.unique(np.linspace(0, len(shots) - 1, params.learning_views).round().astype(int)).tolist()
    white_share = min(exposures.white_share(read_mosaic(paths[n][-1])) for n in chosen)
    saturation = params.saturation_share * white_share
    learnt, usual = exposures.learn([paths[n] for n in chosen], stated[chosen], saturation)

    reduce_by = max(1, math.ceil(max(facts[0][0].width, facts[0][0].height) / params.long_edge_px))
    views: list[Float32[np.ndarray, "h w 3"]] = []
    lost: list[Bool[np.ndarray, "h w"]] = []
    fits = np.full((len(shots), stated.shape[1] - 1), np.nan)
    variances = np.empty((len(shots), 2))
    for n, shot in enumerate(shots):
        progress.step(0.05 + 0.95 * n / len(shots), f"merging {shot.name}")
        mosaics = [read_mosaic(path) for path in paths[n]]
        stack = [exposures.exposure(mosaic, saturation) for mosaic in mosaics]
        fits[n] = [exposures.ratio(a, b) for a, b in itertools.pairwise(stack)]
        times = exposures.times(stated[n], np.where(np.isnan(fits[n]), usual, fits[n]))
        noise = learnt or SensorNoise(stack[0].full / ASSUMED_FULL_ELECTRONS, ASSUMED_READ_COUNTS)
        merged = exposures.merge(stack, times, noise)
        if shot.name not in left_out:
            _check_usable(shot.name, merged, params)
        to_radiance = scale / stack[0].full
        variances[n] = variance(mosaics[0], merged, noise) * [to_radiance, to_radiance**2]
        radiance = develop(mosaics[0], merged, noise) * np.float32(to_radiance)
        # Each colour of a pixel leans on the sites around it; a clipped one spoils all it was used for.
        spoiled = cv2.dilate(merged.clipped.astype(np.uint8), np.ones((5, 5), np.uint8))
        views.append(averaged(radiance, reduce_by))
        lost.append(averaged(spoiled.astype(np.float32), reduce_by) > 0)

    shot_noise, floor = np.median(variances, axis=0) / reduce_by**2
    radiance, clipped = np.stack(views), np.stack(lost)
    dark = luminance(radiance) < params.dark_sigmas * np.sqrt(floor)
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
