"""Exposures find their bracket; what belongs to none is named, and poses are never mixed."""

import math
import random
from pathlib import Path

import pytest

from engine.errors import ImportFault
from engine.hdr.brackets import Grouping, Taken, group, note
from engine.io.raw import Facts


def taken(evs: list[float], times: list[float] | None = None) -> list[Taken]:
    return [
        Taken(
            Path(f"IMG_{i}.CR3"),
            Facts("camera", 10, 8, 2.0**ev, 100.0, math.nan, times[i] if times else math.nan, 0),
        )
        for i, ev in enumerate(evs)
    ]


def names(grouping: Grouping) -> list[list[str]]:
    return [[item.path.stem for item in items] for items in grouping.brackets]


def poses_of(grouping: Grouping, size: int) -> list[set[int]]:
    """The poses that each bracket's files were taken at, where file i is of pose i // size."""
    return [{int(item.path.stem[4:]) // size for item in items} for items in grouping.brackets]


def clock(count: int, size: int, inside_s: float = 1.0, between_s: float = 20.0) -> list[float]:
    return [
        1000.25 + (i // size) * (between_s + inside_s * size) + inside_s * (i % size) for i in range(count)
    ]


@pytest.mark.parametrize(
    ("pattern", "views"),
    [((0.0,), 9), ((-3.0, 0.0, 3.0), 8), ((0.0, -2.0, 2.0), 9), ((-4, -2, 0, 2, 4), 8), ((0, 3), 4)],
)
def test_a_repeating_pattern_is_found(pattern: tuple[float, ...], views: int) -> None:
    brackets = group(taken(list(pattern) * views), None).brackets
    assert len(brackets) == views
    assert all(len(items) == len(pattern) for items in brackets)


def test_a_camera_that_meters_each_view_anew_still_shows_its_bracket() -> None:
    rng = random.Random(1)
    bases = [rng.uniform(-3, 3) for _ in range(10)]
    evs = [base + step + rng.uniform(-0.05, 0.05) for base in bases for step in (0, -3, 3)]
    assert [len(items) for items in group(taken(evs), None).brackets] == [3] * 10


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
@pytest.mark.parametrize(
    "missing", [(0,), (1,), (2,), (13,), (29,), (0, 28, 29), (13, 15), (13, 14, 15), (0, 1, 14)]
)
@pytest.mark.parametrize("order", [(-3, 0, 3), (0, -3, 3), (0, 3, -3), (3, 0, -3)])
def test_where_exposures_are_lost_times_keep_poses_apart(
    order: tuple[int, ...], missing: tuple[int, ...], size: int | None
) -> None:
    files = taken(list(order) * 10, clock(30, 3))
    found = group([item for i, item in enumerate(files) if i not in missing], size)
    broken = {i // 3 for i in missing}
    assert poses_of(found, 3) == [{pose} for pose in range(10) if pose not in broken]
    left = {f"IMG_{i}.CR3" for i in range(30) if i // 3 in broken and i not in missing}
    assert {item.path.name for item in found.left_out} == left
    assert all(name in note(found) for name in left)


def test_a_clock_of_whole_seconds_and_five_exposures_are_told_apart_as_well() -> None:
    files = taken([-10, -8, -6, -4, -2] * 9, [float(int(t)) for t in clock(45, 5, 0.4, 6.0)])
    found = group(files[1:-4], None)
    assert poses_of(found, 5) == [{pose} for pose in range(1, 8)]
    assert len(found.left_out) == 5


def test_brackets_that_times_speak_against_are_refused() -> None:
    """Times and shutters contradict one another: these exposures take longer than lies between the files."""
    files = taken([0, 2, 4] * 10, clock(30, 3, 0.4, 6.0))
    with pytest.raises(
        ImportFault, match=r"by their exposures IMG_1\.CR3, IMG_2\.CR3 and IMG_3\.CR3 are one"
    ):
        group(files[1:-2], None)


def test_long_exposures_count_as_exposures_and_not_as_pauses() -> None:
    shutters = [0.1 * 2.0**ev for ev in (-3, 0, 6)]
    times, now = [], 1000.25
    for i in range(30):
        times.append(now)
        now += shutters[i % 3] + (9.0 if i % 3 == 2 else 0.3)
    files = [
        Taken(Path(f"IMG_{i}.CR3"), Facts("c", 10, 8, shutters[i % 3], 100.0, math.nan, time_s, 0))
        for i, time_s in enumerate(times)
    ]
    assert poses_of(group(files[1:-2], None), 3) == [{pose} for pose in range(1, 9)]


@pytest.mark.parametrize(
    "times", [None, [1000.0 + 5 * i for i in range(30)]], ids=["no times", "interval timer"]
)
@pytest.mark.parametrize("missing", [0, 29])
def test_two_ways_to_fit_are_refused_where_times_do_not_tell(missing: int, times: list[float] | None) -> None:
    files = taken([-3.0, 0.0, 3.0] * 10, times)
    del files[missing]
    with pytest.raises(
        ImportFault, match=r"fit in two ways.*either IMG_.* belong to no whole bracket, or IMG_.*; remove"
    ):
        group(files, None)


def test_equal_exposures_with_one_too_many_are_refused_where_times_do_not_tell() -> None:
    with pytest.raises(ImportFault, match="two ways"):
        group(taken([0.0] * 13), 3)
    found = group(taken([0.0] * 15, clock(15, 3))[1:], 3)
    assert poses_of(found, 3) == [{pose} for pose in range(1, 5)]


def test_exposure_compensation_changed_on_the_way_breaks_no_bracket() -> None:
    evs = [base + step for base in [0.0] * 4 + [1.0] * 5 for step in (0, -2, 2)]
    assert names(group(taken(evs), None))[4] == ["IMG_12", "IMG_13", "IMG_14"]


def test_a_lone_extra_exposure_is_named() -> None:
    found = group(taken([0.0, -3.0, 3.0] * 4 + [0.0] + [0.0, -3.0, 3.0] * 4), None)
    assert note(found) == "IMG_12.CR3 belongs to no whole bracket of 3 exposures and is left out."
    assert len(found.brackets) == 8


def test_a_pattern_that_explains_less_than_half_is_none() -> None:
    with pytest.raises(ImportFault, match="do not repeat every 3 files"):
        group(taken([0.0, -3.0, 3.0, 1.0, 5.0, 2.0, 7.0, 7.5, -1.0, 4.0]), 3)


def test_exposures_without_a_pattern_ask_for_the_bracket_size() -> None:
    rng = random.Random(3)
    with pytest.raises(ImportFault, match="--bracket N"):
        group(taken([rng.uniform(-5, 5) for _ in range(20)]), None)


def test_the_person_may_say_that_equal_exposures_are_one_view() -> None:
    assert [len(items) for items in group(taken([0.0] * 12), 3).brackets] == [3] * 4
    assert [len(items) for items in group(taken([0.0, -2.0] * 6), 1).brackets] == [1] * 12
