import pytest

from hardware.errors import PositionLostError, RefusedError
from hardware.grbl import codes as grbl_codes
from hardware.grbl.codes import FLUIDNC, GRBL, GRBLHAL

FIRMWARES = (GRBL, GRBLHAL, FLUIDNC)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_every_error_of_the_manual_has_a_name_and_a_remedy(firmware: str):
    listed = grbl_codes.ERRORS[firmware]
    assert {*range(1, 18), *range(20, 39)} <= listed.keys()
    for number, code in listed.items():
        told = grbl_codes.error(number, "G1X5", "/dev/ttyUSB0", firmware)
        assert f"error:{number}, {code.name} (to 'G1X5'); {code.remedy}" in str(told)
        assert isinstance(told, PositionLostError if number in (9, 46) else RefusedError)
        assert code.name
        assert code.remedy


@pytest.mark.parametrize(("firmware", "most"), [(GRBL, 10), (GRBLHAL, 21), (FLUIDNC, 18)])
def test_every_alarm_of_the_manual_has_a_name_and_a_remedy_and_loses_the_position(firmware: str, most: int):
    assert sorted(grbl_codes.ALARMS[firmware]) == list(range(1, most + 1))
    for number, code in grbl_codes.ALARMS[firmware].items():
        told = grbl_codes.alarm(number, "/dev/ttyUSB0", firmware)
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
    assert all(word in grbl_codes.ERRORS[firmware][number].name for firmware in FIRMWARES)


@pytest.mark.parametrize(
    ("number", "word"),
    [(1, "hard limit"), (2, "soft limit"), (3, "reset"), (6, "reset"), (8, "pulling"), (9, "found")],
)
def test_alarms_are_those_of_the_manual(number: int, word: str):
    assert all(word in grbl_codes.ALARMS[firmware][number].name for firmware in FIRMWARES)


@pytest.mark.parametrize(
    ("firmware", "number", "said"),
    [
        (GRBL, 10, "dual axis"),
        (GRBLHAL, 10, "emergency stop"),
        (FLUIDNC, 10, "spindle"),
        (GRBLHAL, 11, "homing required"),
        (FLUIDNC, 11, "input pin"),
        (FLUIDNC, 14, "not homed"),
        (GRBLHAL, 14, "spindle"),
        (GRBLHAL, 18, "bad configuration"),
        (FLUIDNC, 18, "probe"),
        (GRBL, 11, "not in our list of GRBL's; look it up"),
        (FLUIDNC, 99, "not in our list of FluidNC's; look it up"),
    ],
)
def test_what_an_alarm_means_is_for_its_firmware_to_say(firmware: str, number: int, said: str):
    assert said in str(grbl_codes.alarm(number, "port", firmware))


@pytest.mark.parametrize(
    ("firmware", "number", "said"),
    [
        (GRBLHAL, 18, "reset input"),
        (FLUIDNC, 18, "no homing cycle"),
        (GRBL, 18, "not in our list of GRBL's"),
        (GRBLHAL, 50, "emergency stop"),
        (FLUIDNC, 152, "configuration is invalid"),
        (GRBLHAL, 199, "not in our list of grblHAL's"),
    ],
)
def test_what_an_error_means_is_for_its_firmware_to_say(firmware: str, number: int, said: str):
    assert said in str(grbl_codes.error(number, "$H", "port", firmware))
