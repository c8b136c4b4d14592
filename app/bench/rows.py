"""The solvers that the benchmarks compare: a row each.

To add one, append a `Method` to `others` (rows of every table and of the chart), to `swept` (the chart alone) or to
`switched` (the ablation alone). `solve` takes what the stages before the surface left, and answers with the surface
and what it took; it is given no truth.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from app import results
from app.bench import choices
from app.bench.alike import alike, hand_over
from app.bench.baselines.methods import BASELINES
from app.bench.sizes import Size
from app.bench.stored import Stored, unlit_by_lamps
from engine.pipeline import presets
from engine.progress import Progress
from engine.reference.params import ReferenceParams, scaled, title
from engine.surface.lighting.probe_density import ProbeDensityConfig
from engine.surface.params import SurfaceParams
from engine.surface.solve import solve
from engine.surface.uncertainty.model_parts import PartWorth
from engine.types import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A surface; its mask may hold fewer pixels than the object.

    `seconds` are those of the whole object: where fewer pixels, views or samples were computed than are meant, they
    are `extrapolated`; NaN where nobody knows them. `rendered`: median relative error of the views kept out, rendered
    again over the pixels solved; NaN where the method renders none.
    """

    surface: Surface
    seconds: float
    extrapolated: bool = False
    rendered: float = math.nan
    by_view: tuple[float, ...] = ()  # `rendered` of every view kept out; ours alone, as the following
    worths: tuple[PartWorth, ...] = ()  # of the parts of the model


@dataclass(frozen=True, slots=True)
class Method:
    """One row. `facts` decide its answer, besides what it is given: another fact, another result to keep."""

    key: str  # in metrics: no spaces
    title: str
    kind: str  # "ours" | "reference" | "baseline" | "maps"; points of one kind look alike on the chart
    solve: Callable[[Stored, str, int, Progress], Answer]  # device, seed
    facts: Mapping[str, Any] = field(default_factory=dict)
    matched: bool = False  # its albedo has no scale: it is compared after matching the truth's mean


OURS = "standard"
"""Key of the row that ratios of times refer to."""
BESIDE = (OURS, "draft")
"""Our rows that are held against the reference, which solves few of the pixels, over those alone."""


def chosen(methods: Sequence[Method], keys: Sequence[str]) -> tuple[Method, ...]:
    """The methods of those keys, all if none is asked for, in the order in which they stand.

    Raises:
        BenchError: no method is called so.
    """
    kept = choices.picked("--methods", keys, [method.key for method in methods])
    return tuple(method for method in methods if method.key in kept)


def ours(
    key: str,
    title: str,
    params: SurfaceParams,
    change: Callable[[Stored], Stored] = lambda stored: stored,
) -> Method:
    """Our solver with some parameters, on what `change` (named by `key`) makes of its input."""

    def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
        given = change(stored)
        start = time.perf_counter()
        found = solve(given.captured, params, device, seed, progress)
        seconds = time.perf_counter() - start
        if params == SurfaceParams() and given is stored:
            hand_over(stored, device, seed, found.emitters, found.report.distance.value)
        error = results.error_by_view(given.frames, found.renders, found.surface.mask)
        return Answer(
            found.surface, seconds, rendered=found.report.held_out_error, by_view=tuple(map(float, error)),
            worths=found.report.part_worths,
        )  # fmt: skip

    return Method(key, title, "ours", run, dataclasses.asdict(params))


def params_of(preset: str) -> SurfaceParams:
    return replace(SurfaceParams(), **presets.of_stage("surface")[preset])


def preset_rows() -> tuple[Method, ...]:
    """Ours, at every preset."""
    return tuple(ours(name, f"ours, {name}", params_of(name)) for name in presets.of_stage("surface"))


def baselines() -> tuple[Method, ...]:
    """Simpler methods, each under the light and at the distance that ours found, if it knows of light at all."""
    return tuple(_baseline(key) for key in BASELINES)


def _baseline(key: str) -> Method:
    known = key != "uncalibrated"

    def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
        params, given = BASELINES[key].params(), stored
        if known:
            same = alike(stored, device, seed)
            params, given = replace(params, object_distance=same.distance), same.stored
        start = time.perf_counter()
        surface = BASELINES[key].solve(given.captured, params, device, seed, progress)
        return Answer(surface, time.perf_counter() - start)

    facts = dataclasses.asdict(BASELINES[key].params())
    return Method(key, key.replace("_", " "), "baseline", run, facts, matched=not known)


def reference(params: ReferenceParams, size: Size, least: int) -> Method:
    """The paper's solver, on as many of the pixels as the size's work is enough for, and `least` however dear."""

    def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
        same = alike(stored, device, seed)
        part = replace(params, pixels=affordable(params, size, least, len(stored.frames.names)))
        return by_reference(same.stored, part, same.distance, device, seed, progress)

    name = f"reference_{params.samples}_{params.epochs}"
    name += "" if params.emitter_sampling else "_cosine_ggx"
    name += "" if params.emitter == "ours" else f"_{params.emitter}_light"
    facts = dataclasses.asdict(params) | {"work": size.reference_work, "least": least}
    return Method(name, title(params), "reference", run, facts)


def by_reference(
    given: Stored, params: ReferenceParams, distance: float, device: str, seed: int, progress: Progress
) -> Answer:
    """The paper's solver on a part of the pixels, its seconds told for the whole object and with its own light's training."""
    # Torch takes seconds to load.
    from engine.reference.solver import solve as solve_by_reference

    params = replace(params, object_distance=distance)
    found = solve_by_reference(given.captured, params, device, seed, progress)
    surface, report = found.surface, found.report
    whole = report.seconds_per_pixel * report.object_pixels + report.emitter_seconds
    whole = whole if params.epochs else math.nan
    return Answer(surface, whole, report.pixels < report.object_pixels, report.held_out_error)


def affordable(params: ReferenceParams, size: Size, least: int, views: int) -> int:
    """Pixels that a row of the reference solves."""
    return max(least, size.reference_work // (views * params.samples * max(params.epochs, 1)))


FEW, MANY = 48, 96
"""Pixels at least that the reference solves where many sets are averaged, and where there is one: it draws them in tiles
of 16."""


def dearest(size: Size) -> ReferenceParams:
    """The reference at the most samples and epochs of the size: where that is a benchmark to report, as published."""
    return scaled(size.samples[-1], size.epochs[-1])


def others(size: Size, least: int) -> tuple[Method, ...]:
    """The reference at its dearest, and the baselines."""
    return (reference(dearest(size), size, least), *baselines())


def swept(size: Size, least: int = MANY) -> tuple[Method, ...]:
    """The reference at fewer samples and epochs."""
    pairs = [(samples, epochs) for samples in size.samples for epochs in size.epochs]
    return tuple(reference(scaled(*pair), size, least) for pair in pairs[:-1])


def switched(size: Size, least: int = MANY) -> tuple[Method, ...]:
    """The paper's ablation: the reference before its first step and after its last, without emitter sampling, and under
    the paper's own light in two stages and in one, trained for a share of the published iterations."""
    last = dearest(size)
    begun = replace(reference(replace(last, epochs=0), size, least), title="reference, as it starts")
    taught = replace(last, emitter_share=size.training, emitter_most=size.emitters)
    changed = (
        last,
        replace(last, emitter_sampling=False),
        replace(taught, emitter="two_stage"),
        replace(taught, emitter="one_stage"),
    )
    return (begun, *(reference(params, size, least) for params in changed))


def switch_rows(preset: str) -> tuple[Method, ...]:
    """Ours at a preset, and with one remedy for a bias taken away after the other."""
    usual = params_of(preset)

    def changed(key: str, title: str, **changes: Any) -> Method:
        return ours(key, title, replace(usual, **changes))

    def without(title: str, *parts: str) -> Method:
        return changed(f"no_{parts[-1]}", f"w/o {title}", without=parts)

    return (
        ours(preset, "ours" if preset == OURS else f"ours, {preset}", usual),
        changed("lambert_diffuse", "w/o Disney's diffuse lobe: Lambert's", diffuse="lambert"),
        without("shadows of the object on itself", "self_shadowing"),
        without("light bounced by the object", "interreflections"),
        without("walls that no photograph shows", "hidden_surfaces"),
        without("robust weights", "robust_loss"),
        without("roughness expected of what looks alike", "expect_roughness"),
        without("background in the rim's pixels", "mixed_pixels"),
        without("metal and other specular levels than paint's", "detect_metal", "classify_material"),
        without("neighbours that agree", "regularize"),
        without("a factor for the light of each view", "view_exposures"),
        without("moving lamps", "lamp_directions"),
        without("refining the light", "light_gains"),
        # The turns that find the distance keep their own few probes.
        ours(
            "far_light", "w/o near light: one probe, lamps far away",
            replace(usual, probe_grid_xy=1, probe_grid_z=1), unlit_by_lamps,
        ),
        changed(
            "half_directions", "half the directions that gloss asks for",
            directions=ProbeDensityConfig().most_directions // 2,
        ),
        changed("one_round", "one round on all pixels, however they move", fine_iterations=1),
    )  # fmt: skip
