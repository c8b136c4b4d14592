from collections.abc import Callable

import pytest

from hardware.errors import ReplyError
from hardware.zaber.link import Link
from hardware.zaber.messages import checksum

Answers = Callable[[int], list[bytes]]  # by the message id of the question


class Scripted:
    """A line whose device answers each question as the script says; a line a millisecond."""

    port = "/dev/script"

    def __init__(self, script: Answers):
        self._script = script
        self._said: list[bytes] = []
        self.asked: list[bytes] = []
        self.now = 0.0

    def clock(self) -> float:
        return self.now

    def write(self, message: bytes) -> None:
        self.asked.append(message)
        self._said += self._script(int(message.split()[2][:2]))

    def read_line(self, deadline: float) -> bytes:
        self.now += 0.001
        if not self._said:
            self.now = max(self.now, deadline)
            raise ReplyError("late")
        return self._said.pop(0)


def link(script: Answers, checked: bool = False) -> tuple[Link, Scripted]:
    line = Scripted(script)
    made = Link(line, 0.5, line.clock)  # type: ignore[arg-type]
    made.checked = checked
    return made, line


def test_an_answer_counts_only_for_its_own_question():
    one, line = link(
        lambda id: [b"@01 1 %02d OK IDLE -- 1" % ((id - 1) % 100), b"@01 1 %02d OK IDLE -- 2" % id]
    )
    for _ in range(250):
        assert one.ask(1, 1, "get pos").data == "2"
    assert len(line.asked) == 250


@pytest.mark.parametrize("other", [b"@02 1 %02d OK IDLE -- 1", b"@01 2 %02d OK IDLE -- 1", b"#01 1 %02d 1"])
def test_an_answer_of_another_device_axis_or_kind_is_none(other: bytes):
    one, line = link(lambda id: [other % id, b"@01 1 OK IDLE -- 1", b"!01 1 IDLE --"])
    with pytest.raises(ReplyError, match="no answer to 'get pos'"):
        one.ask(1, 1, "get pos")
    assert len(line.asked) == 3


def test_orders_are_given_once():
    one, line = link(lambda id: [])
    with pytest.raises(ReplyError):
        one.ask(1, 1, "move abs 5", tries=1)
    assert len(line.asked) == 1


def test_a_line_that_never_falls_silent_is_left_at_the_deadline():
    one, line = link(lambda id: [b"@01 1 %02d OK IDLE -- 1" % ((id + 50) % 100)] * 100_000)
    with pytest.raises(ReplyError):
        one.ask(1, 1, "get pos", tries=1)
    assert line.now < 0.6


def test_a_checksum_that_is_missing_is_noticed():
    with_sum = b"01 1 %02d OK IDLE -- 7"

    def script(id: int) -> list[bytes]:
        return [
            b"@01 1 %02d OK IDLE -- 70000" % id,
            b"@" + with_sum % id + b":" + checksum(with_sum % id).encode(),
        ]

    assert link(script, checked=True)[0].ask(1, 1, "get pos").data == "7"
    assert link(script)[0].ask(1, 1, "get pos").data == "70000"


def test_what_was_damaged_is_told_when_nothing_better_came():
    one, _ = link(lambda id: [b"\xf3\x00@01"])
    with pytest.raises(ReplyError, match=r"/dev/script: .*\\xf3.*check cable and baud rate"):
        one.ask(1, 1, "get pos")


def test_the_packets_of_one_answer_are_put_together():
    one, _ = link(
        lambda id: [
            b"@01 1 %02d OK IDLE -- one\\" % id,
            b"#01 1 %02d words of help" % id,
            b"#01 1 %02d cont two\\" % id,
            b"#01 1 %02d cont three" % id,
        ]
    )
    assert one.ask(1, 1, "get pos").data == "one two three"


def test_peeking_gives_up_soon_while_somebody_else_asks():
    one, line = link(lambda id: [b"@01 1 %02d OK IDLE -- 1" % id])
    assert one.peek(1, 1, "get pos", 0.05) is not None
    with one._asking:
        assert one.peek(1, 1, "get pos", 0.05) is None
    assert len(line.asked) == 1


def test_stop_is_one_message_to_all_devices_and_needs_no_turn():
    one, line = link(lambda id: [])
    with one._asking:
        one.stop((1, 7))
    (sent,) = line.asked
    first, second = sent.split(b"\n")[:2]
    assert first.startswith(b"/1 0 00 stop:")
    assert second.startswith(b"/7 0 01 stop:")
