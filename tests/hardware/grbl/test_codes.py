import pytest

from hardware.errors import PositionLostError, RefusedError
from hardware.grbl import codes as grbl_codes


def test_every_error_of_the_manual_has_a_name_and_a_remedy():
    assert sorted(grbl_codes.ERRORS) == list(range(1, 39))
    for number, code in grbl_codes.ERRORS.items():
        told = grbl_codes.error(number, "G1X5", "/dev/ttyUSB0")
        assert f"error:{number}, {code.name} (to 'G1X5'); {code.remedy}" in str(told)
        assert code.name
        assert code.remedy


def test_every_alarm_of_the_manual_has_a_name_and_a_remedy_and_loses_the_position():
    assert sorted(grbl_codes.ALARMS) == list(range(1, 19))
    for number, code in grbl_codes.ALARMS.items():
        told = grbl_codes.alarm(number, "/dev/ttyUSB0")
        assert isinstance(told, PositionLostError)
        assert f"ALARM:{number}, {code.name}; {code.remedy}" in str(told)


@pytest.mark.parametrize(
    ("number", "word"),
    [
        (1, "command letter"),
        (5, "homing is switched off"),
        (11, "too long"),
        (15, "travel"),
        (33, "target"),
        (38, "tool"),
    ],
)
def test_errors_are_those_of_the_manual(number: int, word: str):
    assert word in grbl_codes.ERRORS[number].name


@pytest.mark.parametrize(
    ("number", "word"),
    [(1, "hard limit"), (2, "soft limit"), (3, "reset"), (6, "reset"), (8, "pulling"), (9, "found")],
)
def test_alarms_are_those_of_the_manual(number: int, word: str):
    assert word in grbl_codes.ALARMS[number].name


def test_only_the_lock_asks_for_homing():
    for number in grbl_codes.ERRORS:
        told = grbl_codes.error(number, "", "")
        assert isinstance(told, PositionLostError if number == 9 else RefusedError)


def test_numbers_of_a_later_firmware_are_told_too():
    assert "error:79" in str(grbl_codes.error(79, "$H", "port"))
    assert "ALARM:99" in str(grbl_codes.alarm(99, "port"))
