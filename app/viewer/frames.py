"""Pictures in shared memory: two slots written in turn, the newest wins, a torn one is noticed.

A slot is a stamp (8 bytes, odd while somebody writes) and the pixels: rows from the top, blue green red and one
unused byte each, as QImage's RGB32. The window owns the memory; the child only writes. A reader copies between two
looks at the stamp, so neither side ever waits for the other.
"""

import contextlib
import itertools
import os
import secrets
import struct
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

SLOTS = 2
BYTES_A_PIXEL = 4
_STAMP = struct.Struct("<Q")
_HEAD = 64  # keeps pixels on a cache line of their own
_SHM = Path("/dev/shm")


class MemoryFull(Exception):
    """The system has no shared memory left for pictures."""


def slot_bytes(width: int, height: int) -> int:
    return width * height * BYTES_A_PIXEL


class FrameReader:
    """The window's side; makes the memory and removes it."""

    def __init__(self, bytes_a_slot: int) -> None:
        """
        Raises:
            MemoryFull: there is no room; touching it nevertheless would kill the process.
        """
        needed = SLOTS * (bytes_a_slot + _HEAD)
        if _SHM.is_dir():
            room = os.statvfs(_SHM)
            if room.f_bavail * room.f_frsize < needed:
                raise MemoryFull(
                    f"{_SHM}: {needed >> 20} MiB are needed for pictures and are not free; remove files there"
                    " or, in a container, start it with a larger --shm-size"
                )
        self.slot_bytes = bytes_a_slot
        self._memory = SharedMemory(f"roomlight_{secrets.token_hex(6)}", create=True, size=needed)

    @property
    def name(self) -> str:
        return self._memory.name

    def copy(self, slot: int, stamp: int, size: int) -> bytes | None:
        """The pixels of a frame; None when a newer one has taken its place."""
        buffer = _bytes_of(self._memory)
        start = slot * (self.slot_bytes + _HEAD)
        if not 0 <= slot < SLOTS or not 0 < size <= self.slot_bytes:
            return None
        if _STAMP.unpack_from(buffer, start)[0] != stamp:
            return None
        pixels = bytes(buffer[start + _HEAD : start + _HEAD + size])
        return pixels if _STAMP.unpack_from(buffer, start)[0] == stamp else None

    def close(self) -> None:
        self._memory.close()
        with contextlib.suppress(FileNotFoundError):
            self._memory.unlink()


class FrameWriter:
    """The child's side."""

    def __init__(self, name: str, bytes_a_slot: int) -> None:
        self.slot_bytes = bytes_a_slot
        self._memory = SharedMemory(name)
        # Python before 3.13 would remove the memory, which is the window's, when this process ends.
        resource_tracker.unregister(self._memory._name, "shared_memory")  # pyrefly: ignore[missing-attribute]
        self._turn = itertools.count(1)

    def write(self, pixels: UInt8[np.ndarray, "h w 4"]) -> tuple[int, int]:
        """Put a picture into the next slot; (slot, stamp) tell a reader where it is."""
        turn = next(self._turn)
        slot, stamp = turn % SLOTS, 2 * turn
        start = slot * (self.slot_bytes + _HEAD)
        buffer = _bytes_of(self._memory)
        _STAMP.pack_into(buffer, start, stamp - 1)
        target = np.frombuffer(buffer, np.uint8, pixels.size, start + _HEAD)
        target[:] = pixels.reshape(-1)
        _STAMP.pack_into(buffer, start, stamp)
        return slot, stamp

    def close(self) -> None:
        self._memory.close()


def _bytes_of(memory: SharedMemory) -> memoryview:
    """
    Raises:
        ValueError: it was closed.
    """
    if memory.buf is None:
        raise ValueError(f"the shared memory {memory.name} is closed")
    return memory.buf
