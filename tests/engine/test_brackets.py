"""Exposures find their bracket, and a bracket that lacks one is named."""

import math
import random
from pathlib import Path

import pytest

from engine.brackets import Taken, group
from engine.errors import ImportFault
from engine.raw import Facts


def taken(evs: list[float], times: list[float] | None = None) -> list[Taken]:
    return [
        Taken(
            Path(f"IMG_{i}.CR3"),
            Facts("camera", 10, 8, 2.0**ev, 100.0, math.nan, times[i] if times else math.nan, 0),
        )
        for i, ev in enumerate(evs)
    ]


def names(brackets: list[tuple[Taken, ...]]) -> list[list[str]]:
    return [[item.path.stem for item in items] for items in brackets]


@pytest.mark.parametrize(
    ("pattern", "views"),
    [((0.0,), 9), ((-3.0, 0.0, 3.0), 8), ((0.0, -2.0, 2.0), 9), ((-4, -2, 0, 2, 4), 8), ((0, 3), 4)],
)
def test_a_repeating_pattern_is_found(pattern: tuple[float, ...], views: int) -> None:
    brackets = group(taken(list(pattern) * views), None)
    assert len(brackets) == views
    assert all(len(items) == len(pattern) for items in brackets)


def test_a_camera_that_meters_each_view_anew_still_shows_its_bracket() -> None:
    rng = random.Random(1)
    bases = [rng.uniform(-3, 3) for _ in range(10)]
    evs = [base + step + rng.uniform(-0.05, 0.05) for base in bases for step in (0, -3, 3)]
    assert [len(items) for items in group(taken(evs), None)] == [3] * 10


def test_time_goes_before_the_name_when_the_counter_rolls_over() -> None:
    files = [
        Taken(Path(f"IMG_{number:04d}.CR3"), Facts("c", 10, 8, 2.0**ev, 100.0, math.nan, 1000.0 + i, 0))
        for i, (number, ev) in enumerate(zip([9998, 9999, 1, 2, 3, 4], [0, -3, 3] * 2, strict=True))
    ]
    assert names(group(files[::-1], None)) == [
        ["IMG_9998", "IMG_9999", "IMG_0001"],
        ["IMG_0002", "IMG_0003", "IMG_0004"],
    ]


def test_img_9_comes_before_img_10_without_times() -> None:
    brackets = group(taken([-3.0, 0.0, 3.0] * 5), 3)
    assert names(brackets)[3] == ["IMG_9", "IMG_10", "IMG_11"]


@pytest.mark.parametrize("size", [None, 3])
@pytest.mark.parametrize("missing", [0, 1, 2, 12, 13, 14, 27, 28, 29])
def test_a_bracket_that_lacks_an_exposure_is_named(missing: int, size: int | None) -> None:
    files = taken([0.0, -3.0, 3.0] * 10, [1000.0 + 20 * (i // 3) + i % 3 for i in range(30)])
    broken = {f"IMG_{i}" for i in range(missing - missing % 3, missing - missing % 3 + 3) if i != missing}
    del files[missing]
    with pytest.raises(ImportFault, match="incomplete bracket") as fault:
        group(files, size)
    assert Path(str(fault.value).split(":")[0]).stem in broken


def test_a_lone_extra_exposure_is_named() -> None:
    files = taken([0.0, -3.0, 3.0] * 4 + [0.0] + [0.0, -3.0, 3.0] * 4)
    with pytest.raises(ImportFault, match="IMG_12"):
        group(files, None)


def test_exposures_without_a_pattern_ask_for_the_bracket_size() -> None:
    rng = random.Random(3)
    with pytest.raises(ImportFault, match="--bracket N"):
        group(taken([rng.uniform(-5, 5) for _ in range(20)]), None)


def test_the_person_may_say_that_equal_exposures_are_one_view() -> None:
    assert [len(items) for items in group(taken([0.0] * 12), 3)] == [3] * 4
    assert [len(items) for items in group(taken([0.0, -2.0] * 6), 1)] == [1] * 12
