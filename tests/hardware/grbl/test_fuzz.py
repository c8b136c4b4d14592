"""A million random and mutated bytes into the driver's parser, the whole driver, and the emulator: nothing gives way."""

import random
import re
from collections.abc import Callable, Iterator

import pytest

from hardware.errors import HardwareError, PositionLostError, ReplyError
from hardware.grbl.config import GrblConfig
from hardware.grbl.link import GrblLink
from hardware.grbl.rig import Grbl
from hardware.grbl.status import Noise, Ok, parse
from hardware.grbl.travel import Found
from hardware.interfaces import Angles, MotionStatus
from hardware.virtual.grbl.firmware import GrblFirmware
from tests.hardware.contracts.grbl_rigs import QUICK, SWITCHED

BYTES = 1_000_000
SAID = (
    b"ok", b"error:9", b"error:33", b"ALARM:1", b"ALARM:3", b"", b"Grbl 1.1h ['$' for help]", b"$110=3600.000",
    b"Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]", b"[MSG:'$H'|'$X' to unlock]", b"[VER:1.1h.20190825:]",
    b"<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>", b"<Hold:0|MPos:10.000,0.000,0.000|FS:0,0>",
    b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>", b"<Run|MPos:-5.000,1.000,0.000|FS:500,0|Pn:X|Ov:100,100,100>",
    b"<Alarm|WPos:0.000,0.000,0.000|Bf:15,128|FS:0,0>", b"[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]", b">G54:ok",
)  # fmt: skip
TOLD = (
    b"G0X10", b"G1X-20.5Y3F500", b"$$", b"$H", b"$X", b"$J=G91X5F600", b"G4P0.01", b"G10L20P1X0Y0", b"$G", b"$#", b"$I",
    b"G2X1Y1I1J0F100", b"G28", b"G92X0", b"G20", b"G21", b"M3S100", b"$N0=G54", b"$10=3", b"$RST=#", b"G38.2X5F10",
    b"$C", b"$SLP", b"M0", b"M2", b"(a comment)G1X1", b"G93G1X1F2", b"~", b"!", b"?", b"\x18", b"\x85", b"\x84", b"G59.3",
)  # fmt: skip


def damaged(line: bytes, source: tuple[bytes, ...], rng: random.Random) -> bytes:
    spoiled = bytearray(line)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(spoiled) + 1)
        match rng.randrange(5):
            case 0:
                spoiled[at:at] = rng.randbytes(rng.randint(1, 3))
            case 1:
                del spoiled[at : at + rng.randint(1, 4)]
            case 2:
                spoiled[at : at + 1] = rng.randbytes(1)
            case 3:
                spoiled += rng.choice(source)
            case _:
                spoiled[at:at] = rng.choice(source)[: rng.randint(1, 6)]
    return bytes(spoiled)


def mutated(source: tuple[bytes, ...], amount: int, seed: int, often: float) -> Iterator[bytes]:
    """Lines, some damaged, and stretches of bytes of any value; together `amount` bytes."""
    rng = random.Random(seed)
    made = 0
    while made < amount:
        line = rng.choice(source)
        if rng.random() < often:
            line = damaged(line, source, rng)
        if rng.random() < 0.01:
            line = rng.randbytes(rng.randint(1, 300))
        made += len(line) + 1
        yield line + b"\n"


def test_the_parser_makes_a_reply_of_anything():
    taken = 0
    for data in mutated(SAID, BYTES, 1, often=0.8):
        for line in data.split(b"\n"):
            reply = parse(line.rstrip(b"\r"))
            taken += not isinstance(reply, Noise)
            assert isinstance(reply, Ok) == (line.rstrip(b"\r") == b"ok")
    noise = random.Random(2).randbytes(BYTES)
    assert sum(isinstance(parse(line), Noise) for line in noise.split(b"\n")) == noise.count(b"\n") + 1
    assert taken > 1000


class Babble:
    """A `Line` from which comes what it likes; every read takes a hundredth of a second of its own time."""

    port = "babble"
    unfinished = b""

    def __init__(self, lines: Iterator[bytes]):
        self._lines = (part.rstrip(b"\r") for data in lines for part in data[:-1].split(b"\n"))
        self.now = 0.0
        self.sent = bytearray()
        self.over = False

    def clock(self) -> float:
        return self.now

    def write(self, message: bytes) -> None:
        self.sent += message

    def read_line(self, deadline: float) -> bytes:
        if deadline <= self.now:
            raise ReplyError("late")
        self.now += 0.01
        line = next(self._lines, None)
        if line is None:
            self.over = True
            self.now = deadline
            raise ReplyError("silent")
        return line

    def close(self) -> None:
        pass


def rig_on(line: Babble) -> Grbl:
    link = GrblLink(line, line.clock, 1)  # type: ignore[arg-type]
    config = GrblConfig("babble", pan=None, homing="none", feed_deg_min=3600.0)
    return Grbl(config, link, Found("GRBL 1.1h", {100: 200.0, 110: 3600.0, 120: 600.0}), line.clock)


def test_nothing_that_is_heard_sets_an_idle_rig_in_motion():
    line = Babble(mutated(SAID, BYTES // 2, 3, often=0.5))
    rig = rig_on(line)
    while not line.over:
        assert isinstance(rig.status(), MotionStatus)
    assert set(line.sent) == {ord("?")}


def give_orders(line: Babble, rig: Grbl, truth: Callable[[], float] | None) -> tuple[int, int]:
    """Until the line is over; how many moves ended well, and how often the position was lost."""
    reached = lost = number = 0
    zero = 0.0
    while not line.over:
        number += 1
        target = float(number * 7 % 50)
        del line.sent[:]
        began = line.now
        try:
            if number % 5 == 1:
                rig.home()
                zero = truth() if truth else 0.0
            elif number % 11 == 3:
                rig.stop()
                rig.resume()
                rig.hold()
            else:
                assert rig.move(Angles(target)).pan_deg == pytest.approx(target, abs=0.01)
                assert truth is None or truth() - zero == pytest.approx(target, abs=0.01)
                reached += 1
        except HardwareError as error:
            lost += isinstance(error, PositionLostError)
        assert line.now - began < 120.0  # deadlines, in its own time
        moves = re.findall(rb"G1X[^\n]*", bytes(line.sent))
        assert moves in ([], [f"G1X{target:.4f}F3600.0".encode()])
    return reached, lost


def test_whatever_is_heard_a_rig_moves_only_where_it_was_told():
    for seed in range(10):
        line = Babble(mutated(SAID, BYTES // 40, 100 + seed, often=0.05 * seed))
        give_orders(line, rig_on(line), None)


class Spoiled(Babble):
    """A controller at the other end of a cable that damages what it says."""

    def __init__(self, firmware: GrblFirmware, seed: int, often: float, amount: int):
        super().__init__(iter(()))
        self._firmware, self._rng, self._often, self._amount = firmware, random.Random(seed), often, amount
        self._heard = bytearray()

    def write(self, message: bytes) -> None:
        super().write(message)
        self._firmware.receive(message, self.now)

    def read_line(self, deadline: float) -> bytes:
        while b"\n" not in self._heard:
            if self.now >= deadline:
                raise ReplyError("late")
            self.now += 0.01
            for line in self._firmware.advance(self.now).splitlines(keepends=True):
                if self._rng.random() < self._often:
                    line = damaged(line, SAID, self._rng)
                self._heard += line
                self._amount -= len(line)
        self.over = self._amount < 0
        line, _, rest = bytes(self._heard).partition(b"\n")
        self._heard[:] = rest
        return line.rstrip(b"\r")


def test_damaged_answers_of_a_real_controller_never_make_a_wrong_place():
    reached = lost = 0
    for seed in range(12):
        firmware = GrblFirmware(QUICK)
        line = Spoiled(firmware, seed, often=0.02 * seed, amount=BYTES // 40)
        good, bad = give_orders(line, rig_on(line), lambda firmware=firmware: firmware.angles().pan_deg)
        reached, lost = reached + good, lost + bad
    assert reached > 100
    assert lost > 10


def test_the_emulator_survives_anything_it_is_told():
    firmware = GrblFirmware(SWITCHED)
    now, said = 0.0, 0
    for number, data in enumerate(mutated(TOLD, BYTES // 2, 4, often=0.5)):
        if number % 40 == 0:
            data = b"\x18~\n$X\n" + data
        firmware.receive(data, now)
        now += 0.05
        said += len(firmware.advance(now))
    rng = random.Random(5)
    for _ in range(BYTES // 2 // 500):
        firmware.receive(rng.randbytes(500), now)
        now += 0.05
        said += len(firmware.advance(now))
    assert said > 1000
    firmware.receive(b"\x18", now)
    now += 1.0
    firmware.advance(now)
    firmware.receive(b"\x18\n$X\n?", now)
    assert b"<Idle|" in firmware.advance(now + 1.0)
