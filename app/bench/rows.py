"""The solvers that the benchmarks compare: a row each.

To add one, append a `Method` to `others` (rows of every table and of the chart), to `swept` (the chart alone) or to
`switched` (the ablation alone). `solve` takes what the stages before the surface left, and answers with the surface
and what it took; it is given no truth.
"""

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from app.bench.alike import alike
from app.bench.stored import Stored, unlit_by_lamps
from engine.pipeline import presets
from engine.progress import Progress
from engine.reference.baselines import BASELINES
from engine.reference.emitter import scaled as scaled_training
from engine.reference.emitter import train
from engine.reference.params import ReferenceParams, scaled, title
from engine.surface.pixels import SurfaceParams
from engine.surface.solve import solve
from engine.types import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A surface; its mask may hold fewer pixels than the object.

    `seconds` are those of the whole object: where fewer pixels, views or samples were computed than are meant, they
    are `extrapolated`; NaN where nobody knows them.
    """

    surface: Surface
    seconds: float
    extrapolated: bool = False


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


def ours(
    key: str, title: str, params: SurfaceParams, change: Callable[[Stored], Stored] = lambda stored: stored
) -> Method:
    """Our solver with some parameters, on what `change` (named by `key`) makes of its input."""

    def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
        given = change(stored)
        start = time.perf_counter()
        surface, *_ = solve(*given.inputs, params, device, seed, progress)
        return Answer(surface, time.perf_counter() - start)

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
        surface = BASELINES[key].solve(*given.inputs, params, device, seed, progress)
        return Answer(surface, time.perf_counter() - start)

    facts = dataclasses.asdict(BASELINES[key].params())
    return Method(key, key.replace("_", " "), "baseline", run, facts, matched=not known)


def reference(params: ReferenceParams, work: int) -> Method:
    """The paper's solver, on as many of the pixels as `work` (pixels x views x samples x epochs) is enough for."""

    def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
        same = alike(stored, device, seed)
        return by_reference(same.stored, params, work, same.distance, device, seed, progress)

    name = f"reference_{params.samples}_{params.epochs}"
    name += "" if params.emitter_sampling else "_cosine_ggx"
    return Method(name, title(params), "reference", run, dataclasses.asdict(params) | {"work": work})


def by_reference(
    given: Stored,
    params: ReferenceParams,
    work: int,
    distance: float,
    device: str,
    seed: int,
    progress: Progress,
) -> Answer:
    """The paper's solver on a part of the pixels, its seconds told for the whole object."""
    # Torch takes seconds to load.
    from engine.reference.solver import solve as solve_by_reference

    each = len(given.frames.names) * params.samples * params.epochs
    pixels = max(LEAST_PIXELS, work // each)
    params = replace(params, pixels=pixels, object_distance=distance)
    surface, _, _, report = solve_by_reference(*given.inputs, params, device, seed, progress)
    whole = report.seconds_per_pixel * report.object_pixels
    return Answer(surface, whole, report.pixels < report.object_pixels)


LEAST_PIXELS = 48
"""Of the reference, however dear: three of its tiles."""
SWEEP = tuple((samples, epochs) for samples in (16, 64, 256) for epochs in (10, 25, 50, 100))


def others(work: int) -> tuple[Method, ...]:
    """The reference at its published settings, and the baselines; `work` as in `reference`."""
    return (reference(ReferenceParams(), work), *baselines())


def swept(work: int) -> tuple[Method, ...]:
    """The reference at several numbers of samples and epochs, short of the published ones."""
    published = ReferenceParams()
    few = [pair for pair in SWEEP if pair != (published.samples, published.epochs)]
    return tuple(reference(scaled(*pair), work) for pair in few)


def switched(work: int, training: float) -> tuple[Method, ...]:
    """The paper's ablation: the reference as published, without emitter sampling, and under the paper's own light in
    two stages and in one, trained for a share `training` of the published iterations."""
    sampling = (reference(ReferenceParams(emitter_sampling=on), work) for on in (True, False))
    return (*sampling, *(trained(one_stage, work, training) for one_stage in (False, True)))


def trained(one_stage: bool, work: int, training: float) -> Method:
    """The reference as published, under the light of the paper's own training instead of ours."""
    emitter = replace(scaled_training(training), one_stage=one_stage)
    usual = reference(ReferenceParams(), work)

    def run(stored: Stored, device: str, seed: int, progress: Progress) -> Answer:
        start = time.perf_counter()
        light, _ = train(stored.frames, stored.masks, stored.poses, emitter, seed, progress.part(0, 0.5))
        seconds = time.perf_counter() - start
        distance = alike(stored, device, seed).distance
        given = replace(unlit_by_lamps(stored), gaussians=light)
        answer = by_reference(given, ReferenceParams(), work, distance, device, seed, progress.part(0.5, 1))
        return replace(answer, seconds=answer.seconds + seconds)

    stages = "one stage" if one_stage else "two stages"
    key = f"{usual.key}_{'one' if one_stage else 'two'}_stage_light"
    title = f"{usual.title}, the paper's light in {stages}, {training:.3g} of the iterations"
    return Method(key, title, "reference", run, dict(usual.facts) | dataclasses.asdict(emitter))


def switch_rows() -> tuple[Method, ...]:
    """Ours at its defaults, and with one remedy for a bias taken away after the other."""
    usual = params_of(OURS)

    def without(key: str, title: str, **changes: Any) -> Method:
        return ours(key, title, replace(usual, **changes))

    return (
        ours(OURS, "ours", usual),
        without("lambert_diffuse", "w/o Disney's diffuse lobe: Lambert's", full_diffuse=False),
        without("no_visibility", "w/o shadows of the object on itself", visibility=False),
        without("no_horizons", "w/o horizons: shadows from depth alone", horizons=False),
        without("no_steps", "w/o steps from horizons", steps=False),
        without("no_bounce", "w/o light bounced by the object", bounce=False),
        without("no_accord", "w/o neighbours that agree", accord=False),
        without("no_relight", "w/o refining the light", relight=False),
        # The turns that find the distance keep their own few probes.
        ours(
            "far_light", "w/o near light: one probe, lamps far away",
            replace(usual, probes_across=1, probes_deep=1), unlit_by_lamps,
        ),
        without("half_directions", "half the directions", directions=usual.directions // 2),
        without("two_rounds", "another round on all pixels", rounds=2),
    )  # fmt: skip
