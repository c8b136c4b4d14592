"""The plan of a session as the window holds it: stages, parameters, and what an edit makes of the settings.

No Qt, and none of the engine's rooms: the plan comes as plain values from the child that answers questions
(app/work/answers.py). Edits are values, `Settings` before and after, which is all that undo needs.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from app.parameters import MEANINGS, STAGES, Meaning
from engine.pipeline import settings as asked
from engine.pipeline.settings import Settings
from engine.results.quality import Quality


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a stage as it is set now."""

    name: str  # as `--set` takes it, "surface.directions"
    kind: str  # "int", "float", "bool", "str", "list", "words"; with "?" where None leaves it to the stage
    value: Any
    default: Any  # of the preset in force
    meaning: Meaning

    @property
    def changed(self) -> bool:
        return self.value != self.default


@dataclass(frozen=True, slots=True)
class Row:
    """One stage of the plan."""

    name: str
    done: bool
    given: bool
    reasons: tuple[str, ...]
    folder: str  # of its result
    took_s: float | None  # its latest run in this session
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """What the child answered."""

    settings: Settings
    rows: tuple[Row, ...]
    quality: Quality | None = None  # of the result that is up to date

    def parameter(self, name: str) -> Parameter | None:
        return next((p for row in self.rows for p in row.parameters if p.name == name), None)


def read_plan(content: Mapping[str, Any]) -> Plan:
    """The answer to the question "plan"."""
    rows = tuple(
        Row(
            stage["name"],
            stage["done"],
            stage["given"],
            tuple(stage["reasons"]),
            stage["folder"],
            stage["took_s"],
            tuple(_parameter(entry) for entry in stage["parameters"]),
        )
        for stage in content["stages"]
    )
    verdict = content.get("quality")
    return Plan(asked.from_toml(content["settings"]), rows, None if verdict is None else Quality(**verdict))


def _parameter(entry: Mapping[str, Any]) -> Parameter:
    name, kind = entry["name"], entry["kind"]
    value, default = (tuple(x) if isinstance(x, list) else x for x in (entry["value"], entry["default"]))
    # A stage that is newer than the table still shows all its parameters.
    words, choices = name.rpartition(".")[2].replace("_", " "), tuple(entry.get("choices", ()))
    meaning = MEANINGS.get(name, Meaning(words, "", "", low=-1e9, high=1e9, choices=choices))
    return Parameter(name, kind, value, default, meaning)


def with_value(settings: Settings, parameter: Parameter, value: Any) -> Settings:
    """The settings with one parameter changed; a value that is the default is not written down."""
    overrides: dict[str, Any] = copy.deepcopy(dict(settings.overrides))
    *path, last = parameter.name.split(".")
    tables: list[dict[str, Any]] = [overrides]
    for part in path:
        tables.append(tables[-1].setdefault(part, {}))
    if value == parameter.default:
        tables[-1].pop(last, None)
    elif value is None:
        tables[-1][last] = "auto"  # TOML has no null; the engine reads this word as None
    else:
        tables[-1][last] = list(value) if isinstance(value, tuple) else value
    for table, part in reversed(list(zip(tables, path, strict=False))):
        if not table[part]:
            del table[part]
    return replace(settings, overrides=overrides)


def with_preset(settings: Settings, preset: str) -> Settings:
    return replace(settings, preset=preset)


def with_seed(settings: Settings, seed: int) -> Settings:
    return replace(settings, seed=seed)


def without_changes(settings: Settings, stage: str | None = None) -> Settings:
    """Every parameter (of one stage) back to what the preset says."""
    if stage is None:
        return replace(settings, overrides={})
    return replace(
        settings, overrides={name: own for name, own in settings.overrides.items() if name != stage}
    )


def parse_list(text: str) -> tuple[int, ...] | None:
    """ "6, 8, 6" as numbers; None where it is no such list."""
    parts = [part.strip() for part in text.replace(";", ",").split(",") if part.strip()]
    if not parts or not all(part.isdigit() for part in parts):
        return None
    return tuple(int(part) for part in parts)


INPUTS = {"edits/strokes.png": "strokes", "edits/mask.png": "given mask", "edits/poses.json": "given poses"}
"""Inputs that are no stages, in words."""


def told_reason(reason: str, stage: str = "") -> str:
    """One reason of a stage's plan in the window's words: "directions of light 512 → 2048", "strokes changed"."""
    what, _, how = reason.partition(" ")
    if what == "input":
        what, _, how = how.partition(" ")
        if what == "shots:":  # so many added
            return how.replace(" ", " photographs ")
        title = STAGES[what][0].casefold() if what in STAGES else what.replace("shots/", "photograph ")
        return f"{INPUTS.get(what, title)} {how}"
    key = what.replace("params.", f"{stage}.")
    name = MEANINGS[key].label.casefold() if key in MEANINGS else what.removeprefix("params.")
    return f"{name} {how}".replace(" -> ", " → ")


def told_seconds(seconds: float) -> str:
    """ "8 s", "2 min 05 s", "1 h 12 min": as short as it is worth knowing."""
    if seconds < 9.95:
        return f"{seconds:.1f} s" if seconds < 0.95 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
