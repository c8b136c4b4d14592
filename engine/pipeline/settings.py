"""What the user asked: a preset, a solver, a seed, and single parameters; read from `params.toml` and the command line.

Every value is checked against the stage's parameter dataclass, so a misspelt name or a word where a number
belongs is refused before any work starts.
"""

import copy
import dataclasses
import difflib
import re
import tomllib
import types
import typing
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from engine.errors import SessionError

PRESETS = ("draft", "standard", "fine")
AUTO = "auto"
"""No preset of its own: `process` climbs them as far as they pay."""
SOLVERS = ("transport", "reference")
"""Ours, and the paper's as published."""
REMOVED = {
    "light.degree": "the room's light is the same from every side",
    "surface.horizons": "the depth says what hides the room",
    "surface.steps": "the pass place_parts places the parts of the depth",
    "surface.deepen": "the pass place_parts places the parts of the depth",
    "surface.ask": "every pixel is solved by its own photographs",
    "surface.follow_depth": "light reaches points where the depth has them",
    "surface.accord": "the schedule's pass regularize always runs",
    "surface.gloss": "the schedule's pass expect_roughness always runs",
}
"""Parameters that were, and what holds without them. A params.toml from then still opens, with a note."""

RENAMED = {
    "segment": {"pull": "unary_limit", "evidence": "unary_weight", "least_score": "min_contrast"},
    "light": {
        "budget": "max_gaussians", "width": "max_image_width", "passes": "epochs", "holdout": "validation_every",
        "keep_out": "camera_clearance", "hollow": "opacity_weight",
    },
    "surface": {
        "together": "tile_above_pixels", "rough_rounds": "coarse_iterations", "rough_views": "coarse_views",
        "full_turn": "full_phase", "rounds": "fine_iterations", "passes": "gauss_newton_steps",
        "candidates": "normal_candidates", "probes_across": "probe_grid_xy", "probes_deep": "probe_grid_z",
        "probe_face_px": "probe_resolution", "full_diffuse": "diffuse", "relight_groups": "light_groups",
        "relight_prior": "light_gain_sigma", "held_out": "validation_views", "start_maps": "initial_normals",
        "start_roughness": "initial_roughness", "start_frame": "normals_frame",
    },
}  # fmt: skip
"""Parameters of each stage by earlier names, which are still taken, with a note."""
SWITCHES = {
    "visibility": ("self_shadowing",), "bounce": ("interreflections",), "walls": ("hidden_surfaces",),
    "rim": ("mixed_pixels",), "robust": ("robust_loss",), "relight": ("light_gains",),
    "exposure_drift": ("view_exposures",), "lamp_shift": ("lamp_directions",),
    "material": ("detect_metal", "classify_material"),
}  # fmt: skip
"""Of the surface, those that said what its model leaves out by being off; `surface.without` says it now."""


@dataclass(frozen=True, slots=True)
class Settings:
    """`overrides` maps stage -> parameter -> value as the user wrote it; `notes` say what of it was left out."""

    preset: str = "standard"
    seed: int = 0
    overrides: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    solver: str = "transport"  # of the surface
    notes: tuple[str, ...] = field(default=(), compare=False)


def from_toml(content: Mapping[str, Any], where: str = "params.toml") -> Settings:
    """Read the top level of `params.toml`; the stages' tables are checked by `resolve`."""
    preset = content.get("preset", "standard")
    if preset not in PRESETS:
        raise SessionError(f"{where}: preset {preset!r} is unknown; choose {', '.join(PRESETS)}")
    solver = content.get("solver", "transport")
    if solver not in SOLVERS:
        raise SessionError(f"{where}: solver {solver!r} is unknown; choose {', '.join(SOLVERS)}")
    seed = content.get("seed", 0)
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise SessionError(f"{where}: seed must be a whole number >= 0, not {seed!r}")
    overrides = {key: value for key, value in content.items() if key not in ("preset", "seed", "solver")}
    for key, value in overrides.items():
        if not isinstance(value, dict):
            raise SessionError(f"{where}: {key!r} is unknown; write it in its stage's table, as [stage]")
    notes = []
    for name, now in REMOVED.items():
        stage, parameter = name.split(".")
        if parameter in overrides.get(stage, {}):
            overrides[stage] = {key: value for key, value in overrides[stage].items() if key != parameter}
            notes.append(f"{where}: {name} is left out, for it was removed: {now}")
    for stage, table in overrides.items():
        overrides[stage] = renamed(stage, table)
        known = {
            **RENAMED.get(stage, {}),
            **(dict.fromkeys(SWITCHES, "without") if stage == "surface" else {}),
        }
        notes += [
            f"{where}: {stage}.{was} is called {stage}.{name} now; the old name is taken until the next release"
            for was, name in known.items()
            if was in table
        ]
    return Settings(preset, seed, overrides, solver, tuple(notes))


def renamed(stage: str, params: Mapping[str, Any]) -> dict[str, Any]:
    """A stage's parameters by their names of today, as the last release wrote them into params.toml and records."""
    switches = SWITCHES.keys() & params.keys() if stage == "surface" else set()
    now = {name: value for name, value in params.items() if name not in switches}
    for was, name in RENAMED.get(stage, {}).items():
        if was in now:
            value = now.pop(was)
            if was == "full_diffuse" and isinstance(value, bool):
                value = "disney" if value else "lambert"
            now.setdefault(name, value)
    if switches:
        # Given once more, as a batch does that goes on, they change nothing.
        before, named = now.get("without", ()), {part for was in switches for part in SWITCHES[was]}
        before = before.split(",") if isinstance(before, str) else before
        off = [part for was, parts in SWITCHES.items() if params.get(was) is False for part in parts]
        now["without"] = [part.strip() for part in before if part.strip() not in named] + off
    return now


def to_toml(settings: Settings) -> dict[str, Any]:
    tables = {stage: dict(values) for stage, values in settings.overrides.items() if values}
    # Ours goes without saying, as in every params.toml from before there was a choice.
    chosen = {} if settings.solver == Settings().solver else {"solver": settings.solver}
    return {"preset": settings.preset, "seed": settings.seed, **chosen, **tables}


def with_changes(
    settings: Settings,
    preset: str | None,
    seed: int | None,
    assignments: Sequence[str],
    solver: str | None = None,
    files: Collection[str] = (),
) -> Settings:
    """The settings after the command line's `--preset`, `--seed`, `--solver` and `--set stage.param=value`.

    Another solver has other parameters: what was set of the surface falls away with the old one. Those of `files`
    name files, which are kept as absolute paths: the next command may be given in another folder.
    """
    overrides = copy.deepcopy(dict(settings.overrides))
    if solver not in (None, settings.solver):
        overrides.pop("surface", None)
    for text in assignments:
        name, equals, value = text.partition("=")
        *path, parameter = name.strip().split(".")
        if not (equals and path and all(path) and parameter):
            raise SessionError(f"--set {text}: write it as stage.param=value, as in surface.directions=2048")
        if name.strip() in REMOVED:
            raise SessionError(
                f"--set {text}: {name.strip()} was removed: {REMOVED[name.strip()]}; leave it out"
            )
        table = overrides
        for part in path:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise SessionError(f"--set {text}: {part} is one value, not a group of parameters")
        parsed = _parse(value.strip())
        table[parameter] = _absolute(parsed) if name.strip() in files else parsed
    changed = from_toml(
        {
            "preset": settings.preset if preset is None else preset,
            "seed": settings.seed if seed is None else seed,
            "solver": settings.solver if solver is None else solver,
            **overrides,
        },
        "command line",
    )
    return dataclasses.replace(changed, notes=settings.notes + changed.notes)


def _parse(text: str) -> Any:
    """A TOML value, a number as people write it (.5, 1.), or the bare word itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return float(text) if re.fullmatch(r"[+-]?(\d+\.|\.\d+)([eE][+-]?\d+)?", text) else text


def _absolute(file: Any) -> Any:
    """A file's absolute path; no file stays none."""
    return str(Path(str(file)).absolute()) if file else file


def check_stages(settings: Settings, stages: Sequence[str]) -> None:
    """Refuse a table for a stage that does not exist."""
    for stage in settings.overrides:
        if stage not in stages:
            raise SessionError(
                f"there is no stage {stage!r}{_close(stage, stages)}; stages: {', '.join(stages)}"
            )


def resolve(stage: str, defaults: Any, preset: Mapping[str, Any], overrides: Mapping[str, Any]) -> Any:
    """The stage's parameters: its defaults, changed by the preset, changed by the user.

    A parameter that is itself a group of parameters takes a table, `poses.mapping.name` on the command line.

    Raises:
        SessionError: an unknown parameter, or a value of the wrong kind.
    """
    hints = typing.get_type_hints(type(defaults))
    names = [item.name for item in dataclasses.fields(defaults)]
    changes = {}
    for name, value in {**preset, **overrides}.items():
        if name not in names:
            raise SessionError(
                f"stage {stage} has no parameter {name!r}{_close(name, names)}; it has: {', '.join(names)}"
            )
        group = getattr(defaults, name)
        if dataclasses.is_dataclass(group) and not isinstance(group, type) and isinstance(value, Mapping):
            changes[name] = resolve(f"{stage}.{name}", group, preset.get(name, {}), overrides.get(name, {}))
        else:
            changes[name] = _coerce(value, hints[name], f"{stage}.{name}")
    return dataclasses.replace(defaults, **changes)


def _close(name: str, known: Sequence[str]) -> str:
    match = difflib.get_close_matches(name, known, 1)
    return f" (did you mean {match[0]!r}?)" if match else ""


def _coerce(value: Any, hint: Any, where: str) -> Any:
    """`value` as the annotation wants it; 2 is a fine float, "2" is not a number."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None or (value in ("none", "auto") and type(None) in args and str not in args):
            return None
        for arg in args:
            if arg is not type(None):
                try:
                    return _coerce(value, arg, where)
                except SessionError:
                    continue
    elif origin is typing.Literal:
        if value in args:
            return value
        raise SessionError(f"{where}: {value!r} is unknown; choose {', '.join(map(str, args))}")
    elif hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    elif origin is tuple and str in args and isinstance(value, str):
        return tuple(word.strip() for word in value.split(",") if word.strip())
    elif origin is tuple and isinstance(value, list | tuple):
        inner = [args[0]] * len(value) if args[-1] is Ellipsis else list(args)
        if len(inner) == len(value):
            return tuple(_coerce(item, kind, where) for item, kind in zip(value, inner, strict=True))
    elif (isinstance(hint, type) and type(value) is hint) or hint is Any:
        return value
    wanted = hint.__name__ if isinstance(hint, type) else str(hint)
    raise SessionError(f"{where}: {value!r} is not a value for it; it takes {wanted}")
