"""Tags are found wherever a RAW format keeps its header, and no oddity of one hides the others."""

import struct
from pathlib import Path

import pytest

from engine.io.formats import exif
from tests.hardware.camera.test_exif import directory

CAMERA = directory((271, 2, 6, b"Canon\0"), (272, 2, 13, b"Canon EOS R8\0"))
EXPOSURE = directory((33434, 5, 1, struct.pack("<II", 1, 250)), (34855, 3, 1, struct.pack("<H", 100)))


def test_headers_of_a_container_are_put_together(tmp_path: Path) -> None:
    path = tmp_path / "a.cr3"
    path.write_bytes(
        b"\0\0\0\x18ftypcrx " + CAMERA + EXPOSURE + directory((34855, 3, 1, struct.pack("<H", 9)))
    )
    tags, end = exif.read_tags(path)
    assert (exif.camera(tags), exif.number(tags["ExposureTime"]), exif.iso(tags)) == (
        "Canon EOS R8",
        0.004,
        100,
    )
    assert end == 0


@pytest.mark.parametrize("mark", [b"IIRO", b"IIRS", b"IIU\0"])
def test_olympus_and_panasonic_write_tiff_under_marks_of_their_own(tmp_path: Path, mark: bytes) -> None:
    (tmp_path / "a.orf").write_bytes(mark + CAMERA[4:])
    assert exif.camera(exif.read_tags(tmp_path / "a.orf")[0]) == "Canon EOS R8"


def test_a_header_at_the_end_of_the_file_is_found_and_tells_a_cut_off_file(tmp_path: Path) -> None:
    far = exif.HEADER_BYTES + 1000
    (tmp_path / "a.dng").write_bytes(
        struct.pack("<2sHI", b"II", 42, far) + bytes(far - 8) + directory((272, 2, 4, b"K-1\0"))[8:]
    )
    assert exif.camera(exif.read_tags(tmp_path / "a.dng")[0]) == "K-1"
    tiled = directory((324, 4, 2, struct.pack("<II", 500, 900)), (325, 4, 2, struct.pack("<II", 100, 50)))
    (tmp_path / "b.dng").write_bytes(tiled)
    assert exif.read_tags(tmp_path / "b.dng")[1] == 950


def test_what_cannot_be_read_hides_nothing_else_and_is_told_on_no_console(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    broken = directory(
        (271, 2, 6, b"Canon\0"), (272, 2, 13, b"Canon EOS R8\0"), (33434, 5, 1, b"\xff\xff\xff\x7f")
    )
    (tmp_path / "a.nef").write_bytes(broken)
    assert exif.camera(exif.read_tags(tmp_path / "a.nef")[0]) == "Canon EOS R8"
    assert capfd.readouterr() == ("", "")
