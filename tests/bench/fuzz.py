"""Damage files of every kind that Roomlight reads, and read them: only our own errors, in bounded time and memory.

    python -m tests.bench.fuzz --files 2000 --seed 0        # a table, and exit code 1 where a promise is broken
    python -m tests.bench.fuzz --only exr --keep FOLDER     # keeps the files that broke one

Files are read in children, so that a crash of a library is seen too: it is counted, and the child replaced.
"""

import argparse
import multiprocessing
import random
import re
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from tests.bench import fuzz_samples

LONGEST_S, MOST_BYTES, LONGEST_LINE = 10.0, 2 << 30, 600
READ, REFUSED = "read", "refused"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one damaged file: READ, REFUSED with our own error, or what went wrong."""

    kind: str
    verdict: str
    seconds: float
    memory_bytes: int  # the most that the child held while it read
    change: str

    @property
    def broken(self) -> bool:
        late, large = self.seconds > LONGEST_S, self.memory_bytes > MOST_BYTES
        return self.verdict not in (READ, REFUSED) or late or large


# Each takes a file's bytes and a source of chance, and returns other bytes.


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content))]


def _flip_bits(content: bytes, chance: random.Random) -> bytes:
    damaged = bytearray(content)
    for _ in range(chance.choice((1, 1, 4, 40))):
        # Headers are short, and most of what can go wrong is said there.
        end = len(damaged) if chance.random() < 0.4 else min(len(damaged), 600)
        damaged[chance.randrange(end)] ^= 1 << chance.randrange(8)
    return bytes(damaged)


def _overwrite(content: bytes, chance: random.Random) -> bytes:
    at, length = chance.randrange(len(content)), chance.choice((1, 2, 4, 8, 64, 512))
    fill = chance.choice((b"\0", b"\xff", b"\x7f", b"\x80"))
    return content[:at] + fill * min(length, len(content) - at) + content[at + length :]


def _remove(content: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(content))
    return content[:at] + content[at + chance.choice((1, 3, 16, 200)) :]


def _repeat(content: bytes, chance: random.Random) -> bytes:
    at, length = chance.randrange(len(content)), chance.choice((1, 4, 40, 400))
    return content[:at] + content[at : at + length] * chance.choice((2, 3, 50)) + content[at + length :]


def _insert(content: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(content) + 1)
    return content[:at] + chance.randbytes(chance.choice((1, 2, 16, 300))) + content[at:]


def _replace_number(content: bytes, chance: random.Random) -> bytes:
    """One written number becomes one that nobody expects."""
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", content))
    if not numbers:
        return _insert(content, chance)
    found = chance.choice(numbers)
    odd = chance.choice(
        (b"nan", b"inf", b"-1", b"0", b"1e999", b"99999999999", b"", b"x", b"null", b"1e-320", b"[]")
    )
    return content[: found.start()] + odd + content[found.end() :]


def _shuffle_lines(content: bytes, chance: random.Random) -> bytes:
    lines = content.split(b"\n")
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 1, 2))):
        lines.insert(chance.randrange(len(lines) + 1), line)
    return b"\n".join(lines)


DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _cut, _flip_bits, _flip_bits, _overwrite, _remove, _repeat, _insert, _replace_number, _shuffle_lines,
)  # fmt: skip


def damage(content: bytes, chance: random.Random) -> tuple[bytes, str]:
    """Other bytes, and how they came about: one to three damages, one after the other."""
    steps = [chance.choice(DAMAGES) for _ in range(chance.choice((1, 1, 2, 3)))]
    for step in steps:
        content = step(content, chance) or b"\0"
    return content, " ".join(step.__name__.strip("_") for step in steps)


def _serve(jobs: Connection) -> None:
    """A child: read what is asked for, tell the verdict and the most memory held, for ever."""
    from engine.errors import RoomlightError
    from hardware.errors import HardwareError

    resource.setrlimit(
        resource.RLIMIT_AS, (MOST_BYTES * 8, MOST_BYTES * 8)
    )  # far above: the peak is what is judged
    while True:
        kind, path = jobs.recv()
        Path("/proc/self/clear_refs").write_text("5")  # begins the peak anew
        try:
            fuzz_samples.KINDS[kind].read(Path(path))
            verdict = READ
        except (RoomlightError, HardwareError) as fault:
            text = " ".join(str(fault).split())  # as the command line prints it
            verdict = (
                REFUSED if len(text) < LONGEST_LINE else f"a line of {len(text)} characters: {text[:200]}"
            )
        except BaseException as fault:  # what must never reach a user is what is looked for
            verdict = f"{type(fault).__name__}: {' '.join(str(fault).split())[:200]}"
        held = re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())
        jobs.send((verdict, int(held[1]) << 10 if held else 0))


class Reader:
    """A child that reads files; replaced when it dies or takes too long."""

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        self._jobs, theirs = multiprocessing.Pipe()
        self._child = multiprocessing.get_context("fork").Process(target=_serve, args=(theirs,), daemon=True)
        self._child.start()
        theirs.close()

    def read(self, kind: str, path: Path) -> tuple[str, float, int]:
        """Verdict, seconds, and the most memory held in bytes."""
        begun = time.monotonic()
        self._jobs.send((kind, str(path)))
        try:
            if self._jobs.poll(2 * LONGEST_S):
                verdict, memory = self._jobs.recv()
                return verdict, time.monotonic() - begun, memory
            verdict = "never ends"
        except EOFError:
            self._child.join()
            verdict = f"died ({self._child.exitcode})"
        self.stop()
        self._start()
        return verdict, time.monotonic() - begun, 0

    def stop(self) -> None:
        self._child.kill()
        self._child.join()


def run(files: int, seed: int, kinds: Sequence[str], keep: Path | None = None) -> list[Outcome]:
    """Damage and read about `files` files, as many of each kind."""
    outcomes = []
    with tempfile.TemporaryDirectory() as scratch:
        reader = Reader()
        try:
            for kind in kinds:
                sample = fuzz_samples.KINDS[kind]
                whole = sample.write(Path(scratch) / kind)
                verdict, *_ = reader.read(kind, whole)
                assert verdict == READ, f"the whole sample of {kind} is not read: {verdict}"
                within = (
                    whole
                    if whole.is_dir() and sample.damaged and (whole / sample.damaged[0]).exists()
                    else whole.parent
                )
                parts = [within / name for name in sample.damaged] or [whole]
                untouched = {part: part.read_bytes() for part in parts}
                for number in range(max(1, files // len(kinds))):
                    chance = random.Random(f"{seed} {kind} {number}")
                    part = chance.choice(parts)
                    content, change = damage(untouched[part], chance)
                    part.write_bytes(content)
                    outcome = Outcome(kind, *reader.read(kind, whole), f"{part.name} {number}: {change}")
                    if outcome.broken and keep:
                        shutil.copytree(whole.parent, keep / f"{kind}-{number}", dirs_exist_ok=True)
                    outcomes.append(outcome)
                    part.write_bytes(untouched[part])
        finally:
            reader.stop()
    return outcomes


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--files", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=fuzz_samples.KINDS, action="append", help="of these kinds alone")
    parser.add_argument("--keep", type=Path, help="folder for the files that broke a promise")
    args = parser.parse_args()
    outcomes = run(args.files, args.seed, args.only or list(fuzz_samples.KINDS), args.keep)
    print(
        f"{'kind':20s} {'files':>5s} {'read':>5s} {'refused':>7s} {'broken':>6s} {'slowest':>8s} {'most memory':>11s}"
    )
    for kind in dict.fromkeys(one.kind for one in outcomes):
        of_kind = [one for one in outcomes if one.kind == kind]
        count = [sum(one.verdict == verdict for one in of_kind) for verdict in (READ, REFUSED)]
        slowest, most = max(one.seconds for one in of_kind), max(one.memory_bytes for one in of_kind)
        broken = sum(one.broken for one in of_kind)
        print(
            f"{kind:20s} {len(of_kind):5d} {count[0]:5d} {count[1]:7d} {broken:6d} {slowest:6.2f} s {most >> 20:7d} MiB"
        )
    broken = [one for one in outcomes if one.broken]
    for one in broken:
        print(f"{one.kind}, {one.change}: {one.verdict} ({one.seconds:.2f} s, {one.memory_bytes >> 20} MiB)")
    print(f"{len(outcomes)} files, {len(broken)} of them broke a promise")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
