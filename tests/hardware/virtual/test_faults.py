import pytest

from hardware.virtual.faults import Faulty


class Echo:
    """Says back whatever it hears, at once."""

    def __init__(self) -> None:
        self._said = b""

    def receive(self, data: bytes, now: float) -> None:
        self._said += data

    def advance(self, now: float) -> bytes:
        said, self._said = self._said, b""
        return said


def said(faults: Faulty, data: bytes, now: float = 0.0) -> bytes:
    faults.receive(data, now)
    return faults.advance(now)


@pytest.fixture
def faults() -> Faulty:
    return Faulty(Echo())


def test_without_a_fault_nothing_changes(faults: Faulty):
    assert said(faults, b"one\r\ntw") == b"one\r\ntw"
    assert faults.advance(1.0) == b""


def test_garbage_comes_once_within_what_is_said_next(faults: Faulty):
    faults.garbage(b"\xff\x00")
    assert faults.advance(0.0) == b""
    assert said(faults, b"ok\r\n") == b"o\xff\x00k\r\n"
    assert said(faults, b"ok\r\n") == b"ok\r\n"


def test_noise_adds_bytes_and_loses_none(faults: Faulty):
    faults.noise(0.3)
    heard = said(faults, b"a" * 1000)
    assert 1200 < len(heard) < 1400
    assert heard.count(b"a") >= 1000
    again = Faulty(Echo())
    again.noise(0.3)
    assert said(again, b"a" * 1000) == heard  # the same seed, the same noise


@pytest.mark.parametrize(
    ("number", "matching", "left"),
    [
        (1, b"", b"ok\nerror\nok\n"),
        (3, b"", b"a\nok\nok\n"),
        (2, b"ok", b"a\nok\nerror\n"),
        (1, b"e", b"a\nok\nok\n"),
    ],
)
def test_the_line_that_was_asked_for_is_lost(faults: Faulty, number: int, matching: bytes, left: bytes):
    faults.lose_line(number, matching)
    assert said(faults, b"a\nok\nerror\nok\n") == left
    assert said(faults, b"a\nok\n") == b"a\nok\n"


def test_a_line_is_lost_whole_even_if_it_comes_in_pieces(faults: Faulty):
    faults.lose_line(1, b"ok")
    assert said(faults, b"o") == b""
    assert said(faults, b"k\r") == b""
    assert said(faults, b"\nnext") == b""
    assert said(faults, b"\n") == b"next\n"
    assert said(faults, b"piece") == b"piece"


def test_split_replies_come_byte_by_byte(faults: Faulty):
    faults.split()
    assert said(faults, b"ok\n") == b"o"
    assert [faults.advance(0.0) for _ in range(3)] == [b"k", b"\n", b""]


def test_merged_replies_come_in_one_piece(faults: Faulty):
    faults.merge(1.0)
    assert said(faults, b"one\n", 0.0) == b""
    assert said(faults, b"two\n", 0.5) == b""
    assert faults.advance(0.99) == b""
    assert faults.advance(1.0) == b"one\ntwo\n"


def test_late_replies_keep_their_order(faults: Faulty):
    faults.delay(10.0)
    assert said(faults, b"one\n", 0.0) == b""
    faults.heal()
    assert said(faults, b"two\n", 1.0) == b""  # it cannot overtake
    assert faults.advance(9.9) == b""
    assert faults.advance(10.0) == b"one\ntwo\n"
    assert said(faults, b"three\n", 11.0) == b"three\n"


def test_silence_swallows_what_is_said_until_it_ends(faults: Faulty):
    faults.silence()
    assert said(faults, b"one\n") == b""
    faults.heal()
    assert said(faults, b"two\n") == b"two\n"


def test_a_deaf_device_hears_nothing(faults: Faulty):
    faults.deafen()
    assert said(faults, b"one\n") == b""
    faults.heal()
    assert faults.advance(1.0) == b""
    assert said(faults, b"two\n") == b"two\n"


def test_healing_ends_every_fault(faults: Faulty):
    faults.garbage(b"x")
    faults.noise(1.0)
    faults.lose_line()
    faults.split()
    faults.merge(5.0)
    faults.delay(5.0)
    faults.heal()
    assert said(faults, b"one\ntwo\n") == b"one\ntwo\n"
