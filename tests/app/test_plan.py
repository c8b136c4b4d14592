"""Edits are values: they touch one parameter, disappear when they say what the preset says, and can be undone."""

import dataclasses

import pytest

from app import plan as plans
from app.parameters import MEANINGS, Meaning
from app.plan import Parameter, Plan, read_plan
from engine.pipeline.settings import Settings, resolve
from engine.sfm.params import PoseParams


def parameter(name: str = "surface.directions", kind: str = "int", value=2048, default=2048) -> Parameter:
    return Parameter(name, kind, value, default, MEANINGS.get(name, Meaning("", "", "")))


def test_a_change_is_written_and_the_default_is_not() -> None:
    changed = plans.with_value(Settings(), parameter(), 4096)
    assert changed.overrides == {"surface": {"directions": 4096}}
    assert plans.with_value(changed, parameter(value=4096), 2048).overrides == {}


def test_a_change_leaves_the_others_and_the_original_alone() -> None:
    before = Settings("fine", 3, {"surface": {"gauss_newton_steps": 9}, "light": {"max_gaussians": 10}})
    after = plans.with_value(before, parameter(), 4096)
    assert after == Settings(
        "fine", 3, {"surface": {"gauss_newton_steps": 9, "directions": 4096}, "light": {"max_gaussians": 10}}
    )
    assert before.overrides == {"surface": {"gauss_newton_steps": 9}, "light": {"max_gaussians": 10}}


def test_a_parameter_in_a_group_is_written_where_the_engine_reads_it() -> None:
    settings = plans.with_value(Settings(), parameter("poses.mapping.match_ratio", "float", 0.8, 0.8), 0.7)
    made = resolve("poses", PoseParams(), {}, settings.overrides["poses"])
    assert made.mapping.match_ratio == 0.7
    assert (
        plans.with_value(settings, parameter("poses.mapping.match_ratio", "float", 0.7, 0.8), 0.8).overrides
        == {}
    )


def test_nothing_is_left_to_the_stage_with_a_word_toml_has() -> None:
    from engine.light.fitting.params import LightParams

    given = parameter("light.camera_clearance", "float?", 0.3, 0.2)
    settings = plans.with_value(Settings(), given, None)
    assert resolve("light", LightParams(), {}, settings.overrides["light"]).camera_clearance is None


def test_lists_are_written_as_toml_has_them() -> None:
    settings = plans.with_value(Settings(), parameter("light.epochs", "list", (6, 8, 6), (6, 8, 6)), (1, 2))
    assert settings.overrides == {"light": {"epochs": [1, 2]}}


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("6, 8,6", (6, 8, 6)), ("4", (4,)), ("", None), ("6, x", None), ("-1", None), ("1.5", None)],
)
def test_lists_are_read_as_people_write_them(text: str, numbers: tuple[int, ...] | None) -> None:
    assert plans.parse_list(text) == numbers


def test_presets_seeds_and_resets_touch_what_they_say() -> None:
    settings = Settings("standard", 0, {"surface": {"gauss_newton_steps": 9}, "light": {"max_gaussians": 10}})
    assert plans.with_preset(settings, "draft") == dataclasses.replace(settings, preset="draft")
    assert plans.with_seed(settings, 7).seed == 7
    assert plans.without_changes(settings, "surface").overrides == {"light": {"max_gaussians": 10}}
    assert plans.without_changes(settings).overrides == {}


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (0.24, "0.2 s"),
        (8.2, "8 s"),
        (59.4, "59 s"),
        (59.6, "1 min 00 s"),
        (125, "2 min 05 s"),
        (4325, "1 h 12 min"),
    ],
)
def test_times_are_as_short_as_they_are_worth_knowing(seconds: float, told: str) -> None:
    assert plans.told_seconds(seconds) == told


@pytest.mark.parametrize(
    ("reason", "told"),
    [
        ("params.directions 512 -> 2048", "directions of light 512 → 2048"),
        ("params.brand_new 1 -> 2", "brand_new 1 → 2"),
        ("surface.directions 512 -> 2048", "directions of light 512 → 2048"),
        ("preset standard -> draft", "preset standard → draft"),
        ("input segment changed", "mask changed"),
        ("input edits/strokes.png added", "strokes added"),
        ("input shots: 5 added", "5 photographs added"),
        ("input shots/0003 removed", "photograph 0003 removed"),
        ("the stage's method is new (version 1 -> 2)", "the stage's method is new (version 1 → 2)"),
    ],
)
def test_reasons_are_told_in_the_windows_words(reason: str, told: str) -> None:
    assert plans.told_reason(reason, "surface") == told


def test_a_parameter_the_table_does_not_know_is_shown_all_the_same() -> None:
    entry = {"name": "surface.brand_new", "kind": "int", "value": 3, "default": 2}
    stage = {
        "name": "surface", "done": False, "given": False, "reasons": ["never ran"], "folder": "/x", "took_s": None,
        "seeded": True, "inputs": [], "parameters": [entry],
    }  # fmt: skip
    plan: Plan = read_plan({"settings": {}, "stages": [stage]})
    found = plan.parameter("surface.brand_new")
    assert found is not None
    assert found.meaning.label == "brand new"
    assert found.changed
