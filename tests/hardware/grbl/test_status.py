import pytest

from hardware.grbl.status import (
    Alarm,
    Banner,
    Feedback,
    Noise,
    Ok,
    Refusal,
    Report,
    Setting,
    heard,
    parse,
    unwrapped,
    work_place,
)


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        (b"ok", Ok()),
        (b"error:20", Refusal(20)),
        (b"ALARM:9", Alarm(9)),
        (b"Grbl 1.1h ['$' for help]", Banner("1.1h", "1.1h")),
        (b"GrblHAL 1.1f ['$' or '$HELP' for help]", Banner("1.1f", "1.1f")),
        (b"Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]", Banner("FluidNC v3.7.8", "3.7")),
        (b"$110=3600.000", Setting(110, 3600.0)),
        (b"[VER:1.1h.20190825:Grbl 1.1 of mine]", Feedback("VER", "1.1h.20190825:Grbl 1.1 of mine")),
        (b"[MSG:INFO: ALARM:1 told again]", Feedback("MSG", "INFO: ALARM:1 told again")),
        (b"[MSG:INFO: FluidNC v3.9.1 https://github.com/bdring/FluidNC]", Banner("FluidNC v3.9.1", "3.9")),
        (b"[FIRMWARE:grblHAL]", Feedback("FIRMWARE", "grblHAL")),
        (b"[echo: G1X0]", Feedback("echo", " G1X0")),
        (b">G54:ok", Noise(b">G54:ok")),
        (b"", Noise(b"")),
    ],
)
def test_what_the_manual_shows_is_understood(line: bytes, reply: object):
    assert parse(line) == reply


def test_reports_are_read_with_whatever_fields_they_have():
    plain = parse(b"<Idle|MPos:0.000,-10.500,5.000|FS:0,0>")
    assert plain == Report("Idle", None, True, (0.0, -10.5, 5.0), None)
    full = parse(
        b"<Hold:1|WPos:-2.500,0.000,11.000|Bf:15,128|Ln:9|FS:500,8000|Pn:XYZ|WCO:0.000,1.551,5.664|A:SFM>"
    )
    assert full == Report("Hold", 1, False, (-2.5, 0.0, 11.0), (0.0, 1.551, 5.664))
    fluidnc = parse(b"<Run|MPos:1.000|FS:0,0|SD:12.5,/sd/a b.nc>")
    assert fluidnc == Report("Run", None, True, (1.0,), None)
    places = ",".join(f"{axis}.000" for axis in range(8))
    hal = parse(f"<Alarm:11|WPos:{places}|SP1:0,,S1|FW:grblHAL|AR|WCO:{places}|D1:>".encode())
    assert hal == Report("Alarm", 11, False, tuple(map(float, range(8))), tuple(map(float, range(8))))


def test_what_is_in_motion_is_told_from_what_stands():
    states = (
        "Idle", "Run", "Run:1", "Run:2", "Hold:0", "Hold:1", "Jog", "Alarm", "Alarm:1", "Door:0", "Door:1", "Door:2",
        "Door:3", "Door:4", "Check", "Home", "Sleep", "Tool",
    )  # fmt: skip
    moving = [state for state in states if parse(f"<{state}|MPos:0.000|FS:0,0>".encode()).moving]  # type: ignore[union-attr]
    assert moving == ["Run", "Run:1", "Run:2", "Hold:1", "Jog", "Door:2", "Door:3", "Door:4", "Home"]


@pytest.mark.parametrize(
    "line",
    [
        b"o\xffk", b" ok", b"okok", b"ok ok", b"error:", b"xerror:5", b"error:5x", b"<Idle>", b"<Idle|MPos:1,2,3|FS:0,0>",
        b"<Idle|MPos:0.000,0.000,0.000|FS:0,0", b"<Idle|MPos:0.000,,0.000>", b"<Idel|MPos:0.000,0.000,0.000>",
        b"<Idle|MPos:0.000,0.000|WCO:0.000>", b"<Idle|MPos:0.000,0.0\xff00,0.000|FS:0,0>", b"$x=3", b"$1=", b"<Idle,MPos:0.000>",
    ],
)  # fmt: skip
def test_a_damaged_answer_is_no_answer(line: bytes):
    assert isinstance(parse(line), Noise)


@pytest.mark.parametrize("line", [b"\x00\xffALARM:3", b"<IdleALARM:3", b"okALARM:3", b"ALARM:3x"])
def test_an_alarm_is_heard_through_noise(line: bytes):
    assert parse(line) == Alarm(3)


@pytest.mark.parametrize(
    "line", [b"\x00\x1fGrbl 1.1h ['$' f\xffor help]", b"okGrbl 1.1h", b"<Idle|Grbl 1.1h"]
)
def test_a_restart_is_heard_through_noise(line: bytes):
    assert parse(line) == Banner("1.1h", "1.1h")


def test_work_position_is_machine_position_less_its_offset():
    machine = parse(b"<Idle|MPos:5.000,7.000,0.000|FS:0,0>")
    assert isinstance(machine, Report)
    assert work_place(machine, (1.0, -2.0, 0.0)) == (4.0, 9.0, 0.0)
    work = parse(b"<Idle|WPos:5.000,7.000,0.000|FS:0,0>")
    assert isinstance(work, Report)
    assert work_place(work, (1.0, -2.0, 0.0)) == (5.0, 7.0, 0.0)


def test_only_a_complete_hold_is_a_pause():
    paused = {
        state: parse(f"<{state}|MPos:0.000|FS:0,0>".encode()).paused  # type: ignore[union-attr]
        for state in ("Hold:0", "Hold:1", "Door:0", "Door:1", "Door:2", "Door:3", "Run", "Idle")
    }
    assert [state for state, at_rest in paused.items() if at_rest] == ["Hold:0", "Door:0", "Door:1"]


@pytest.mark.parametrize(
    ("reported", "near", "angle"),
    [
        (10.0, 365.0, 370.0),
        (350.0, -5.0, -10.0),
        (0.0, 719.0, 720.0),
        (10.0, 10.0, 10.0),
        (181.0, 0.0, -179.0),
    ],
)
def test_a_wrapped_angle_is_the_one_nearby(reported: float, near: float, angle: float):
    assert unwrapped(reported, near) == pytest.approx(angle)


def test_what_was_heard_can_be_printed():
    assert heard(b"\x00\xff@01") == "'\\x00ÿ@01'"
    assert heard(b"x" * 100).endswith("...")
