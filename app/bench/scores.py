"""Rows held against their truth, over the pixels that every row of a set answered, and as metrics with tolerances."""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.bench import depth
from app.bench.gate import RATIO
from app.bench.measured import Row
from app.bench.record import BenchError, Metric
from app.bench.rows import OURS
from engine.results import metrics
from engine.types import Surface


@dataclass(frozen=True, slots=True)
class Score:
    """One of the paper's three measures."""

    key: str
    title: str
    unit: str
    direction: str
    tolerance: float  # that a gate allows: libraries and processors round differently
    decimals: int


SCORES = (
    Score("normal", "Normal ↓", "deg", "lower", 0.1, 2),
    Score("albedo", "Albedo ↑", "dB", "higher", 0.2, 1),
    Score("roughness", "Roughness ↓", "mean absolute error", "lower", 0.004, 4),
)
RENDERED = 0.01
"""By which the error of views rendered again may rise."""
WANDERING = 5.0
"""By which tolerances are multiplied for all but ours over whole objects: the others are yardsticks, of which the reference takes few
samples and a descent that rounding sends another way (up to 0.3 dB of albedo between two processors), and the rest lean on a light
that differs in its last digits (0.7 dB, with and without AVX-512); of few pixels that light alone moves ours by 0.3 dB."""
ANY = 3.14
"""A standard error of a normal, radians, that says any will do, as the reference's does."""
SLOWER = 1.0
"""A ratio of times may rise by this share of itself: small sets and busy machines."""
QUICKER = 0.75
"""By this share the times of others may fall beside ours: tiny sets are solved in the time that it takes to begin."""


@dataclass(frozen=True, slots=True)
class Scored:
    """One method on one set, or their mean over sets."""

    set: str
    method: str
    title: str
    kind: str
    values: Mapping[str, float]  # by `Score.key`
    seconds: float
    extrapolated: bool
    pixels: int  # compared
    runs: tuple[str, ...]  # that measured the seconds, set by set
    rendered: float = math.nan  # median relative error of views kept out, rendered again
    in_band: float = math.nan  # share of normals within their stated 95 %; NaN: none is stated
    thing: str = ""  # the object; rows of older records do not say it
    bound: float = math.nan  # least mean error of normals that the photographs allow, degrees; NaN: not known
    to_bound: float = math.nan  # error of normals over it
    blur: float = math.nan  # mean angle between a pixel's normal at its centre and its mean, degrees
    depth_within: float = math.nan  # of the parts of the true depth (`depth`), pixel widths
    depth_between: float = math.nan


def score(rows: Sequence[Row]) -> list[Scored]:
    """Every row of one set, over the same pixels.

    Raises:
        BenchError: no pixel was answered by all.
    """
    common = np.logical_and.reduce([row.surface.mask for row in rows]) & rows[0].set.truth.mask
    if not common.any():
        raise BenchError(
            f"{rows[0].set.name}: no pixel of the truth was answered by every row; nothing to compare"
        )
    on = rows[0].set
    bound, blur = (math.nan, math.nan) if on.bound is None else on.bound.over(common)
    camera, truth = on.stored.poses.camera, on.truth
    part = depth.parts_of(truth.depth, truth.normal, truth.mask, camera)
    scored = []
    for row in rows:
        found = metrics.evaluate(_masked(row.surface, common), row.set.truth)
        albedo = found.albedo_psnr_matched_db if row.method.matched else found.albedo_psnr_db
        error = row.surface.stderr_normal[common]
        stated = bool(((error > 0) & (error < ANY)).any())
        deep = depth.depth_error(row.surface.depth, truth.depth, part, common, camera)
        values = {"normal": found.normal_mean_deg, "albedo": albedo, "roughness": found.roughness_mae}
        scored.append(
            Scored(
                row.set.name, row.method.key, row.method.title, row.method.kind, values, row.seconds,
                row.extrapolated, int(common.sum()), (row.run,), row.rendered,
                found.normal_in_band if stated else math.nan, on.thing, bound, found.normal_mean_deg / bound,
                blur, deep.within, deep.between,
            )
        )  # fmt: skip
    return scored


def mean(scored: Sequence[Scored], name: str = "mean") -> Scored:
    """One method's mean over sets."""
    first = scored[0]
    return replace(
        first,
        set=name,
        values={key: statistics.fmean(s.values[key] for s in scored) for key in first.values},
        seconds=statistics.fmean(s.seconds for s in scored),
        extrapolated=any(s.extrapolated for s in scored),
        pixels=sum(s.pixels for s in scored),
        runs=tuple(run for s in scored for run in s.runs),
        rendered=statistics.fmean(s.rendered for s in scored),
        in_band=statistics.fmean(s.in_band for s in scored),
        bound=statistics.fmean(s.bound for s in scored),
        to_bound=statistics.fmean(s.to_bound for s in scored),
        blur=statistics.fmean(s.blur for s in scored),
        depth_within=statistics.fmean(s.depth_within for s in scored),
        depth_between=_known_mean([s.depth_between for s in scored]),
    )


def _known_mean(values: Sequence[float]) -> float:
    """Over those that have one: an object of one part has no error between parts."""
    known = [value for value in values if not math.isnan(value)]
    return statistics.fmean(known) if known else math.nan


def by_method(scored: Iterable[Scored]) -> dict[str, list[Scored]]:
    """In the order in which methods first appear."""
    groups: dict[str, list[Scored]] = {}
    for one in scored:
        groups.setdefault(one.method, []).append(one)
    return groups


def means(scored: Sequence[Scored]) -> list[Scored]:
    """Every method's mean over its sets."""
    return [mean(group) for group in by_method(scored).values()]


def ratio(one: Scored, other: Scored) -> float | None:
    """Seconds of one per second of the other; None unless both were measured, on every set in one run: sets may differ."""
    measured = not (math.isnan(one.seconds) or math.isnan(other.seconds))
    return one.seconds / other.seconds if measured and one.runs == other.runs else None


def object_means(scored: Sequence[Scored]) -> list[Scored]:
    """Every method's mean over the rooms of each object."""
    things = dict.fromkeys(thing(one) for one in scored)
    return [mean(group, f"mean-{name}") for name in things for group in _of(scored, name).values()]


def thing(one: Scored) -> str:
    """The object of a set ROOM-OBJECT; older records know rooms without a hyphen alone."""
    return one.thing or one.set.partition("-")[2]


def _of(scored: Sequence[Scored], name: str) -> dict[str, list[Scored]]:
    return by_method(one for one in scored if thing(one) == name)


def as_metrics(scored: Sequence[Scored], few: bool = False) -> list[Metric]:
    """Accuracies, seconds, and ratios of seconds to ours at its defaults where the same runs measured both.

    Of `few` pixels each is another number, which their number names.
    Ratios of extrapolated seconds are told but not gated: what a solve of few pixels takes to begin is multiplied too.
    """
    usual = {one.set: one for one in scored if one.method == OURS}
    found = []
    for one in scored:
        at = f"{one.set} {one.pixels} pixels/{one.method}" if few else f"{one.set}/{one.method}"
        times = WANDERING if few or one.kind != "ours" else 1.0
        for kind in SCORES:
            found.append(
                Metric(
                    f"{at}/{kind.key}",
                    one.values[kind.key],
                    kind.unit,
                    kind.direction,
                    times * kind.tolerance,
                )
            )
        if not math.isnan(one.rendered):
            found.append(
                Metric(f"{at}/rendered", one.rendered, "relative error, median", "lower", times * RENDERED)
            )
        if not math.isnan(one.in_band):
            found.append(Metric(f"{at}/in_band", one.in_band, "share of pixels, ideally 0.95", "higher"))
        for name, value, unit in (
            ("bound", one.bound, "deg"), ("normal_to_bound", one.to_bound, "bounds"),
            ("pixel_blur", one.blur, "deg"),
            ("depth_within", one.depth_within, "pixel widths"), ("depth_between", one.depth_between, "pixel widths"),
        ):  # fmt: skip
            if not math.isnan(value):
                found.append(Metric(f"{at}/{name}", value, unit, "lower"))
        found.append(Metric(f"{at}/seconds", one.seconds, "s", "lower", None, one.extrapolated))
        beside = usual.get(one.set)
        share = ratio(one, beside) if beside is not None and beside is not one else None
        if share is not None:
            at_ours = one.kind == "ours"
            # Ours may not become slower beside itself; of the others it is their being slower that counts.
            direction, slack = ("lower", SLOWER * share) if at_ours else ("higher", QUICKER * share)
            allowed = None if one.extrapolated else slack
            found.append(
                Metric(f"{at}/seconds_to_{OURS}", share, RATIO, direction, allowed, one.extrapolated)
            )
    return found


def albedo_rmse(psnr_db: float) -> float:
    """The root mean square error that a PSNR against a peak of 1 says."""
    return math.pow(10, -psnr_db / 20)


def _masked(surface: Surface, mask: np.ndarray) -> Surface:
    return replace(surface, mask=mask)
