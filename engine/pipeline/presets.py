"""What draft, standard and fine mean: the parameters in which each differs from the stages' defaults."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

Preset = Mapping[str, Mapping[str, Any]]


def draft() -> Preset:
    """A first look: fewer views, and no second thoughts."""
    fewer = {
        "coarse_iterations": 3,
        "coarse_views": 24,
        "full_phase": False,
        "views": 32,
        "fine_iterations": 1,
        "probe_grid_xy": 2,
        "probe_grid_z": 2,
        "directions": 512,
    }
    return {"surface": fewer}


def standard() -> Preset:
    """The stages' own defaults: what the accuracy targets are measured with."""
    return {}


def fine() -> Preset:
    """What three solves agree on: where one ends in another place than the next, two of three are nearer the truth."""
    return {"surface": {"solves": 3}}


def of_stage(stage: str) -> dict[str, Mapping[str, Any]]:
    """Preset name -> what it changes in `stage`."""
    presets = {"draft": draft(), "standard": standard(), "fine": fine()}
    return {name: changes.get(stage, {}) for name, changes in presets.items()}


def of_reference() -> dict[str, Mapping[str, Any]]:
    """The same of the paper's solver: standard and fine are its published counts, draft is cut short and says so."""
    from engine.reference.params import ReferenceParams, scaled

    published, short = ReferenceParams(), replace(scaled(64, 25), emitter_share=0.1)
    changes = {
        item.name: getattr(short, item.name)
        for item in fields(short)
        if getattr(short, item.name) != getattr(published, item.name)
    }
    return {"draft": changes, "standard": {}, "fine": {}}
