"""Whose light the paper's solver reads: what the stage *light* found, or the paper's own training.

Source: the paper, Sec. 3.2. Its training (`two_stage.py`) knows of no lamps: they are Gaussians among the others. World frame.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from engine.progress import Progress
from engine.reference.emitter.two_stage import EmitterParams, EmitterReport, scaled, train
from engine.reference.params import ReferenceParams
from engine.types import Frames, Gaussians, Lamps, Masks, Poses

NO_LAMPS = Lamps(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, bool))


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """The light to solve under; without a report and in no time where nothing was trained."""

    gaussians: Gaussians
    lamps: Lamps
    seconds: float = 0.0
    report: EmitterReport | None = None


def training_of(params: ReferenceParams) -> EmitterParams:
    """The counts of the training that was asked for."""
    return replace(
        scaled(params.emitter_share), one_stage=params.emitter == "one_stage", most=params.emitter_most
    )


def light_for(
    frames: Frames, masks: Masks, poses: Poses, gaussians: Gaussians, lamps: Lamps, params: ReferenceParams,
    seed: int, progress: Progress,
) -> Given:  # fmt: skip
    """What `ReferenceParams.emitter` asks for.

    Raises:
        LightError: there is nothing to train on.
    """
    if params.emitter == "ours":
        return Given(gaussians, lamps)
    begun = time.perf_counter()
    trained, report = train(frames, masks, poses, training_of(params), seed, progress)
    return Given(trained, NO_LAMPS, time.perf_counter() - begun, report)
