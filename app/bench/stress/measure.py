"""One worse capture through the light and the surface: what came out, and what the verdict said of it."""

import contextlib
import hashlib
import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from app import places
from app.bench import record, rows
from app.bench.alike import hand_over
from app.bench.call import Call
from app.bench.choices import Choice
from app.bench.rows import Answer, Method
from app.bench.sets import Set, job
from app.bench.stress.dials import DIALS, joined_halves
from engine.errors import Cancelled, RoomlightError
from engine.geometry import angle_between
from engine.io import session as sessions
from engine.io.ground_truth import Truth
from engine.io.raw import read_facts
from engine.light.fitting import fit as light_fit
from engine.light.fitting.params import LightParams
from engine.pipeline import artifacts
from engine.pipeline.stages import canonical
from engine.progress import Progress
from engine.results import metrics
from engine.results.quality import quality
from engine.segmentation.params import SegmentParams
from engine.segmentation.segment import report_on
from engine.surface.solve import solve
from engine.types import CapturedScene, Surface

CLEAN = "clean"
"""The dial of the set as it is, at step 0."""


@dataclass(frozen=True, slots=True)
class MethodErrors:
    """Another method on the same capture, under the light and at the distance that ours found."""

    normal_deg: float  # mean error
    ours_deg: float  # the same of ours, over the same pixels
    albedo_db: float
    roughness: float  # mean absolute error
    solved: float  # share of the true mask that was answered
    seconds: float  # of the whole object


@dataclass(frozen=True, slots=True)
class Stressed:
    """One run. NaN where the capture was refused."""

    set: str
    dial: str
    step: int
    amount: float
    refused: str  # why; empty where it was solved
    normal_deg: float = math.nan  # mean error
    stated_deg: float = math.nan  # mean standard error
    in_50: float = math.nan  # share of normals within their stated 50 %,
    in_68: float = math.nan
    in_90: float = math.nan
    in_95: float = math.nan
    ause: float = math.nan  # of the stated errors, for sorting the pixels
    albedo_db: float = math.nan
    roughness: float = math.nan  # mean absolute error
    solved: float = math.nan  # share of the true mask that was answered
    seconds: float = math.nan
    grade: str = ""
    doubt: float = math.nan
    reason: str = ""
    others: Mapping[str, MethodErrors] = field(
        default_factory=dict
    )  # methods beside ours, by their rows' keys
    facts: Mapping[str, float] = field(
        default_factory=dict
    )  # the numbers that the stages measured of themselves


def photographed(call: Call, on: Set, room: Choice, thing: Choice, dial: str, step: int) -> Set | None:
    """What a dial is turned on: the set itself, or one of another scene under its name; None where it is no dial for that room."""
    one = DIALS[dial]
    if one.scene is None:
        return on
    scene = one.scene(room, thing, one.amounts[step - 1], call.args.seed)
    if scene is None:
        return None
    there = replace(call.set(*scene, None), room=on.room, thing=on.thing)
    if not one.half_way:
        return there
    return replace(
        there, stored=joined_halves(on.stored, there.stored, _middle_exposure(on) / _middle_exposure(there))
    )


def _middle_exposure(on: Set) -> float:
    """Exposure of the middle photograph of a bracket, which the studio meters for a whole set: what its radiance counts in."""
    session = sessions.open_session(on.session)
    if session.kind == "linear":
        return 1.0
    return float(np.median([read_facts(file).exposure() for file in sessions.shots(session)[0].files]))


def measure(call: Call, on: Set, dial: str, step: int, others: Sequence[Method] = ()) -> Stressed:
    """A dial of `DIALS` turned to a step, or `CLEAN` at 0; kept beside the sets for the next call.

    Raises:
        Cancelled: a stop was asked for; finished runs are kept.
    """
    args = call.args
    facts = [
        on.stored.fingerprint, dial, step, args.preset, call.device, args.seed, record.engine_digest(),
        [(method.key, dict(method.facts)) for method in others],
    ]  # fmt: skip
    path = call.folder / "stress" / f"{hashlib.sha256(canonical(facts).encode()).hexdigest()[:16]}.json"
    if path.exists() and not args.fresh:
        with contextlib.suppress(ValueError, TypeError, KeyError):  # damaged: measured again
            return artifacts.revive(json.loads(path.read_text()), Stressed)
    amount = DIALS[dial].amounts[step - 1] if step else 0.0
    with job(f"{on.name} {dial} {step}") as progress:
        try:
            found = _solved(call, on, dial, step, amount, others, progress)
        except Cancelled:
            raise  # a stop says nothing of the capture, and is not kept
        except RoomlightError as refusal:
            found = Stressed(on.name, dial, step, amount, str(refusal))
    places.keep(path, json.dumps(artifacts.plain(found)))
    return found


def _solved(
    call: Call, on: Set, dial: str, step: int, amount: float, others: Sequence[Method], progress: Progress
) -> Stressed:
    seed, device, fit = call.args.seed, call.device, LightParams(**call.size.settings.get("light", {}))
    given = DIALS[dial].at(on.stored, step, seed) if step else on.stored
    frames, masks, poses = given.frames, given.masks, given.poses
    begun = time.perf_counter()
    gaussians, lamps, light = light_fit.fit(frames, masks, poses, fit, seed, progress.part(0, 0.4))
    captured = CapturedScene(frames, masks, poses, gaussians, lamps)
    solved = solve(captured, rows.params_of(call.args.preset), device, seed, progress.part(0.4, 0.8))
    surface, report = solved.surface, solved.report
    seconds = time.perf_counter() - begun
    scored = metrics.evaluate(surface, on.truth)
    border = report_on(frames, masks.object, SegmentParams())
    told = {
        stage: artifacts.plain(facts)
        for stage, facts in (("segment", border), ("light", light), ("surface", report))
    }
    verdict = quality(told)
    assert verdict is not None  # our solver knows its errors
    answered = surface.mask & on.truth.mask
    error, stated = angle_between(surface.normal, on.truth.normal)[answered], surface.stderr_normal[answered]
    hand_over(given, device, seed, solved.emitters, report.distance.value)
    errors = {}
    for i, method in enumerate(others):
        span = progress.part(0.8 + 0.2 * i / len(others), 0.8 + 0.2 * (i + 1) / len(others))
        errors[method.key] = _errors_of(method, method.solve(given, device, seed, span), surface, on.truth)
    return Stressed(
        on.name, dial, step, amount, "",
        normal_deg=scored.normal_mean_deg,
        stated_deg=float(np.degrees(stated.mean())),
        in_50=metrics.normal_coverage(error, stated, 0.5),
        in_68=metrics.normal_coverage(error, stated, 0.68),
        in_90=metrics.normal_coverage(error, stated, 0.9),
        in_95=scored.normal_in_band,
        ause=metrics.sparsification_error(error, stated),
        albedo_db=scored.albedo_psnr_db,
        roughness=scored.roughness_mae,
        solved=float(answered.sum() / on.truth.mask.sum()),
        seconds=seconds,
        grade=verdict.grade,
        doubt=verdict.doubt,
        reason=verdict.reason,
        others=errors,
        facts={
            f"{stage}.{name}": float(value)
            for stage, values in told.items() for name, value in values.items()
            if isinstance(value, int | float)
        },
    )  # fmt: skip


def _errors_of(method: Method, answer: Answer, ours: Surface, truth: Truth) -> MethodErrors:
    """Errors over the pixels that both answered; NaN where there are none."""
    both = answer.surface.mask & ours.mask & truth.mask
    solved = float((answer.surface.mask & truth.mask).sum() / truth.mask.sum())
    if not both.any():
        return MethodErrors(math.nan, math.nan, math.nan, math.nan, solved, answer.seconds)
    there = replace(truth, mask=both)
    theirs, own = metrics.evaluate(answer.surface, there), metrics.evaluate(ours, there)
    albedo = theirs.albedo_psnr_matched_db if method.matched else theirs.albedo_psnr_db
    return MethodErrors(
        theirs.normal_mean_deg, own.normal_mean_deg, albedo, theirs.roughness_mae, solved, answer.seconds
    )
