"""Every parameter of every stage has its row in the table, and the table has no other rows."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import pytest

from app.parameters import MEANINGS, STAGES
from engine.pipeline import presets, stage_table
from engine.pipeline import settings as asked
from engine.surface.params import BOUNDS, OR_NONE
from tests.engine.test_validation import BOUNDED


def parameters(path: str, params: Any) -> Iterator[tuple[str, Any]]:
    for item in dataclasses.fields(params):
        value = getattr(params, item.name)
        if dataclasses.is_dataclass(value):
            yield from parameters(f"{path}.{item.name}", value)
        else:
            yield f"{path}.{item.name}", value


def of_all_stages() -> dict[str, Any]:
    return dict(entry for stage in stage_table.stages() for entry in parameters(stage.name, stage.defaults))


def test_the_table_and_the_stages_agree() -> None:
    assert sorted(MEANINGS) == sorted(of_all_stages())
    assert list(STAGES) == [stage.name for stage in stage_table.stages()]


def test_every_parameter_is_named_and_explained() -> None:
    for name, meaning in MEANINGS.items():
        assert meaning.label, name
        assert meaning.sense.endswith("."), name


def test_a_unit_in_a_name_is_the_unit_of_the_table() -> None:
    for name, meaning in MEANINGS.items():
        assert not name.endswith("_px") or meaning.unit == "px", name
        assert not name.endswith("_deg") or meaning.unit == "°", name
        assert not name.endswith("_share") or meaning.unit in ("share", "of the step predicted"), name


@pytest.mark.parametrize("preset", asked.PRESETS)
def test_defaults_and_presets_lie_within_what_the_window_offers(preset: str) -> None:
    for stage in stage_table.stages():
        params = asked.resolve(stage.name, stage.defaults, presets.of_stage(stage.name)[preset], {})
        for name, value in parameters(stage.name, params):
            if isinstance(value, int | float) and not isinstance(value, bool):
                assert MEANINGS[name].low <= value <= MEANINGS[name].high, name
            if MEANINGS[name].choices:
                assert value in MEANINGS[name].choices, name


def test_the_window_offers_no_less_of_the_surface_than_the_engine_takes() -> None:
    for name, (least, _) in BOUNDS.items():
        assert MEANINGS[f"surface.{name}"].low == (0 if name in OR_NONE else least), name


def test_the_window_offers_nothing_that_the_engine_refuses() -> None:
    for stage, params, bounds in BOUNDED:
        for name, (least, most) in bounds.items():
            meaning = MEANINGS.get(f"{stage}.{name}")
            if meaning is None or isinstance(getattr(params, name), tuple):
                continue  # the reference's, or a text that is read when it is entered
            assert meaning.low >= least, name
            assert meaning.high <= most, name
