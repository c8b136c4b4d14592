"""Mask and poses as the stages before the surface estimated them, set by set, held against the truth."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from app.bench.markdown import markdown, shown
from app.bench.sets import Set
from engine.results import metrics

# Heading, field, factor, decimals.
COLUMNS = (
    ("mask IoU ↑", "iou", 1, 3),
    ("registered % ↑", "registered_share", 100, 1),
    ("rotation deg ↓", "rotation_median_deg", 1, 3),
    ("position % ↓", "position_median_percent", 1, 2),
)


@dataclass(frozen=True, slots=True)
class Estimated:
    """As `roomlight evaluate` has them; None where the truth says nothing."""

    set: str
    iou: float | None
    registered_share: float | None
    rotation_median_deg: float | None
    position_median_percent: float | None  # of the path's extent


def of_set(on: Set) -> Estimated:
    """Those of one set.

    Raises:
        TruthError: the truth is of other photographs, or there is too little to compare.
    """
    told: dict[str, Any] = metrics.evaluate_mask(on.stored.masks.object, on.truth.mask).as_dict()
    if on.truth.cam_from_world is not None:
        told |= metrics.evaluate_poses(on.stored.poses, on.truth.cam_from_world).as_dict()
    return Estimated(on.name, **{item.name: told.get(item.name) for item in fields(Estimated)[1:]})


def table(sets: Sequence[Estimated]) -> str:
    """Room and object as rows, and their mean."""
    lines = [["set", *(heading for heading, *_ in COLUMNS)]]
    lines += [[one.set] for one in sets] + [["mean"]]
    for _, name, factor, decimals in COLUMNS:
        values = [getattr(one, name) for one in sets]
        known = [value for value in values if value is not None]
        values.append(statistics.fmean(known) if known else None)
        for line, value in zip(lines[1:], values, strict=True):
            line.append(shown(None if value is None else factor * value, decimals))
    return markdown(lines)
