"""What a scene needs is known from how it is made; what the solver says of it is held against that, and the cheapest rung is chosen."""

from dataclasses import replace
from pathlib import Path

import pytest

from app.bench import choices, economy
from app.bench.economy import SCENES, Found, choice
from app.bench.measured import Row
from app.bench.record import BenchError
from engine.surface.uncertainty.model_parts import PartWorth
from hardware.virtual.studio import bodies, rooms
from tests.app.bench.synthetic import a_set, leaning, method


def rung(key: str, seconds: float, by_view: tuple[float, ...], *worths: PartWorth) -> Row:
    return Row(
        a_set(), method(key, 1.0, seconds), leaning(1.0), seconds, False, "run", by_view[0], by_view, worths
    )


DRAFT = rung(
    "draft", 10, (0.050, 0.060, 0.050),
    PartWorth("light by place", 0.02, 0.001), PartWorth("visibility", 0.001, 0.002),
    PartWorth("interreflection", 0.0004, 0.0001),
)  # fmt: skip
BETTER = rung("standard", 30, (0.049, 0.063, 0.046))  # by less than what that differs by from view to view
CHEAP = rung("far_light", 5, (0.070, 0.081, 0.070))


def found(name: str, *rungs: Row) -> Found:
    return Found(name, rungs, tuple(range(1, len(rungs) + 1)))


def test_the_quickest_rung_within_a_standard_error_of_the_best_is_chosen():
    assert choice([DRAFT, BETTER, CHEAP]) == 0
    sure = replace(BETTER, by_view=(0.040, 0.050, 0.041))
    assert choice([DRAFT, sure, CHEAP]) == 1
    assert choice([DRAFT, BETTER, replace(CHEAP, by_view=DRAFT.by_view)]) == 2


def test_a_part_is_needed_where_it_is_worth_more_than_its_standard_error_and_something():
    assert economy.needed(DRAFT, "light by place") == (0.02, 0.001, True)
    assert economy.needed(DRAFT, "visibility") == (0.001, 0.002, False)
    assert economy.needed(DRAFT, "interreflection") == (
        0.0004,
        0.0001,
        False,
    )  # a hundredth of the error that is left
    assert economy.needed(DRAFT, "gloss") == (0.0, 0.0, False)  # the answer has none
    assert economy.right([found("near_lamp", DRAFT)]) == [True] * 5
    assert economy.right([found("far_room", DRAFT)]) == [False, True, True, True, True]


def test_table_metrics_and_chart_say_where_solver_and_scene_disagree(tmp_path: Path):
    both = [found("near_lamp", DRAFT, BETTER), found("far_room", DRAFT, BETTER)]
    lines = economy.table(both).splitlines()
    assert "2.00 ± 0.10 needed |" in lines[2]
    assert "2.00 ± 0.10 needed, WRONG |" in lines[3]
    assert lines[-1] == "9 of 10 as the scene is made"
    (chosen,) = [line for line in economy.ladder(both[0]).splitlines() if "chosen" in line]
    assert "ours, draft" in chosen
    metrics = {metric.key: metric for metric in economy.as_metrics(both)}
    assert metrics["economy/right"].value == 0.9
    assert metrics["far_room/light_by_place/worth"].value == 0.02
    assert metrics["near_lamp/standard/normal"].value == 2
    paths = economy.write(both, tmp_path, "two scenes")
    assert [path.name for path in paths] == ["economy.png", "economy.svg", "economy.csv"]
    assert len(paths[2].read_text().splitlines()) == 5
    assert "two scenes" in paths[1].read_text()


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_the_studio_has_every_scene(scene: economy.Scene):
    rooms.furnish(scene.room)
    bodies.stand(bodies.Thing(scene.thing, material=scene.material), 0)
    assert set(scene.needs) <= set(economy.PARTS)


def test_a_scene_that_is_none_is_refused_with_those_there_are():
    assert choices.picked("--scenes", (), SCENES) == tuple(SCENES)
    with pytest.raises(BenchError, match="none called 'cave'; choose of far_room"):
        choices.picked("--scenes", ("cave",), SCENES)
