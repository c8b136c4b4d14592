import pytest

from hardware.camera import values
from hardware.errors import SettingsError


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        ("1/250", 0.004), ("0.3", 0.3), ("2", 2.0), ("0.0100s", 0.01), ("10/13", 10 / 13), ("1/1.3", 1 / 1.3), ('30"', 30.0),
        ("1/8000", 1 / 8000), ("bulb", None), ("Bulb", None), ("Time", None), ("auto", None), ("x 200", None), ("", None),
        ("0", None), ("1/0", None), ("Unknown value 0013", None),
    ],
)  # fmt: skip
def test_shutters_are_seconds(choice, expected):
    assert values.seconds(choice) == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(
    ("choice", "expected"), [("8", 8.0), ("f/5.6", 5.6), ("F2", 2.0), ("implicit auto", None), ("0", None), ("Unknown value 0f00", None)]
)  # fmt: skip
def test_apertures_are_f_numbers(choice, expected):
    assert values.f_number(choice) == expected


@pytest.mark.parametrize(("choice", "expected"), [("100", 100), ("ISO 6400", 6400), ("Auto", None), ("L", None), ("0", None)])  # fmt: skip
def test_isos_are_numbers(choice, expected):
    assert values.iso(choice) == expected


@pytest.mark.parametrize(
    ("choice", "expected"), [("off", None), ("+/- 1/3", 1 / 3), ("+/- 2", 2.0), ("+/- 2 2/3", 2 + 2 / 3), ("+/- ", None)]
)  # fmt: skip
def test_brackets_are_stops(choice, expected):
    assert values.bracket_ev(choice) == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(("text", "expected"), [("75%", 0.75), ("Low", 0.05), ("100 %", 1.0), ("Unknown value 0006", None), ("", None)])  # fmt: skip
def test_batteries_are_shares(text, expected):
    assert values.battery(text) == expected


THIRDS = [2.0 ** (k / 3) for k in range(-39, 16)]


def test_the_nearest_offered_value_is_nearest_in_stops():
    assert values.nearest(0.0115, [0.005, 0.01, 0.02], "x") == 0.01
    assert values.nearest(7.1, [5.6, 8.0], "x", 2.0) == 8.0
    for asked in (1 / 60, 0.3, 20.0, 1 / 7999):
        assert abs(values.nearest(asked, THIRDS, "x") / asked - 1) < 0.13


@pytest.mark.parametrize("asked", [0.5, 1 / 200, 40.0])
def test_what_is_beyond_the_ends_is_refused_and_the_ends_are_named(asked):
    with pytest.raises(SettingsError, match=r"shutter of X.*1/100 to 0\.25"):
        values.nearest(asked, [0.01, 0.02, 0.25], "shutter of X")


def test_a_nominal_end_still_counts_as_the_end():
    assert values.nearest(32.0, [15.0, 30.0], "x") == 30.0


def test_nothing_is_near_in_a_wide_gap():
    with pytest.raises(SettingsError):
        values.nearest(0.0004, [0.0001, 0.0012], "x")


def test_shutters_are_told_as_people_write_them():
    assert [values.told(value) for value in (1 / 8000, 1 / 60, 0.5, 2.0)] == ["1/8000", "1/60", "0.5", "2"]
