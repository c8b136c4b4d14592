"""The fit's benchmark judges the size that a target is for, and no other."""

import pytest

from tests.bench.fit import Row, Size, verdicts


def row(seconds: float = 299.0, peak_gb: float = 3.9, log_l1: float = 0.103) -> Row:
    return Row((6, 8, 6), 15_000, seconds, 2 * seconds, peak_gb, log_l1, 19)


@pytest.mark.parametrize(
    ("rows", "ends"),
    [
        ([row(), row(log_l1=0.1)], ["met", "met", "not measured here", "met"]),
        ([row(301, 4.1), row(log_l1=0.099)], ["MISSED", "MISSED", "not measured here", "MISSED"]),
    ],
)
def test_the_large_targets_are_judged_on_the_large_size(rows: list[Row], ends: list[str]) -> None:
    for said, end in zip(verdicts(Size(150, 512, 512), rows), ends, strict=True):
        assert said.endswith(end), said


def test_the_small_target_is_judged_on_the_small_size_alone() -> None:
    said = verdicts(Size(96, 176, 132), [row(61)])
    assert [line.endswith("not measured here") for line in said] == [True, True, False]
    assert said[2].endswith("measured 61 s: MISSED")
