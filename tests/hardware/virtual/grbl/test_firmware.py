"""The GRBL emulator against GRBL 1.1's documentation, byte for byte, in a time of its own."""

import math

import pytest

from hardware.interfaces import Angles
from hardware.virtual.grbl.dialects import FLUIDNC
from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.grbl.motion import Mechanics

RIG = {100: 100.0, 101: 100.0, 110: 3600.0, 111: 3600.0, 120: 200.0, 121: 200.0, 24: 300.0, 25: 1800.0}
HOMED = {**RIG, 21: 1, 22: 1, 23: 3, 130: 370.0, 131: 100.0}
ENDS = Mechanics((-185.0, -50.0, None), (185.0, 50.0, None))


class Device:
    """An emulator whose clock only runs when told."""

    def __init__(self, firmware: GrblFirmware | None = None):
        self.firmware = firmware or GrblFirmware(RIG)
        self.now = 100.0

    def tell(self, data: bytes, seconds: float = 0.0) -> list[str]:
        """Say something, let time pass, and return the lines that came."""
        self.firmware.receive(data, self.now)
        self.now += seconds
        return self.firmware.advance(self.now).decode().split("\r\n")[:-1]

    def report(self) -> dict[str, str]:
        """The status report by its fields; `state` is the first."""
        (line,) = self.tell(b"?")
        state, *fields = line.strip("<>").split("|")
        return {"state": state, **dict(field.split(":", 1) for field in fields)}


def booted(firmware: GrblFirmware | None = None) -> Device:
    device = Device(firmware)
    device.tell(b"")
    return device


# -- start, reset


def test_it_greets_when_it_gets_power():
    assert Device().tell(b"") == ["", "Grbl 1.1h ['$' for help]"]


def test_with_homing_it_starts_locked():
    device = Device(GrblFirmware(HOMED, ENDS))
    assert device.tell(b"") == ["", "Grbl 1.1h ['$' for help]", "[MSG:'$H'|'$X' to unlock]"]
    assert device.tell(b"G0X1\n") == ["error:9"]
    assert device.tell(b"$X\n") == ["[MSG:Caution: Unlocked]", "ok"]
    assert device.tell(b"G0X1\n") == ["ok"]


def test_fluidnc_greets_in_its_own_words():
    device = Device(GrblFirmware(HOMED, ENDS, dialect=FLUIDNC))
    assert device.tell(b"") == [
        "", "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]", "[MSG:INFO: '$H'|'$X' to unlock]",
    ]  # fmt: skip
    assert device.tell(b"$I\n")[0] == "[VER:3.7 FluidNC v3.7.8:]"


def test_a_reset_at_rest_keeps_the_position_and_forgets_the_modes():
    device = booted()
    device.tell(b"G91G20G1X1F100\n", 60.0)
    device.tell(b"G92X7\n")
    assert device.tell(b"\x18") == ["", "Grbl 1.1h ['$' for help]"]
    assert device.report()["MPos"] == "25.400,0.000,0.000"
    assert device.tell(b"$G\n")[0] == "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"
    assert device.tell(b"$#\n")[8] == "[G92:0.000,0.000,0.000]"


def test_a_reset_in_motion_is_alarm_3_and_stops_at_once():
    device = booted()
    device.tell(b"G1X100F3600\n", 1.0)
    stood = device.firmware.angles()
    assert device.tell(b"\x18") == ["ALARM:3"]
    assert device.tell(b"", 0.6) == ["", "Grbl 1.1h ['$' for help]", "[MSG:'$H'|'$X' to unlock]"]
    assert device.firmware.angles() == stood
    assert device.report()["state"] == "Alarm"


def test_brown_out_forgets_the_place_and_boots_slowly():
    device = booted()
    device.tell(b"G1X100F3600\n", 1.0)
    stood = device.firmware.angles().pan_deg
    device.firmware.brown_out(slip_deg=2.0)
    assert device.tell(b"?\n", 1.0) == []
    assert device.tell(b"", 1.0) == ["", "Grbl 1.1h ['$' for help]"]
    assert device.report()["MPos"] == "0.000,0.000,0.000"
    assert device.firmware.angles().pan_deg == pytest.approx(stood + 2.0)


# -- lines and bytes


def test_each_line_is_answered_once_also_empty_ones_and_comments():
    assert booted().tell(b"\n(nothing) ; at all\n  \r\n$G\n") == [
        "ok", "ok", "ok", "ok", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]", "ok",
    ]  # fmt: skip


def test_spaces_and_small_letters_do_not_matter():
    device = booted()
    device.tell(b"g1 x 1 0 f 3600 (to / ten)\n", 5.0)
    assert device.report()["MPos"] == "10.000,0.000,0.000"


def test_realtime_characters_are_picked_out_of_a_line():
    device = booted()
    said = device.tell(b"G1X?5F36~00\n", 5.0)
    assert said[0].startswith("<Idle|")
    assert said[1:] == ["ok"]
    assert device.report()["MPos"] == "5.000,0.000,0.000"


def test_characters_above_ascii_never_reach_a_line():
    device = booted()
    assert device.tell(b"G1\xfe\xa0X2F3600\n", 5.0) == ["ok"]
    assert device.report()["MPos"] == "2.000,0.000,0.000"


def test_too_long_a_line_is_error_11():
    assert booted().tell(b"G1X" + b"0" * 77 + b"\n") == ["error:11"]
    assert booted().tell(b"G1F100X" + b"0" * 72 + b"\n") == ["ok"]


def test_the_receive_buffer_holds_128_bytes_and_loses_the_rest():
    device = booted()
    device.tell(b"G4P1\n")
    said = device.tell(b"$G\n" * 60, 2.0)  # 180 bytes while it dwells
    assert said.count("ok") == 1 + 42  # 42 lines of 3 bytes, and 2 bytes of another, fit into 128
    assert device.tell(b"\n")[-1] == "ok"


# -- motion


def test_ok_means_queued_and_a_dwell_waits_for_the_end():
    device = booted()
    assert device.tell(b"G1X60F3600\nG4P0.01\n", 0.01) == ["ok"]
    assert device.report()["state"] == "Run"
    # 60 mm at 60 mm/s and 200 mm/s2: 1 s + 0.3 s; the dwell takes one slice of 50 ms
    assert device.tell(b"", 1.33) == []
    assert device.tell(b"", 0.02) == ["ok"]


def test_motion_follows_the_trapezoid():
    device = booted()
    device.tell(b"G1X60F3600\n")
    for seconds, place in ((0.1, 1.0), (0.2, 9.0), (0.7, 51.0), (0.2, 59.0), (0.1, 60.0)):
        device.tell(b"", seconds)
        assert device.firmware.angles().pan_deg == pytest.approx(place, abs=1e-6)


def test_rapids_run_at_the_rate_of_the_slowest_axis():
    device = booted(GrblFirmware({**RIG, 120: 1e6, 121: 1e6, 111: 60.0}))
    device.tell(b"G0X10Y10\n", 5.0)
    assert device.firmware.angles().tilt_deg == pytest.approx(5.0, abs=0.01)


def test_a_straight_line_in_pieces_is_run_without_stops():
    whole, pieces = booted(), booted()
    whole.tell(b"G1X50F3600\n", 0.9)
    pieces.tell(b"G1X10F3600\nX20\nX30\nX40\nX50\n", 0.9)
    assert pieces.firmware.angles().pan_deg == pytest.approx(whole.firmware.angles().pan_deg)


def test_turning_back_stops_in_between():
    device = booted()
    device.tell(b"G1X10F3600\nX0\n")
    places = []
    for _ in range(1500):
        device.tell(b"", 0.001)
        places.append(device.firmware.angles().pan_deg)
    assert max(places) == pytest.approx(10.0, abs=1e-3)
    assert device.firmware.angles().pan_deg == pytest.approx(0.0)


def test_the_planner_takes_fifteen_blocks_then_answers_wait():
    device = booted(GrblFirmware({**RIG, 10: 3}))
    said = device.tell(b"".join(b"G1X%dF60\n" % number for number in range(1, 15)), 0.001)
    assert said == ["ok"] * 14
    assert device.report()["Bf"] == "1,128"
    assert device.tell(b"X15\nX16\nX17\n") == ["ok"]
    assert len(device.tell(b"", 1.5)) == 1  # one block done, one taken


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        (b"G20G1X1F100\n", "25.400,0.000,0.000"),
        (b"G91G1X1F3600\nX1\n", "2.000,0.000,0.000"),
        (b"G10L20P1X5\nG1X6F3600\n", "1.000,0.000,0.000"),
        (b"G10L2P1X5\nG1X6F3600\n", "11.000,0.000,0.000"),
        (b"G92X5\nG1X6F3600\n", "1.000,0.000,0.000"),
        (b"G92X5\nG92.1\nG1X6F3600\n", "6.000,0.000,0.000"),
        (b"G10L2P1X5\nG53G1X6F3600\n", "6.000,0.000,0.000"),
        (b"G10L2P2X5\nG55G1X6F3600\n", "11.000,0.000,0.000"),
        (b"G1X3F3600\nG28.1\nX9\nG28\n", "3.000,0.000,0.000"),
        (b"G1X3Y3F3600\nG28.1\nX9Y9\nG28X10\n", "3.000,9.000,0.000"),
        (b"G93G1X6F60\n", "6.000,0.000,0.000"),
        (b"G43.1Z4\nG1Z1F500\n", "0.000,0.000,5.000"),
        (b"G2X2Y0I1J0F3600\n", "2.000,0.000,0.000"),
        (b"G18G3X2Z0R1F500\n", "2.000,0.000,0.000"),
        (b"M3S500\nM8\nG1X1F3600\nM5M9\n", "1.000,0.000,0.000"),
        (b"N10 T3 G0 X4 Y-2\n", "4.000,-2.000,0.000"),
    ],
)
def test_lines_lead_where_rs274_says(lines: bytes, place: str):
    device = booted()
    assert set(device.tell(lines, 120.0)) == {"ok"}
    assert device.report()["MPos"] == place


def test_an_arc_keeps_its_radius():
    device = booted()
    device.tell(b"G2X20Y0I10J0F3600\n")
    for _ in range(20):
        device.tell(b"", 0.03)
        angles = device.firmware.angles()
        if angles.pan_deg > 0.01:
            assert math.hypot(angles.pan_deg - 10.0, angles.tilt_deg) == pytest.approx(10.0, abs=0.02)
            assert angles.tilt_deg > 0


def test_numbers_are_single_precision():
    device = booted(GrblFirmware({**RIG, 100: 1000.0, 110: 1e9, 120: 1e9}))
    device.tell(b"G0X36000.001\n", 60.0)
    assert device.report()["MPos"].split(",")[0] == "36000.000"


# -- hold, resume, jog, overrides


def test_hold_brakes_then_waits_and_resume_finishes():
    device = booted()
    device.tell(b"G1X60F3600\n", 0.6)
    device.tell(b"!")
    assert device.report()["state"] == "Hold:1"
    device.tell(b"", 0.31)
    assert device.report()["state"] == "Hold:0"
    # 27 mm had gone by; braking from 60 mm/s takes 9 mm
    assert device.firmware.angles().pan_deg == pytest.approx(36.0, abs=1e-6)
    device.tell(b"", 5.0)
    assert device.firmware.angles().pan_deg == pytest.approx(36.0, abs=1e-6)
    device.tell(b"~", 2.0)
    assert device.report() == {**device.report(), "state": "Idle", "MPos": "60.000,0.000,0.000"}


def test_resume_while_still_braking_is_not_heard():
    device = booted()
    device.tell(b"G1X60F3600\n", 0.5)
    device.tell(b"!~", 1.0)
    assert device.report()["state"] == "Hold:0"


def test_settings_during_hold_are_told_after_resume():
    device = booted()
    device.tell(b"G1X60F3600\n", 0.5)
    device.tell(b"!", 1.0)
    assert device.tell(b"$$\n", 5.0) == []
    assert device.tell(b"~", 0.01) == ["error:8"]  # it runs again by then, and $$ wants rest


def test_a_reset_in_a_finished_hold_keeps_the_position():
    device = booted()
    device.tell(b"G1X60F3600\nX0\n", 0.5)
    device.tell(b"!", 1.0)
    place = device.report()["MPos"]
    assert device.tell(b"\x18", 5.0) == ["", "Grbl 1.1h ['$' for help]"]
    report = device.report()
    assert (report["state"], report["MPos"]) == ("Idle", place)


def test_a_reset_in_an_unfinished_hold_is_alarm_3():
    device = booted()
    device.tell(b"G1X60F3600\n", 0.5)
    device.tell(b"!", 0.05)
    assert device.tell(b"\x18")[0] == "ALARM:3"


def test_a_jog_ends_at_its_cancel_and_locks_g_code_meanwhile():
    device = booted()
    assert device.tell(b"$J=G91X100F3600\n", 0.5) == ["ok"]
    assert device.report()["state"] == "Jog"
    assert device.tell(b"G1X1F100\n") == ["error:9"]
    device.tell(b"\x85", 1.0)
    report = device.report()
    assert report["state"] == "Idle"
    assert 0 < float(report["MPos"].split(",")[0]) < 100
    assert device.tell(b"$G\n")[0] == "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"


def test_a_feed_hold_cancels_a_jog_too():
    device = booted()
    device.tell(b"$J=X100F3600\n", 0.5)
    device.tell(b"!", 1.0)
    assert device.report()["state"] == "Idle"


def test_jog_cancel_outside_a_jog_does_nothing():
    device = booted()
    device.tell(b"G1X6F3600\n", 0.05)
    device.tell(b"\x85", 5.0)
    assert device.report()["MPos"] == "6.000,0.000,0.000"


def test_a_feed_override_slows_the_motion_down():
    device = booted(GrblFirmware({**RIG, 120: 1e6}))
    device.tell(b"\x92" * 5)  # -50 %
    device.tell(b"G1X60F3600\n", 1.0)
    assert device.firmware.angles().pan_deg == pytest.approx(30.0, abs=0.1)
    device.report()
    assert device.report()["Ov"] == "50,100,100"


def test_the_door_holds_and_opens_again():
    device = booted()
    device.tell(b"G1X60F3600\n", 0.5)
    assert device.tell(b"\x84") == ["[MSG:Check Door]"]
    assert device.report()["state"] == "Door:2"
    device.tell(b"", 1.0)
    assert device.report()["state"] == "Door:0"
    device.tell(b"~", 5.0)
    assert device.report()["MPos"] == "60.000,0.000,0.000"


# -- reports


def test_offset_and_overrides_are_told_now_and_then():
    device = booted()
    told = [set(device.report()) - {"state", "MPos", "FS"} for _ in range(31)]
    assert [index for index, fields in enumerate(told) if "WCO" in fields] == [0, 10, 20, 30]
    assert [index for index, fields in enumerate(told) if "Ov" in fields] == [1, 11, 21]
    device.tell(b"G1X1000F3600\n", 1.0)
    told = [set(device.report()) for _ in range(70)]
    gaps = [index for index, fields in enumerate(told) if "WCO" in fields]
    assert gaps[1] - gaps[0] == 30


def test_a_new_offset_is_told_at_once():
    device = booted()
    device.report()
    device.tell(b"G92X3\n")
    assert device.report()["WCO"] == "-3.000,0.000,0.000"


@pytest.mark.parametrize(
    ("mask", "fields"),
    [(0, {"WPos": "-5.000,0.000,0.000"}), (1, {"MPos": "0.000,0.000,0.000"}), (3, {"Bf": "15,128"})],
)
def test_the_mask_chooses_what_is_reported(mask: int, fields: dict[str, str]):
    device = booted()
    device.tell(b"$10=%d\nG10L2P1X5\n" % mask)
    report = device.report()
    assert {key: report.get(key) for key in fields} == fields
    assert ("Bf" in report) == bool(mask & 2)


def test_reports_in_inches_have_four_decimals():
    device = booted()
    device.tell(b"$13=1\nG1X25.4F3600\n", 5.0)
    assert device.report()["MPos"] == "1.0000,0.0000,0.0000"


def test_two_queries_before_an_answer_are_answered_once():
    device = booted()
    device.tell(b"G92X1")
    firmware = device.firmware
    firmware.receive(b"$H\n", device.now)  # refused; the line before it is complete
    assert (
        len([line for line in device.tell(b"??") if line.startswith("<")]) == 2
    )  # each was answered in time
    homing = booted(GrblFirmware(HOMED, ENDS))
    homing.tell(b"$H\n", 0.1)
    assert homing.tell(b"???", 0.1) == []  # GRBL is deaf to `?` while homing
    said = homing.tell(b"", 60.0)
    assert [line[:5] for line in said] == ["<Home", "ok"]


def test_pressed_switches_are_reported():
    device = booted(GrblFirmware(RIG, Mechanics((-1.0, None, None), (5.0, 5.0, None))))
    device.tell(b"G1X6F3600\n", 5.0)
    assert device.report()["Pn"] == "X"
    device.tell(b"G1Y6F3600\n", 5.0)
    assert device.report()["Pn"] == "XY"


# -- homing, limits


def test_homing_finds_both_switches_and_pulls_off():
    device = booted(GrblFirmware(HOMED, ENDS))
    said = device.tell(b"$H\n", 120.0)
    assert said == ["ok"]
    report = device.report()
    assert (report["state"], report["MPos"]) == ("Idle", "-369.000,-99.000,0.000")
    assert device.firmware.angles().pan_deg == pytest.approx(-184.0, abs=1e-6)
    assert device.firmware.angles().tilt_deg == pytest.approx(-49.0, abs=1e-6)


def test_homing_towards_the_other_end():
    device = booted(GrblFirmware({**HOMED, 23: 0}, ENDS))
    device.tell(b"$H\n", 120.0)
    assert device.report()["MPos"] == "-1.000,-1.000,0.000"
    assert device.firmware.angles().pan_deg == pytest.approx(184.0, abs=1e-6)


def test_homing_takes_the_time_of_its_rates():
    device = booted(GrblFirmware({**HOMED, 22: 1}, Mechanics((-30.0, 0.0, None), (None,) * 3), homes=(0,)))
    # 30 mm at 30 mm/s: 1 s and 0.075 s of acceleration
    device.tell(b"$H\n", 1.0)
    assert device.firmware.angles().pan_deg > -30.0
    device.tell(b"", 0.1)
    assert device.firmware.angles().pan_deg == pytest.approx(-30.0, abs=1e-6)
    assert device.tell(b"", 0.5) == []


def test_homing_without_a_switch_is_alarm_9():
    device = booted(GrblFirmware(HOMED))
    assert device.tell(b"$H\n", 60.0)[0] == "ALARM:9"


def test_homing_whose_switch_stays_pressed_is_alarm_8():
    device = booted(GrblFirmware(HOMED, Mechanics((5.0, 5.0, None), (None,) * 3)))
    assert device.tell(b"$H\n", 60.0)[0] == "ALARM:8"


def test_a_reset_while_homing_is_alarm_6():
    device = booted(GrblFirmware(HOMED, ENDS))
    device.tell(b"$H\n", 1.0)
    assert device.tell(b"!", 0.1) == []  # only a reset is heard
    stood = device.firmware.angles()
    assert device.tell(b"\x18")[0] == "ALARM:6"
    device.tell(b"", 5.0)
    assert device.firmware.angles().pan_deg == pytest.approx(stood.pan_deg, abs=0.01)


def test_homing_that_is_off_is_error_5():
    assert booted().tell(b"$H\n") == ["error:5"]


def test_a_limit_switch_in_motion_is_alarm_1_and_silence_until_reset():
    device = booted(GrblFirmware({**RIG, 21: 1}, ENDS))
    said = device.tell(b"G1X300F3600\n", 60.0)
    assert said == ["ok", "ALARM:1", "[MSG:Reset to continue]"]
    assert device.firmware.angles().pan_deg == pytest.approx(185.0, abs=1e-6)
    assert device.tell(b"?$X\n$G\n", 5.0) == []
    assert device.tell(b"\x18") == [
        "", "Grbl 1.1h ['$' for help]", "[MSG:Check Limits]", "[MSG:'$H'|'$X' to unlock]",
    ]  # fmt: skip


def test_fluidnc_tells_its_state_after_a_limit():
    device = booted(GrblFirmware({**RIG, 21: 1}, ENDS, dialect=FLUIDNC))
    device.tell(b"G1X300F3600\n", 60.0)
    assert device.report()["state"] == "Alarm"


def test_a_target_beyond_the_soft_limits_is_alarm_2_and_keeps_the_place():
    device = booted(GrblFirmware({**HOMED, 20: 1}, ENDS))
    device.tell(b"$H\n", 120.0)
    device.tell(b"G1X-100Y-50F3600\nG4P0\n", 20.0)
    assert device.tell(b"G1X1\n", 2.0) == ["ALARM:2", "[MSG:Reset to continue]"]
    assert device.tell(b"?") == []
    device.tell(b"\x18")
    report = device.report()
    assert (report["state"], report["MPos"]) == ("Alarm", "-100.000,-50.000,0.000")


def test_beyond_the_soft_limits_in_motion_it_brakes_first():
    device = booted(GrblFirmware({**HOMED, 20: 1}, ENDS))
    device.tell(b"$H\n", 120.0)
    device.tell(b"G1X-100Y-50F3600\n", 1.0)
    assert device.tell(b"G1X1\n") == []
    assert device.tell(b"", 2.0)[0] == "ALARM:2"
    device.tell(b"\x18")
    place = float(device.report()["MPos"].split(",")[0])
    truth = device.firmware.angles().pan_deg
    assert place - truth == pytest.approx(-185.0, abs=0.011)  # no step was lost


# -- settings and other $ commands


def test_settings_are_printed_as_in_the_manual():
    lines = booted(GrblFirmware()).tell(b"$$\n")
    assert lines[:3] == ["$0=10", "$1=25", "$2=0"]
    assert {"$11=0.010", "$12=0.002", "$24=25.000", "$30=1000", "$100=250.000", "$132=200.000"} <= set(lines)
    assert lines[-1] == "ok"
    assert len(lines) == 35


def test_settings_are_stored_and_kept_through_a_reset():
    device = booted()
    assert device.tell(b"$110=1234.5\n") == ["ok"]
    device.tell(b"\x18")
    assert "$110=1234.500" in device.tell(b"$$\n")
    device.firmware.brown_out()
    device.tell(b"", 3.0)
    assert "$110=1234.500" in device.tell(b"$$\n")
    assert device.tell(b"$RST=$\n")[:2] == ["[MSG:Restoring defaults]", "ok"]
    assert "$110=3600.000" in device.tell(b"$$\n")


def test_help_build_and_startup_lines():
    device = booted()
    assert device.tell(b"$\n") == [
        "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]", "ok",
    ]  # fmt: skip
    assert device.tell(b"$I\n") == ["[VER:1.1h.20190825:]", "[OPT:V,15,128]", "ok"]
    assert device.tell(b"$N0=G20\n") == ["ok"]
    assert device.tell(b"$N\n") == ["$N0=G20", "$N1=", "ok"]
    assert device.tell(b"\x18") == ["", "Grbl 1.1h ['$' for help]", ">G20:ok"]


def test_offsets_survive_a_reset():
    device = booted()
    device.tell(b"G10L2P1X5\n")
    device.tell(b"\x18")
    assert device.tell(b"$#\n") == [
        "[G54:5.000,0.000,0.000]", *(f"[G{number}:0.000,0.000,0.000]" for number in (55, 56, 57, 58, 59, 28, 30, 92)),
        "[TLO:0.000]", "[PRB:0.000,0.000,0.000:0]", "ok",
    ]  # fmt: skip


def test_check_mode_moves_nothing_and_resets_when_left():
    device = booted()
    assert device.tell(b"$C\n") == ["[MSG:Enabled]", "ok"]
    assert device.tell(b"G1X5F100\n", 5.0) == ["ok"]
    assert device.report()["MPos"] == "0.000,0.000,0.000"
    assert device.tell(b"$C\n") == ["[MSG:Disabled]", "ok", "", "Grbl 1.1h ['$' for help]"]


def test_sleep_ends_only_by_a_reset_and_locks():
    device = booted()
    assert device.tell(b"$SLP\n") == ["ok", "[MSG:Sleeping]"]
    assert device.report()["state"] == "Sleep"
    assert device.tell(b"$X\n", 1.0) == []
    assert device.tell(b"\x18")[-1] == "[MSG:'$H'|'$X' to unlock]"


def test_the_end_of_a_program_restores_modes():
    device = booted()
    assert device.tell(b"G91G20G55\nM2\n") == ["ok", "[MSG:Pgm End]", "ok"]
    assert device.tell(b"$G\n")[0].startswith("[GC:G1 G54 G17 G20 G90 G94 M5 M9")


def test_a_program_pause_waits_for_resume():
    device = booted()
    assert device.tell(b"M0\nG1X1F3600\n", 5.0) == []
    assert device.report()["state"] == "Hold:0"
    assert device.tell(b"~", 1.0) == ["ok", "ok"]


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"1X5", 1), (b"G1X", 2), (b"G1X--5", 2), (b"$Q", 2), (b"$GX", 3), (b"$999=1", 3), (b"$11", 3), (b"G1X5F-3", 4),
        (b"$100=-1", 4), (b"$H", 5), (b"$0=2", 6), (b"$20=1", 10), (b"$J=X5F100M3", 16), (b"$J=G1X5F100", 16),
        (b"$J=G10L2P1X5F1", 16), (b"$JX5", 3), (b"G5", 20), (b"A5", 20), (b"M6", 20), (b"G38.1X1", 20),
        (b"G10L3P1X1", 20), (b"G90.1", 20), (b"G0G1X5", 24), (b"G20G21", 21), (b"M3M5", 21), (b"G90G91", 21),
        (b"G1X5", 22), (b"G93G1X5", 22), (b"$J=X5", 22), (b"G1.5X2", 23), (b"M3.5", 23), (b"G1G92X5", 24),
        (b"G43.1G1Z5", 24), (b"G1X5X6F1", 25), (b"G10L2P1", 26), (b"G92", 26), (b"G2I1F10", 26), (b"N10000002G0", 27),
        (b"G4", 28), (b"G10X1", 28), (b"G10L2P7X1", 29), (b"G80G53", 30), (b"G80X1", 31), (b"G17G2Z1I1F10", 32),
        (b"G2X1Y0I5F10", 33), (b"G38.2X0F10", 33), (b"G2X5R1F10", 34), (b"G2X5K1F10", 35), (b"G1X5F10I4", 36),
        (b"G0S3P3", 36), (b"G43.1X1", 37), (b"T256", 38),
    ],
)  # fmt: skip
def test_errors_are_those_of_the_manual(line: bytes, code: int):
    device = booted()
    assert device.tell(line + b"\n", 1.0) == [f"error:{code}"]
    assert device.firmware.angles() == Angles(0.0, 0.0)


def test_errors_of_states_and_options():
    running = booted()
    running.tell(b"G1X100F3600\n", 0.1)
    assert running.tell(b"$$\n$#\n$H\n$J=X1F1\n") == ["error:8"] * 4
    limited = booted(GrblFirmware({**HOMED, 20: 1}, ENDS))
    limited.tell(b"$H\n", 120.0)
    assert limited.tell(b"$J=X5F100\n") == ["error:15"]
    assert limited.report()["state"] == "Idle"
    fast = booted(GrblFirmware(RIG, step_rate_hz=30_000.0))
    assert fast.tell(b"$100=1000\n") == ["error:12"]
    for code in (7, 13, 14, 17):
        fast.firmware.refuse_next(code)
        assert fast.tell(b"$G\n") == [f"error:{code}"]


# -- mechanics


def test_a_stalled_motor_stays_where_it_is_and_grbl_counts_on():
    device = booted()
    device.firmware.stall(0)
    device.tell(b"G1X10Y10F3600\n", 5.0)
    assert device.report()["MPos"] == "10.000,10.000,0.000"
    assert device.firmware.angles() == Angles(0.0, pytest.approx(10.0))
    device.firmware.stall(0, False)
    device.tell(b"G1X20\n", 5.0)
    assert device.firmware.angles().pan_deg == pytest.approx(10.0)


def test_gears_lag_on_the_way_down():
    device = booted(GrblFirmware(RIG, Mechanics(play=(0.5, 0.0, 0.0))))
    for target, stands in ((10.0, 10.0), (5.0, 5.5), (4.8, 5.3), (5.0, 5.3), (5.4, 5.4)):
        device.tell(b"G1X%.1fF3600\n" % target, 5.0)
        assert device.firmware.angles().pan_deg == pytest.approx(stands)


def test_time_in_big_and_small_steps_is_the_same():
    coarse, fine = booted(), booted()
    for device in (coarse, fine):
        device.tell(b"G1X10F3600\nY5\nG4P0.2\nX0Y0\n")
    said = coarse.tell(b"", 1.0)
    fine_said = [line for _ in range(1000) for line in fine.tell(b"", 0.001)]
    assert fine_said == said
    assert fine.firmware.angles().pan_deg == pytest.approx(coarse.firmware.angles().pan_deg, abs=1e-6)
