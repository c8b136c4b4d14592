from dataclasses import replace

import pytest

from hardware.virtual.zaber.axis import Stage, legs
from hardware.virtual.zaber.firmware import BOOT_S, Chain, ZaberFirmware
from hardware.zaber.messages import checksum

SLOW = Stage(1e5, fastest_deg_s=10.0, accel_deg_s2=10.0)
STAGE = replace(SLOW, lowest_deg=-5000.0, highest_deg=5000.0, stands_deg=20.0)
ENDED = replace(SLOW, lowest_deg=-30.0, highest_deg=30.0)


class Bench:
    """A firmware and the time; `say` speaks to it, `run` lets time pass in small steps."""

    def __init__(self, firmware: ZaberFirmware | Chain):
        self.firmware, self.now = firmware, 100.0
        self.firmware.advance(self.now)

    def say(self, text: str) -> list[str]:
        self.firmware.receive(text.encode() + b"\n", self.now)
        return self.hear()

    def hear(self) -> list[str]:
        said = self.firmware.advance(self.now).decode()
        assert said == "" or said.endswith("\r\n")
        return said.split("\r\n")[:-1]

    def run(self, seconds: float) -> list[str]:
        said = []
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            said += self.hear()
        return said

    def homed(self) -> "Bench":
        self.say("/1 home")
        self.run(20)
        assert self.say("/1 warnings") == ["@01 0 OK IDLE -- 00"]
        return self


@pytest.fixture
def bench() -> Bench:
    return Bench(ZaberFirmware([STAGE, ENDED]))


def test_an_empty_command_to_all_is_answered_with_the_worst_flag(bench: Bench):
    assert bench.say("/") == ["@01 0 OK IDLE WR 0"]


def test_the_answer_carries_the_message_id_and_the_axis(bench: Bench):
    assert bench.say("/1 2 09") == ["@01 2 09 OK IDLE WR 0"]
    assert bench.say("/1 2 9") == ["@01 2 09 OK IDLE WR 0"]


def test_an_id_of_two_dashes_wants_no_answer(bench: Bench):
    assert bench.say("/1 0 -- home") == []
    assert bench.say("/1") == ["@01 0 OK BUSY WR 0"]


def test_other_addresses_are_not_answered(bench: Bench):
    assert bench.say("/2 get pos") == []


def test_a_right_checksum_is_obeyed_and_a_wrong_one_ignored(bench: Bench):
    body = b"1 1 09 get resolution"
    assert bench.say(f"/{body.decode()}:{checksum(body)}") == ["@01 1 09 OK IDLE WR 64"]
    assert bench.say(f"/{body.decode()}:00") == []


def test_answers_carry_checksums_once_asked_to(bench: Bench):
    assert bench.say("/1 0 05 set comm.checksum 1") == [
        f"@01 0 05 OK IDLE WR 0:{checksum(b'01 0 05 OK IDLE WR 0')}"
    ]


def test_both_axes_answer_for_the_device(bench: Bench):
    assert bench.say("/1 0 01 get limit.max") == ["@01 0 01 OK IDLE WR 500000000 3000000"]


@pytest.mark.parametrize(
    ("command", "reason"),
    [("/1 nonsense", "BADCOMMAND"), ("/1 get nonsense", "BADCOMMAND"), ("/1 set version 8", "BADCOMMAND"),
     ("/1 3 get pos", "BADAXIS"), ("/1 1 get deviceid", "DEVICEONLY"), ("/1 1 renumber 4", "DEVICEONLY"),
     ("/1 2 move abs 3000001", "BADDATA"), ("/1 2 move abs x", "BADDATA"), ("/1 2 move abs", "BADDATA"),
     ("/1 2 move abs 1 2", "BADDATA"), ("/1 2 move sideways 5", "BADCOMMAND"), ("/1 0 100", "BADMESSAGEID"),
     ("/1 set comm.address 100", "BADDATA"), ("/1 1 set resolution 0", "BADDATA")],
)  # fmt: skip
def test_what_it_cannot_do_is_rejected_by_name(bench: Bench, command: str, reason: str):
    (reply,) = bench.say(command)
    assert " RJ " in reply
    assert reply.endswith(reason)


def test_a_move_takes_the_time_a_trapezoid_takes(bench: Bench):
    """20 degrees at 10 deg/s and 10 deg/s^2: 1 s up, 1 s at full speed, 1 s down."""
    bench.homed().say("/1 1 move abs 2000000")
    bench.run(0.5)
    assert bench.firmware.angles().pan_deg == pytest.approx(0.5 * 10 * 0.5**2, abs=0.06)
    bench.run(1.0)
    assert bench.firmware.angles().pan_deg == pytest.approx(10.0, abs=0.11)
    assert bench.say("/1 1 get pos")[0].startswith("@01 1 OK BUSY -- ")
    bench.run(1.45)
    assert bench.say("/1 1")[0] == "@01 1 OK BUSY -- 0"
    bench.run(0.1)
    assert bench.say("/1 1 get pos") == ["@01 1 OK IDLE -- 2000000"]
    assert bench.firmware.angles().pan_deg == 20.0


def test_homing_finds_the_true_zero_and_clears_the_reference_flags(bench: Bench):
    assert bench.firmware.angles().pan_deg == 20.0
    assert bench.say("/1 1 get pos") == ["@01 1 OK IDLE WR 0"]
    assert bench.say("/1 warnings") == ["@01 0 OK IDLE WR 02 WR WH"]
    bench.homed()
    assert bench.firmware.angles().pan_deg == 0.0
    assert bench.say("/1 get pos") == ["@01 0 OK IDLE -- 0 0"]


def test_a_move_before_homing_goes_from_a_wrong_zero(bench: Bench):
    bench.say("/1 1 move abs 500000")
    bench.run(5)
    assert bench.say("/1 1 get pos") == ["@01 1 OK IDLE WR 500000"]
    assert bench.firmware.angles().pan_deg == pytest.approx(25.0)


def test_stop_brakes_and_leaves_the_interrupted_flag(bench: Bench):
    bench.homed().say("/1 1 move abs 5000000")
    bench.run(2)
    assert bench.say("/1 1 stop") == ["@01 1 OK BUSY NI 0"]
    bench.run(0.9)
    assert bench.say("/1 1") == ["@01 1 OK BUSY NI 0"]
    bench.run(0.2)
    assert bench.say("/1 1") == ["@01 1 OK IDLE NI 0"]
    assert bench.firmware.angles().pan_deg == pytest.approx(20.0, abs=0.1)
    assert bench.say("/1 1 warnings clear") == ["@01 1 OK IDLE -- 01 NI"]


def test_estop_stops_on_the_spot(bench: Bench):
    bench.homed().say("/1 1 move abs 5000000")
    bench.run(2)
    stands = bench.firmware.angles()
    assert bench.say("/1 0 estop") == ["@01 0 OK IDLE NI 0"]
    bench.run(1)
    assert bench.firmware.angles() == stands


def test_a_new_target_on_the_way_is_reached_without_a_jump(bench: Bench):
    bench.homed().say("/1 1 move abs 5000000")
    bench.run(2)
    bench.say("/1 1 move abs -500000")
    before = bench.firmware.angles().pan_deg
    for _ in range(900):
        bench.run(0.01)
        after = bench.firmware.angles().pan_deg
        assert abs(after - before) <= 10 * 0.01 + 1e-6
        before = after
    assert bench.say("/1 1 get pos")[0].endswith(" -500000")


def test_move_vel_runs_to_the_limit_and_stops_there(bench: Bench):
    bench.homed().say("/1 2 move vel 819200")  # 500 000 microsteps/s
    bench.run(2)
    assert bench.firmware.angles().tilt_deg == pytest.approx(5 * 2 - 5 * 0.25, abs=0.1)
    bench.run(10)
    assert bench.say("/1 2 get pos") == ["@01 2 OK IDLE -- 3000000"]


@pytest.mark.parametrize("speed", [-3.0, -0.5, 0.0, 0.5, 3.0, 7.0])
@pytest.mark.parametrize("distance", [-9.0, -0.1, 0.0, 0.1, 2.0, 50.0])
def test_every_plan_of_speeds_covers_its_distance_and_ends_at_rest(distance: float, speed: float):
    position, rate = 0.0, speed
    for seconds, accel in legs(distance, speed, 4.0, 2.0):
        assert seconds > 0
        position += rate * seconds + accel * seconds**2 / 2
        rate += accel * seconds
    assert position == pytest.approx(distance, abs=1e-9)
    assert rate == pytest.approx(0.0, abs=1e-9)


def test_a_stall_ends_the_motion_and_the_count_is_wrong(bench: Bench):
    bench.homed().say("/1 1 move abs 2000000")
    bench.run(1.5)
    bench.firmware.stall(1)
    bench.run(0.02)
    assert bench.say("/1 1 warnings") == ["@01 1 OK IDLE FS 01 FS"]
    count = float(bench.say("/1 1 get pos")[0].split()[-1])
    assert abs(count / 1e5 - bench.firmware.angles().pan_deg) > 0.1
    bench.say("/1 warnings clear")
    bench.homed()
    assert bench.firmware.angles().pan_deg == 0.0


def test_a_stall_ahead_waits_for_the_next_motion(bench: Bench):
    bench.homed()
    bench.firmware.stall(2)
    bench.run(0.1)
    assert bench.say("/1 2 warnings") == ["@01 2 OK IDLE -- 00"]
    bench.say("/1 2 move abs 100000")
    bench.run(1)
    assert bench.say("/1 2 warnings") == ["@01 2 OK IDLE FS 01 FS"]


def test_the_wall_behind_a_limit_stalls_a_stage_that_lost_its_place():
    bench = Bench(ZaberFirmware([ENDED]))
    bench.firmware.axes[0].slip = 2_500_000.0
    bench.say("/1 1 move abs 3000000")
    bench.run(10)
    assert bench.say("/1 1 warnings") == ["@01 1 OK IDLE FS 03 FS WR WH"]
    assert bench.firmware.angles().pan_deg == pytest.approx(35.0)


def test_a_brown_out_is_silent_and_loses_the_reference_but_not_the_place(bench: Bench):
    bench.homed().say("/1 1 move abs 2000000")
    bench.run(1.5)
    stands = bench.firmware.angles()
    bench.firmware.brown_out()
    assert bench.say("/1") == []
    bench.run(BOOT_S + 0.1)
    assert bench.say("/1 1 get pos") == ["@01 1 OK IDLE WR 0"]
    assert bench.firmware.angles() == stands


def test_the_red_button_takes_the_current_until_released_and_enabled(bench: Bench):
    bench.homed().say("/1 1 move abs 2000000")
    bench.run(1.5)
    bench.firmware.press_estop()
    assert bench.say("/1 1 warnings") == ["@01 1 OK IDLE FH 02 FH WR"]
    assert bench.say("/1 1 home") == ["@01 1 RJ IDLE FH DRIVERDISABLED"]
    bench.say("/1 driver enable")
    assert bench.say("/1 1 home") == ["@01 1 RJ IDLE FH DRIVERDISABLED"]
    bench.firmware.release_estop()
    bench.say("/1 driver enable")
    assert bench.say("/1 1 home") == ["@01 1 OK BUSY WR 0"]


def test_an_encoder_error_and_a_knob_show_their_flags(bench: Bench):
    bench.homed()
    bench.firmware.turn_knob(2)
    assert bench.say("/1 2 warnings") == ["@01 2 OK BUSY NC 01 NC"]
    bench.firmware.encoder_error(1)
    assert bench.say("/1 1 warnings") == ["@01 1 OK IDLE FQ 02 FQ WR"]


def test_alerts_come_only_when_asked_for(bench: Bench):
    bench.homed().say("/1 1 move abs 100000")
    assert bench.run(2) == []
    bench.say("/1 set comm.alert 1")
    bench.say("/1 1 move abs 200000")
    assert bench.run(2) == ["!01 1 IDLE --"]


def test_echo_comes_back_and_a_long_answer_in_two_packets(bench: Bench):
    assert bench.say("/1 0 07 tools echo hello there") == ["@01 0 07 OK IDLE WR hello there"]
    words = "abcdefghijklmnopqrstuvwxyz abcdefghijklmnopqrstuvwxyz 1234"
    first, second = bench.say(f"/1 0 07 tools echo {words}")
    assert first.endswith("\\")
    assert max(len(first), len(second)) + 2 <= 80
    assert second.startswith("#01 0 07 cont ")
    assert first.split(" WR ")[1][:-1] + " " + second.removeprefix("#01 0 07 cont ") == words


def test_a_command_in_two_packets_is_one_command(bench: Bench):
    bench.homed()
    assert bench.say("/1 1 05 move\\") == []
    assert bench.say("/1 1 05 cont 1 abs 100000") == ["@01 1 05 OK BUSY -- 0"]


def test_help_is_a_reply_and_infos(bench: Bench):
    first, *rest = bench.say("/1 0 08 help")
    assert first == "@01 0 08 OK IDLE WR 0"
    assert len(rest) > 3
    assert all(line.startswith("#01 0 08 ") for line in rest)


def test_renumber_counts_the_devices_on_the_cable():
    bench = Bench(Chain([ZaberFirmware([STAGE], address=7), ZaberFirmware([STAGE], address=7, serial=5)]))
    assert bench.say("/renumber") == ["@01 0 OK IDLE WR 0", "@02 0 OK IDLE WR 0"]
    assert bench.say("/2 get system.serial") == ["@02 0 OK IDLE WR 5"]
    assert bench.say("/2 renumber 9") == ["@09 0 OK IDLE WR 0"]


def test_bytes_may_come_singly_and_what_stands_before_the_slash_counts_for_nothing(bench: Bench):
    for byte in b"\x00noise/1 get version\r\n":
        bench.firmware.receive(bytes([byte]), bench.now)
    assert bench.hear() == ["@01 0 OK IDLE WR 7.38"]


def test_too_long_a_packet_is_dropped_and_the_next_one_read(bench: Bench):
    assert bench.say("/1 tools echo " + 90 * "x") == []
    assert bench.say("/1 get version") == ["@01 0 OK IDLE WR 7.38"]
