"""A million random and mutated bytes: nothing but errors that name a cause, no endless wait, and nothing set in motion."""

import random
import re

import pytest

from hardware.errors import DisconnectedError, HardwareError, ReplyError
from hardware.interfaces import Angles
from hardware.virtual.zaber.firmware import ZaberFirmware
from hardware.zaber import messages
from hardware.zaber.link import Link
from hardware.zaber.rig import Stage, Zaber

REAL = (
    b"@01 1 09 OK IDLE -- 90000:59\r\n@01 0 10 RJ BUSY FS BADCOMMAND\r\n!01 2 IDLE WR\r\n#01 0 11 cont more of it\r\n"
    b"@01 1 12 OK IDLE WR 02 WR WH\r\n@01 0 13 OK IDLE -- split\\\r\n@99 9 99 OK BUSY NC -2147483648:AA\r\n"
)
PARSED_BYTES, HEARD_BYTES = 1_000_000, 200_000


def stream(seed: int, size: int) -> bytes:
    """Random bytes, and real answers with bytes changed, lost, doubled and put in."""
    rng = random.Random(seed)
    out = bytearray()
    while len(out) < size:
        if rng.random() < 0.3:
            out += rng.randbytes(rng.randrange(1, 200))
            continue
        piece = bytearray(REAL)
        for _ in range(rng.randrange(1, 12)):
            place = rng.randrange(len(piece))
            match rng.randrange(4):
                case 0:
                    piece[place] = rng.randrange(256)
                case 1:
                    del piece[place]
                case 2:
                    piece[place:place] = piece[place : place + rng.randrange(20)]
                case _:
                    piece[place:place] = rng.randbytes(rng.randrange(1, 5))
        out += piece
    return bytes(out[:size])


def test_the_parser_only_ever_raises_reply_errors():
    read = 0
    for line in stream(1, PARSED_BYTES).split(b"\n"):
        for checked in (False, True):
            try:
                message = messages.read(line.rstrip(b"\r"), checked)
            except ReplyError:
                continue
            read += 1
            for further in (messages.flags_in, messages.number):
                try:
                    further(message.data)
                except ReplyError:
                    continue
            messages.flag(message.warning)
            messages.severity(message.warning)
    assert read > 1000  # mutations that still are messages were among them


class Noise:
    """A line on which nothing but noise comes back; keeps what was written to it. Time passes as it is read."""

    port = "/dev/noise"

    def __init__(self, said: bytes):
        self._lines = said.split(b"\n")
        self.written = b""
        self.now = 0.0

    def clock(self) -> float:
        return self.now

    def write(self, message: bytes) -> None:
        self.written += message

    def read_line(self, deadline: float) -> bytes:
        self.now += 0.002
        if not self._lines:
            raise DisconnectedError("the noise has ended")
        if self.now > deadline:
            raise ReplyError("late")
        return self._lines.pop()

    def drop_input(self) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("checked", [False, True])
def test_noise_for_answers_sets_nothing_in_motion(seed: int, checked: bool):
    """Questions, homing and moves on a line that answers noise: errors only, and `move` only where it was ordered."""
    noise = Noise(stream(seed, HEARD_BYTES))
    link = Link(noise, 0.05, noise.clock)  # type: ignore[arg-type]
    link.checked = checked
    stages = [
        Stage("pan", 1, 1, 1000.0, 0.0, -400.0, 400.0, 10.0),
        Stage("tilt", 1, 2, 1000.0, 0.0, -60.0, 60.0, 10.0),
    ]
    rig = Zaber("noise", link, stages, True, 5.0, noise.clock, lambda seconds: None)
    orders = 0
    while noise._lines:
        rig.status()
        for order in (rig.home, lambda: rig.move(Angles(33.0, 1.0))):
            with pytest.raises(HardwareError):
                order()
            orders += 1
    assert orders > 20
    sent = [line.split(b":")[0] for line in noise.written.splitlines()]
    moving = [line for line in sent if re.search(rb" (move|home)", line)]
    assert all(re.fullmatch(rb"/1 [12] \d\d (home|move abs (33000|1000))", line) for line in moving)
    assert len(moving) <= 2 * orders
    others = {line.split(b" ", 3)[3] if line.count(b" ") > 2 else b"" for line in sent} - {b"home"}
    assert others <= {
        b"warnings",
        b"warnings clear",
        b"get pos",
        b"stop",
        b"driver enable",
        b"move abs 33000",
        b"move abs 1000",
    }


def test_noise_never_moves_the_emulated_device_either():
    """The other way round: whatever a broken cable says to a device, it moves only on a command that is whole."""
    device = ZaberFirmware()
    rng = random.Random(4)
    device.receive(b"/1 home\n", 1.0)
    device.advance(60.0)
    now = 60.0
    for _ in range(300):
        now += 0.01
        device.receive(rng.randbytes(500).replace(b"move", b"").replace(b"home", b""), now)
        device.advance(now)
    assert device.angles() == Angles(0.0, 0.0)
