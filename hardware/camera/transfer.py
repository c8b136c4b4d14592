"""Bring a photograph's bytes to their place: written beside it, synced, read back and checked, then renamed.

A file that has its final name is whole, whatever crashed meanwhile.
"""

import contextlib
import errno
import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from hardware.errors import ExposureError, HardwareError

PIECE = 1 << 20  # bytes read at a time

_REMEDY = {
    errno.ENOSPC: "the disk is full; free some space",
    errno.EDQUOT: "your disk quota is used up; free some space",
    errno.EACCES: "no permission to write here; choose another folder",
    errno.EROFS: "the disk is read-only; choose another one",
}


@dataclass(frozen=True, slots=True)
class Arrived:
    """What lies on the disk now."""

    sha256: str
    bytes: int


def pieces(source: Path) -> Iterable[bytes]:
    """A file's bytes, a bit at a time."""
    with source.open("rb") as reader:
        while piece := reader.read(PIECE):
            yield piece


def file_sha256(path: Path) -> str:
    with path.open("rb") as reader:
        return hashlib.file_digest(reader, "sha256").hexdigest()


def deliver(
    content: Iterable[bytes], to: Path, size: int | None = None, sha256: str | None = None
) -> Arrived:
    """Write `content` to the file `to`, replacing what is there.

    Args:
        size: bytes that were promised; None where the camera does not tell.
        sha256: likewise.

    Raises:
        ExposureError: what arrived is not what was promised; `to` is as it was.
        HardwareError: the disk refused; `to` is as it was.
    """
    beside = to.with_name(f".{to.name}.partial")
    digest, count = hashlib.sha256(), 0
    try:
        with beside.open("wb") as writer:
            for piece in content:
                digest.update(piece)
                count += len(piece)
                writer.write(piece)
            writer.flush()
            os.fsync(writer.fileno())
        if size is not None and count != size:
            raise ExposureError(f"{to.name}: {count} of {size} bytes arrived; check the cable")
        if sha256 is not None and digest.hexdigest() != sha256:
            raise ExposureError(f"{to.name}: its bytes changed on the way; check the cable")
        if file_sha256(beside) != digest.hexdigest():
            raise ExposureError(f"{to.name}: the disk holds other bytes than were written; check the disk")
        beside.replace(to)
        _sync(to.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        remedy = _REMEDY.get(error.errno or 0, f"{error.strerror or error}; check the disk and its folder")
        raise HardwareError(f"{to}: cannot be written: {remedy}") from error
    except BaseException:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise
    return Arrived(digest.hexdigest(), count)


def _sync(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
