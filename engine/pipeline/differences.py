"""How one run of a stage was asked otherwise than another: by its preset first, then by what was set besides.

A record keeps values, not the preset they came from: that is the one with which most of them agree.
"""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from engine.pipeline import artifacts
from engine.pipeline.settings import PRESETS, resolve

if TYPE_CHECKING:
    from engine.pipeline.stages import Stage

Params = Mapping[str, Any]  # as a record has them


def beside(stage: "Stage", preset: str, params: Params) -> dict[str, Any]:
    """The parameters, as dotted names, that are not as the preset has them."""
    meant = dotted(
        artifacts.plain(resolve(stage.name, stage.defaults, stage.presets.get(preset, {}), {}))
    ) | {"seed": 0}
    return {
        name: value
        for name, value in dotted(params).items()
        if name not in meant or value != meant[name]
    }  # fmt: skip


def preset_of(stage: "Stage", params: Params, likely: str = "standard") -> str:
    """The preset that `params` agree with most; `likely` where others agree as well."""
    return min((likely, *PRESETS), key=lambda preset: len(beside(stage, preset, params)))


def told(stage: "Stage", before: Params, now: Params, presets: tuple[str, str]) -> list[str]:
    """The parameters set otherwise, "params.directions 512 -> 2048", led by "preset draft -> fine" where that is why.

    Args:
        presets: of before and of now.
    """
    was, then = (dotted(params) for params in (before, now))
    set_besides = [beside(stage, preset, params) for preset, params in zip(presets, (was, then), strict=True)]
    names = set_besides[0].keys() | set_besides[1].keys() | (was.keys() ^ then.keys())
    changed = [name for name in was.keys() | then.keys() if was.get(name) != then.get(name)]
    found = [f"preset {presets[0]} -> {presets[1]}"] if set(changed) - names else []
    return found + [
        f"params.{name} {brief(was.get(name))} -> {brief(then.get(name))}"
        for name in sorted(names.intersection(changed))
    ]


def dotted(params: Mapping[str, Any]) -> dict[str, Any]:
    """Groups of parameters as dotted names."""
    flat: dict[str, Any] = {}
    for name, value in params.items():
        if isinstance(value, dict):
            flat |= {f"{name}.{inner}": item for inner, item in dotted(value).items()}
        else:
            flat[name] = value
    return flat


def brief(value: Any) -> str:
    """A parameter's value in a reason or a name."""
    return "unset" if value is None else value if isinstance(value, str) else json.dumps(value)
