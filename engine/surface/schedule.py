"""In which order the passes of a surface solve run.

Light and shape are found in turns on a few pixels of some views: model errors, not noise, are what these remove. The fine
phase then solves every pixel in all views under the light that they settled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface import passes
from engine.surface.data.scene import Scene
from engine.surface.estimate import Estimate, Iteration, known
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import image, render_pixels
from engine.surface.rendering.transport import pixel_blocks

FULL, HALF, SMALLEST = 0, 1, 2
"""Levels of the pictures (`Scene.at`)."""
HALF_SUFFICES_PIXELS = 8000
"""Pixels of half the size from which on an object that hides next to nothing of the room from itself is solved so and then in
detail: what stands in the way is all that a halved picture tells worse. But 4000 pixels leave some far off: .46 instead of .41 deg."""


@dataclass(frozen=True, slots=True)
class Phase:
    """Passes that run one after the other, so many times at most."""

    name: str
    level: int  # of the picture; the smallest there is where it has none so small
    passes: tuple[passes.Pass, ...]
    repeat: int = 1
    still_deg: float = 0.0  # mean turn of the normals in an iteration below which no other follows


def schedule(params: SurfaceParams, unseen: bool) -> tuple[Phase, ...]:
    """What a solve does; `unseen`: some of the light comes from where no photograph looked."""
    pixels = passes.solve_pixels, passes.expect_roughness
    shape, parts = ((one, passes.trace_visibility) for one in (passes.integrate_depth, passes.place_parts))
    light, variance = (passes.place_probes, passes.search_normals), passes.estimate_light_variance
    unseen_iterations = passes.CONFIG.unseen_iterations * (unseen and params.models("light_gains"))
    coarse = params.coarse_iterations + unseen_iterations
    phases = (
        Phase("initialise", SMALLEST, (passes.search_distance, *light)),
        Phase("coarse", SMALLEST, (*light, *pixels, passes.detect_metal, *shape, passes.split_light, passes.calibrate_light),
              max(coarse - 1, 0), 0.3),
        Phase("place", HALF, (*light, *pixels, passes.classify_material, *parts, passes.calibrate_light, variance,
                              passes.refine_distance), min(coarse, 1)),
        Phase("full", FULL, (*light, *pixels, *parts, passes.calibrate_light_in_place, variance),
              int(params.full_phase or not coarse)),
        Phase("relight", FULL, (passes.gather_light, passes.trace_visibility, passes.estimate_exposure)),
        Phase("fine", FULL, (*pixels, *parts), params.fine_iterations, 1.0),
        Phase("finish", FULL, (passes.regularize, passes.trace_visibility)),
    )  # fmt: skip
    kept = [tuple(one for one in phase.passes if one.__name__ not in params.without) for phase in phases]
    return tuple(replace(phase, passes=some) for phase, some in zip(phases, kept, strict=True))


def run(scene: Scene, now: Estimate, phases: Sequence[Phase], progress: Progress) -> Estimate:
    """All phases, one after the other; a viewer sees the normals of each.

    An iteration that renders the validation views worse than the one before is undone, and ends its phase. The first of a phase is
    not judged so: what more pixels and smoothing gain they cannot tell (decision 70).
    """
    weights = [phase.repeat * 0.5 ** min(phase.level, scene.smallest) for phase in phases]
    ends = np.concatenate([[0], np.cumsum(weights)]) / sum(weights)
    error = validation_error(scene, now)
    for phase, begin, end in zip(phases, ends[:-1], ends[1:], strict=True):
        for iteration, span in enumerate(progress.part(begin, end).parts(phase.repeat)):
            before, error_before = now, error
            now = _iteration(scene, now, phase, span)
            error, turned = validation_error(scene, now), _turned_deg(before, now)
            kept = iteration == 0 or not is_worse(error_before, error)
            made = Iteration(
                phase.name, tuple(one.__name__ for one in phase.passes), int(now.object_pixels.mask.sum()),
                float(np.median(known(now.state).residual_scale)) if passes.solve_pixels in phase.passes else None,
                turned if np.isfinite(turned) else None, float(np.median(error)) if error.size else None, kept,
            )  # fmt: skip
            if not kept:
                now, error = before, error_before
            now = replace(now, history=(*now.history, made))
            if now.state is not None:
                progress.viewer(partial(image, now.object_pixels.mask, now.state.normals))
            if not kept or (phase.still_deg and turned < phase.still_deg):
                break
    return now


def validation_error(scene: Scene, now: Estimate) -> Float[np.ndarray, "k p"]:
    """Relative error of every validation view at every pixel; without views before the light is settled."""
    if now.validation is None or now.picture is None:
        return np.zeros((0, 0))
    frames, mask = now.picture.frames, now.picture.mask
    made = render_pixels(now.validation_transport(scene), now.geometry, pixel_blocks(mask), known(now.state))
    return relative_error(made.transpose(1, 0, 2), frames.radiance[scene.validation][:, mask])


def relative_error(
    made: Float[np.ndarray, "k p 3"], photographed: Float[np.ndarray, "k p 3"]
) -> Float[np.ndarray, "k p"]:
    """Mean over the channels of what is off, of the radiance photographed."""
    least = 0.02 * np.median(photographed) if photographed.size else 0.0
    return np.mean(np.abs(made - photographed) / np.maximum(photographed, least), axis=2)


def is_worse(before: Float[np.ndarray, "_ _"], after: Float[np.ndarray, "_ _"]) -> bool:
    """Whether the views' median errors have grown by more than the standard error of their mean growth."""
    if before.shape != after.shape or len(before) < 2:
        return False
    grown = np.median(after, axis=1) - np.median(before, axis=1)
    return bool(grown.mean() > grown.std(ddof=1) / np.sqrt(len(grown)))


def _iteration(scene: Scene, now: Estimate, phase: Phase, progress: Progress) -> Estimate:
    while now.light is None and now.level > min(phase.level, scene.smallest) and not half_suffices(now):
        now = now.upsampled(scene, progress.part(0, 0.1))
    for one, span in zip(phase.passes, progress.part(0.1, 1).parts(len(phase.passes)), strict=True):
        now = one(scene, now, span)
    return now


def half_suffices(now: Estimate) -> bool:
    """Whether these are the pixels of half the size, and enough: the object is known to hide next to nothing of the room from
    itself."""
    hidden, many = now.geometry.visibility, now.object_pixels.mask.sum() >= HALF_SUFFICES_PIXELS
    return bool(now.level == HALF and many and hidden is not None and hidden.is_nearly_convex)


def _turned_deg(before: Estimate, now: Estimate) -> float:
    if before.state is None or before.level != now.level:
        return np.inf
    return float(np.degrees(angle_between(before.state.normals, known(now.state).normals).mean()))
