import errno
import hashlib
import os
from pathlib import Path

import pytest

from hardware.camera import transfer
from hardware.errors import ExposureError, HardwareError

CONTENT = [b"abc" * 1000, b"", b"def"]
WHOLE = b"".join(CONTENT)
SHA = hashlib.sha256(WHOLE).hexdigest()


def test_what_was_promised_arrives(tmp_path: Path):
    arrived = transfer.deliver(CONTENT, tmp_path / "a.dng", len(WHOLE), SHA)
    assert (arrived.sha256, arrived.bytes) == (SHA, len(WHOLE))
    assert (tmp_path / "a.dng").read_bytes() == WHOLE
    assert [path.name for path in tmp_path.iterdir()] == ["a.dng"]


@pytest.mark.parametrize(
    ("size", "sha256"), [(len(WHOLE) + 1, None), (len(WHOLE) - 1, SHA), (None, "0" * 64)]
)
def test_what_is_not_what_was_promised_leaves_everything_as_it_was(tmp_path: Path, size, sha256):
    (tmp_path / "a.dng").write_bytes(b"before")
    with pytest.raises(ExposureError, match="cable"):
        transfer.deliver(CONTENT, tmp_path / "a.dng", size, sha256)
    assert [path.name for path in tmp_path.iterdir()] == ["a.dng"]
    assert (tmp_path / "a.dng").read_bytes() == b"before"


def test_a_transfer_broken_off_leaves_nothing(tmp_path: Path):
    def pieces():
        yield b"half"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        transfer.deliver(pieces(), tmp_path / "a.dng")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("number", "remedy"), [(errno.ENOSPC, "free some space"), (errno.EROFS, "another one"), (errno.EIO, "check the disk")]
)  # fmt: skip
def test_a_disk_that_refuses_is_told_with_a_remedy(tmp_path: Path, monkeypatch, number, remedy):
    def refuse(handle: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(HardwareError, match=remedy):
        transfer.deliver(CONTENT, tmp_path / "a.dng")
    assert not list(tmp_path.iterdir())


def test_bytes_that_a_disk_changes_are_noticed(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(transfer, "file_sha256", lambda path: "other")
    with pytest.raises(ExposureError, match="disk"):
        transfer.deliver(CONTENT, tmp_path / "a.dng")
    assert not list(tmp_path.iterdir())
