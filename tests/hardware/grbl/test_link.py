"""The conversation with a GRBL controller, with a line that answers as a test wants."""

from collections import deque

import pytest

from hardware.errors import RefusedError, ReplyError, StoppedError
from hardware.grbl.link import GrblLink, Reply
from hardware.grbl.status import Feedback


class Scripted:
    """A `Line`: what is to come, and what was sent; each read takes a hundredth of a second."""

    port = "scripted"

    def __init__(self, *lines: bytes):
        self.lines = deque(lines)
        self.sent: list[bytes] = []
        self.now = 0.0

    def clock(self) -> float:
        return self.now

    def write(self, message: bytes) -> None:
        self.sent.append(message)

    def read_line(self, deadline: float) -> bytes:
        if not self.lines or self.now >= deadline:
            self.now = max(deadline, self.now)
            raise ReplyError("late")
        self.now += 0.01
        return self.lines.popleft()


def linked(*lines: bytes) -> tuple[GrblLink, Scripted]:
    line = Scripted(*lines)
    return GrblLink(line, line.clock, 1), line  # type: ignore[arg-type]


def ignore(reply: Reply | None) -> None:
    """Judge nothing."""


def test_after_a_stop_no_line_of_the_order_follows():
    link, line = linked(b"ok")
    link.begin(homing=False)
    link.send("G4P0.01")
    link.stop()
    with pytest.raises(StoppedError):
        link.exchange(["G1X5F100"], 1.0, ignore)
    assert line.sent == [b"G4P0.01\n", b"!"]
    link.begin(homing=False)
    link.send("G1X5F100")
    assert line.sent[-1] == b"G1X5F100\n"


def test_homing_is_stopped_by_a_reset():
    link, line = linked()
    link.begin(homing=True)
    link.stop()
    assert line.sent == [b"\x18"]
    assert link.resets_due == 1


def test_no_more_is_sent_than_the_buffer_holds():
    link, line = linked()
    with pytest.raises(ReplyError):
        link.exchange(["G1X1.0F100" for _ in range(50)], 1.0, ignore)
    lines = [message for message in line.sent if message.startswith(b"G1")]
    assert len(lines) == 11  # of 11 bytes each; 128 are there
    assert len(link.waiting) == 11


def test_answers_belong_to_lines_in_their_order():
    link, _ = linked(b"ok", b"error:33", b"ok")
    with pytest.raises(RefusedError, match=r"error:33.*'B'"):
        link.exchange(["A", "B", "C"], 1.0, ignore)
    assert not link.waiting


def test_what_is_said_besides_is_handed_back():
    link, _ = linked(b"[VER:1.1h.20190825:]", b"\xff", b"ok")
    heard = link.exchange(["$I"], 1.0, ignore)
    assert heard[0] == Feedback("VER", "1.1h.20190825:")


def test_an_answer_to_nothing_answers_nothing():
    link, _ = linked(b"ok", b"ok")
    assert link.read(1.0) is not None
    link.send("$G")
    link.read(1.0)
    assert not link.waiting


def test_silence_is_told_with_what_was_asked():
    link, line = linked()
    with pytest.raises(ReplyError, match=r"'\$G'"):
        link.exchange(["$G"], 2.0, ignore)
    assert 2.0 <= line.now < 2.2
    assert line.sent.count(b"?") == 4  # one unanswered question at a time


def test_a_report_asked_for_earlier_is_not_taken_for_the_present_one():
    link, _ = linked(b"<Idle|WPos:1.000|FS:0,0>", b"<Idle|WPos:2.000|FS:0,0>")
    link._query(0.0)  # as an exchange leaves it that ended between question and answer
    assert link.look(ignore).place == (2.0,)


def test_of_several_start_up_messages_all_are_waited_for():
    banner = b"Grbl 1.1h ['$' for help]"
    link, _ = linked(banner, banner, b"ok")
    link.resets_due = 1
    link.reset(ignore)
    assert link.resets_due == 0
    link.send("$G")
    assert link.read(100.0) is not None
    assert not link.waiting


def test_a_reset_that_is_not_answered_is_told():
    link, line = linked()
    with pytest.raises(ReplyError, match="start again"):
        link.reset(ignore)
    assert [sent for sent in line.sent if sent != b"?"] == [b"\x18"] * 3
