import struct
from pathlib import Path

import pytest
from PIL import Image

from hardware.camera import exif
from tests.hardware.camera import photographs

NOON_S = 1717243200.0


def test_a_dng_tells_its_exposure_time_and_camera(tmp_path: Path):
    told = exif.read(photographs.write(tmp_path / "a.dng", 1 / 437, 400, 12.25, model="Other Two"))
    assert told.shutter_s == pytest.approx(1 / 437)
    assert told.iso == 400
    assert told.aperture == 8.0
    assert told.time_s == NOON_S + 12.25
    assert told.camera == "Roomlight Other Two"


def test_light_is_counted_in_stops(tmp_path: Path):
    dark = exif.read(photographs.write(tmp_path / "a.dng", 1 / 64, 100)).light_ev()
    bright = exif.read(photographs.write(tmp_path / "b.dng", 1 / 16, 200)).light_ev()
    assert dark is not None
    assert bright is not None
    assert bright - dark == pytest.approx(3.0)


def test_a_jpeg_tells_its_exposure(tmp_path: Path):
    tags = Image.Exif()
    tags[271], tags[272] = "Canon", "Canon EOS R8"
    tags.get_ifd(0x8769).update({33434: 0.5, 34855: 800, 33437: 2.8, 36867: "2024:06:01 12:00:00"})
    Image.new("RGB", (8, 8)).save(tmp_path / "a.jpg", exif=tags)
    told = exif.read(tmp_path / "a.jpg")
    assert told == exif.Exif(0.5, 800, pytest.approx(2.8), NOON_S, "Canon EOS R8")


def directory(*tags: tuple[int, int, int, bytes]) -> bytes:
    """A TIFF of one directory: number, type, count, value."""
    entries, tail, at = b"", b"", 8 + 2 + 12 * len(tags) + 4
    for number, kind, count, value in tags:
        field = value.ljust(4, b"\0")
        if len(value) > 4:
            field, tail = struct.pack("<I", at + len(tail)), tail + value
        entries += struct.pack("<HHI", number, kind, count) + field
    return struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + b"\0" * 4 + tail


def test_two_headers_in_a_container_are_put_together_as_in_a_cr3(tmp_path: Path):
    camera = directory((271, 2, 6, b"Canon\0"), (272, 2, 13, b"Canon EOS R8\0"))
    exposure = directory((33434, 5, 1, struct.pack("<II", 1, 250)), (34855, 3, 1, struct.pack("<H", 100)))
    boxes = b"".join(
        struct.pack(">I4s", 8 + len(content), name) + content
        for name, content in ((b"ftyp", b"crx \0\0\0\1"), (b"CMT1", camera), (b"CMT2", exposure))
    )
    (tmp_path / "a.cr3").write_bytes(boxes + bytes(1000))
    told = exif.read(tmp_path / "a.cr3")
    assert (told.shutter_s, told.iso, told.camera) == (pytest.approx(0.004), 100, "Canon EOS R8")


@pytest.mark.parametrize(
    "content", [b"", b"II*\0", b"MM\0*" * 50, b"\xff\xd8\xff\xe0 no Exif", bytes(range(256)) * 40]
)
@pytest.mark.parametrize("name", ["a.dng", "a.jpg"])
def test_a_file_that_tells_nothing_is_no_error(tmp_path: Path, name, content):
    (tmp_path / name).write_bytes(content)
    assert exif.read(tmp_path / name) == exif.Exif(None, None, None, None, "")


def test_a_header_cut_off_anywhere_is_no_error(tmp_path: Path):
    whole = photographs.write(tmp_path / "a.dng").read_bytes()
    for end in range(0, 700, 7):
        (tmp_path / "b.jpg").write_bytes(whole[:end])
        exif.read(tmp_path / "b.jpg")


@pytest.mark.parametrize(
    ("tags", "iso"),
    [
        ([(34855, 3, 2, struct.pack("<HH", 200, 0))], 200),
        ([(34855, 3, 2, struct.pack("<HH", 0, 400))], 400),
        ([(34855, 3, 1, struct.pack("<H", 65535)), (34866, 4, 1, struct.pack("<I", 102400))], 102400),
        ([(34855, 3, 1, struct.pack("<H", 65535))], None),
    ],
)
def test_iso_is_read_where_one_number_is_not_all(tmp_path: Path, tags: list, iso: float | None):
    exposure = directory((33434, 5, 1, struct.pack("<II", 1, 250)), *tags)
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8" + exposure)
    assert exif.read(tmp_path / "a.jpg").iso == iso
