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
from engine.surface.data.scene import Scene
from engine.surface.estimate import Estimate, Iteration
from engine.surface.params import SurfaceParams
from engine.surface.passes import (
    CONFIG,
    Pass,
    calibrate_light,
    calibrate_light_in_place,
    classify_material,
    detect_metal,
    estimate_exposure,
    estimate_light_variance,
    expect_roughness,
    gather_light,
    integrate_depth,
    place_probes,
    refine_distance,
    regularize,
    search_distance,
    search_normals,
    solve_pixels,
    split_light,
    trace_visibility,
)  # fmt: skip
from engine.surface.rendering.object_pixels import (
    image,
    light_transport,
    photographed_radiance,
    render_pixels,
)  # fmt: skip
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
    passes: tuple[Pass, ...]
    repeat: int = 1
    still_deg: float = 0.0  # mean turn of the normals in an iteration below which no other follows


def schedule(params: SurfaceParams, unseen: bool) -> tuple[Phase, ...]:
    """What a solve does; `unseen`: some of the light comes from where no photograph looked."""
    pixels, shape = (solve_pixels, expect_roughness), (integrate_depth, trace_visibility)
    light = (place_probes, search_normals)
    coarse = params.coarse_iterations + CONFIG.unseen_iterations * (unseen and params.models("light_gains"))
    phases = (
        Phase("initialise", SMALLEST, (search_distance, *light)),
        Phase("coarse", SMALLEST, (*light, *pixels, detect_metal, *shape, split_light, calibrate_light), max(coarse - 1, 0), 0.3),
        Phase("place", HALF, (*light, *pixels, classify_material, *shape, calibrate_light, estimate_light_variance, refine_distance), min(coarse, 1)),
        Phase("full", FULL, (*light, *pixels, *shape, calibrate_light_in_place, estimate_light_variance), int(params.full_phase or not coarse)),
        Phase("relight", FULL, (gather_light, trace_visibility, estimate_exposure)),
        Phase("fine", FULL, (*pixels, *shape), params.fine_iterations, 1.0),
        Phase("finish", FULL, (regularize, *shape)),
    )  # fmt: skip
    return tuple(
        replace(phase, passes=tuple(one for one in phase.passes if one.__name__ not in params.without))
        for phase in phases
    )


def run(scene: Scene, now: Estimate, phases: Sequence[Phase], progress: Progress) -> Estimate:
    """All phases, one after the other; a viewer sees the normals of each.

    An iteration that renders the validation views worse is undone, and ends its phase; a phase of one iteration is not judged
    so, for what smoothing gains they cannot tell (decision 70).
    """
    weights = [phase.repeat * 0.5 ** min(phase.level, scene.smallest) for phase in phases]
    ends = np.concatenate([[0], np.cumsum(weights)]) / sum(weights)
    error = validation_error(scene, now)
    for phase, begin, end in zip(phases, ends[:-1], ends[1:], strict=True):
        for span in progress.part(begin, end).parts(phase.repeat):
            before, error_before = now, error
            now = _iteration(scene, now, phase, span)
            error, turned = validation_error(scene, now), _turned_deg(before, now)
            kept = phase.repeat == 1 or not is_worse(error_before, error)
            made = Iteration(
                phase.name, tuple(one.__name__ for one in phase.passes), len(now.object_pixels.rays),
                float(np.median(now.known_state.residual_scale)) if solve_pixels in phase.passes else None,
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
    photographed = photographed_radiance(frames, mask, scene.validation.tolist())
    there = light_transport(photographed, now.validation, now.geometry, scene.params, "cpu")
    made = render_pixels(there, now.geometry, pixel_blocks(mask), now.known_state)
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
    hidden = now.geometry.visibility
    return (
        now.level == HALF
        and hidden is not None
        and len(now.object_pixels.rays) >= HALF_SUFFICES_PIXELS
        and hidden.is_nearly_convex
    )


def _turned_deg(before: Estimate, now: Estimate) -> float:
    if before.state is None or before.level != now.level:
        return np.inf
    return float(np.degrees(angle_between(before.state.normals, now.known_state.normals).mean()))
