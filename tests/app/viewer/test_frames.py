"""Pictures through shared memory: whole, newest wins, never a mixture, nothing left behind."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.viewer import frames
from app.viewer.frames import FrameReader, FrameWriter, MemoryFull, slot_bytes

ROOT = Path(__file__).parents[3]


@pytest.fixture
def pair() -> Iterator[tuple[FrameReader, FrameWriter]]:
    reader = FrameReader(slot_bytes(4, 3))
    writer = FrameWriter(reader.name, reader.slot_bytes)
    yield reader, writer
    writer.close()
    reader.close()


def picture(value: int) -> np.ndarray:
    return np.full((3, 4, 4), value, np.uint8)


def test_a_picture_arrives_as_it_was(pair: tuple[FrameReader, FrameWriter]) -> None:
    reader, writer = pair
    sent = np.arange(48, dtype=np.uint8).reshape(3, 4, 4)
    assert reader.copy(*writer.write(sent), 48) == sent.tobytes()


def test_the_last_picture_stays_while_the_next_is_written(pair: tuple[FrameReader, FrameWriter]) -> None:
    reader, writer = pair
    first, second = writer.write(picture(1)), writer.write(picture(2))
    assert first[0] != second[0]
    assert reader.copy(*first, 48) == picture(1).tobytes()
    assert reader.copy(*second, 48) == picture(2).tobytes()


def test_a_picture_that_was_overwritten_is_not_handed_out(pair: tuple[FrameReader, FrameWriter]) -> None:
    reader, writer = pair
    first = writer.write(picture(1))
    writer.write(picture(2))
    writer.write(picture(3))
    assert reader.copy(*first, 48) is None


def test_a_picture_that_is_being_written_is_not_handed_out(pair: tuple[FrameReader, FrameWriter]) -> None:
    reader, writer = pair
    slot, stamp = writer.write(picture(1))
    start = slot * (reader.slot_bytes + frames._HEAD)
    frames._STAMP.pack_into(reader._memory.buf, start, stamp + 3)  # odd: somebody writes
    assert reader.copy(slot, stamp, 48) is None


@pytest.mark.parametrize("looks", [(1, 0), (0, 1)], ids=["before", "while"])
def test_a_picture_overwritten_before_or_while_it_is_copied_is_not_handed_out(
    pair: tuple[FrameReader, FrameWriter], monkeypatch: pytest.MonkeyPatch, looks: tuple[int, int]
) -> None:
    reader, writer = pair
    slot, stamp = writer.write(picture(1))

    class Stamps:
        answers = iter([stamp + 2 * later for later in looks])

        def unpack_from(self, buffer: memoryview, start: int) -> tuple[int]:
            return (next(self.answers),)

    monkeypatch.setattr(frames, "_STAMP", Stamps())
    assert reader.copy(slot, stamp, 48) is None


def test_a_lie_about_size_or_slot_reads_nothing(pair: tuple[FrameReader, FrameWriter]) -> None:
    reader, writer = pair
    slot, stamp = writer.write(picture(1))
    for claimed in ((slot, stamp, 10**9), (7, stamp, 48), (slot, stamp, 0), (-1, stamp, 48)):
        assert reader.copy(*claimed) is None


def test_the_memory_is_gone_when_the_window_closes_it() -> None:
    reader = FrameReader(48)
    name = reader.name
    reader.close()
    assert not Path("/dev/shm", name).exists()
    with pytest.raises(FileNotFoundError):
        FrameWriter(name, 48)


def test_a_childs_end_leaves_the_windows_memory_alone() -> None:
    reader = FrameReader(48)
    code = f"from app.viewer.frames import FrameWriter; FrameWriter({reader.name!r}, 48)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    FrameWriter(reader.name, 48).close()
    reader.close()


def test_too_little_memory_is_said_before_it_is_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        f_bavail, f_frsize = 3, 4096

    monkeypatch.setattr(os, "statvfs", lambda path: Full())
    with pytest.raises(MemoryFull, match="not free"):
        FrameReader(1 << 20)
