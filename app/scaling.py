"""What lengths mean that the window and the report show: by the scale bar that a person gave, or by what the poses tell."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from engine.errors import SurfaceError
from engine.scale_bar import factor_of, scaled
from engine.types import Poses, Surface


def fixed_scale(session: Path, surface: Surface | None, poses: Poses | None) -> tuple[float, str]:
    """The factor of a run's lengths and what fixes it (`engine.types.Poses.scale`); surface and poses are upright.

    A scale bar that does not determine this run's scale leaves it unknown: no export can be made with it either.

    Raises:
        SessionError: the scale bar's file is damaged.
    """
    if poses is None:
        return 1.0, "unknown"
    try:
        factor = None if surface is None else factor_of(session, surface, poses.camera)
    except SurfaceError:
        return 1.0, "unknown"
    return (1.0, poses.scale) if factor is None else (factor, "scale bar")


def rescaled(
    session: Path, surface: Surface | None, poses: Poses | None, *others: Any
) -> tuple[float, tuple[Any, ...]]:
    """The factor, and surface, poses and other records of a run with the lengths that are shown; None stays so."""
    by, fixed = fixed_scale(session, surface, poses)
    if poses is None or fixed == poses.scale:
        return by, (surface, poses, *others)
    placed = replace(scaled(poses, by), scale=fixed)
    return by, (scaled(surface, by), placed, *(scaled(record, by) for record in others))
