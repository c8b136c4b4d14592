import pytest

from hardware.errors import HardwareError, PositionLostError, RefusedError, ReplyError
from hardware.zaber import messages
from hardware.zaber.messages import FLAGS, REJECTIONS, Effect


def test_a_command_has_the_bytes_of_the_manual():
    assert messages.command(1, 1, 9, "move abs 90000") == b"/1 1 09 move abs 90000:AF\n"
    assert messages.command(1, 0, 0) == b"/1 0 00:FF\n"


def test_sum_of_all_bytes_and_the_checksum_is_a_multiple_of_256():
    body = b"12 3 45 get limit.max"
    assert (sum(body) + int(messages.checksum(body), 16)) % 256 == 0


@pytest.mark.parametrize("text", ["tools echo " + 80 * "x", "a:b", "move abs 1\n", "größer"])
def test_what_no_device_could_read_is_not_sent(text: str):
    with pytest.raises(HardwareError):
        messages.command(1, 1, 1, text)


def test_a_reply_is_read():
    reply = messages.read(b"@01 2 09 OK BUSY WR -8000")
    assert (reply.kind, reply.address, reply.axis, reply.id) == ("@", 1, 2, 9)
    assert (reply.rejected, reply.busy, reply.warning, reply.data) == (False, True, "WR", "-8000")
    assert not reply.goes_on


def test_a_reply_without_an_id_and_one_that_rejects_are_read():
    assert messages.read(b"@12 0 OK IDLE -- 0").id is None
    reply = messages.read(b"@01 0 07 RJ IDLE -- BADCOMMAND")
    assert reply.rejected
    assert reply.data == "BADCOMMAND"


def test_alert_and_info_are_read():
    alert = messages.read(b"!01 1 IDLE FS")
    assert (alert.kind, alert.axis, alert.busy, alert.warning, alert.id) == ("!", 1, False, "FS", None)
    info = messages.read(b"#01 0 33 some words of help")
    assert (info.kind, info.id, info.data, info.continues) == ("#", 33, "some words of help", False)


def test_a_message_in_two_packets_says_so():
    first = messages.read(b"@01 0 33 OK IDLE -- the beginning\\")
    assert first.goes_on
    assert first.data == "the beginning"
    rest = messages.read(b"#01 0 33 cont and the end")
    assert rest.continues
    assert rest.data == "and the end"
    assert messages.read(b"#01 0 33 cont 2 words").data == "2 words"


def test_a_checksum_is_taken_off_and_a_wrong_one_is_an_error():
    assert messages.read(
        b"@01 1 09 OK IDLE -- 90000:" + messages.checksum(b"01 1 09 OK IDLE -- 90000").encode()
    ).data == ("90000")
    with pytest.raises(ReplyError, match="checksum is wrong"):
        messages.read(b"@01 1 09 OK IDLE -- 90001:" + messages.checksum(b"01 1 09 OK IDLE -- 90000").encode())


def test_a_checksum_can_be_demanded():
    assert messages.read(b"@01 1 09 OK IDLE -- 5").data == "5"
    with pytest.raises(ReplyError, match="missing"):
        messages.read(b"@01 1 09 OK IDLE -- 5", checked=True)


@pytest.mark.parametrize(
    "line",
    [b"", b"@", b"ok", b"[MSG:Reset]", b"@1 1 09 OK IDLE -- 0", b"@01 1 09 OK  IDLE -- 0", b"@01 1 9 OK IDLE -- 0",
     b"@01 1 09 OK idle -- 0", b"@01 1 09 OK IDLE W 0", b"@01 1 OK BUSY", b"\xff@01 1 09 OK IDLE -- 0",
     b"@01 1 09 OK IDLE -- \x00", b"x@01 1 09 OK IDLE -- 0", b"?01 1 09 OK IDLE -- 0"],
)  # fmt: skip
def test_anything_else_is_an_error(line: bytes):
    with pytest.raises(ReplyError):
        messages.read(line)


def test_warnings_are_a_count_and_that_many_flags():
    assert messages.flags_in("00") == ()
    assert messages.flags_in("02 FS WR") == ("FS", "WR")
    for data in ("", "1", "02 FS", "00 FS", "01 fs", "x FS"):
        with pytest.raises(ReplyError):
            messages.flags_in(data)


def test_flags_rank_as_a_device_shows_them():
    ranked = ["FF", "FQ", "FS", "WL", "WR", "WH", "NC", "NI", "--"]
    assert sorted(["--", "NI", "NC", "WH", "WR", "WL", "FS", "FQ", "FF"], key=messages.severity) == ranked
    assert messages.severity("FX") < messages.severity("WL")
    assert messages.severity("XX") == 0  # not of this protocol's letters: nothing is worse


def test_a_flag_says_what_it_does_to_the_position():
    for name in ("FS", "FQ", "FH", "WR", "WL"):
        assert messages.flag(name).effect is Effect.LOST
    assert messages.flag("NI").effect is Effect.INTERRUPTED
    assert messages.flag("--").effect is Effect.NONE
    assert messages.flag("FX").effect is Effect.LOST
    assert messages.flag("WX").effect is Effect.NOTE


def test_every_flag_that_stops_a_rig_has_a_remedy():
    for flag in FLAGS.values():
        assert flag.means
        assert flag.remedy or flag.effect in (Effect.NOTE, Effect.NONE)


def test_a_rejection_names_reason_and_remedy():
    for reason in REJECTIONS:
        error = messages.refusal("/dev/ttyUSB0, pan", "move abs 9", reason)
        assert reason in str(error)
        assert REJECTIONS[reason] in str(error)
        kinds = {"AGAIN": ReplyError, "DRIVERDISABLED": PositionLostError}
        assert isinstance(error, kinds.get(reason, RefusedError))
    assert "NEWREASON" in str(messages.refusal("/dev/ttyUSB0, pan", "home", "NEWREASON"))


def test_a_number_is_a_number():
    assert messages.number("-12.5") == -12.5
    for data in ("", "NA", "nan", "inf", "1 2", "1e999"):
        with pytest.raises(ReplyError):
            messages.number(data)
