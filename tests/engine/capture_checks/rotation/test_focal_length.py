import struct

import numpy as np
import pytest

from engine.capture_checks.rotation import focal_length
from engine.capture_checks.rotation.overlap import ViewPair
from tests.engine.capture_checks.broken import write
from tests.engine.capture_checks.rotation.test_two_view import FOCAL, PIXEL, pair


def link(seed: int) -> ViewPair:
    a, b, _ = pair(seed, 25.0)
    return ViewPair(0, 1, len(a), (), (a, b), PIXEL)


def test_pairs_of_shots_tell_the_focal_length():
    tally = np.stack(
        [focal_length.misfits(link(seed)) for seed in range(4)] * (focal_length.FEWEST_PAIRS // 4)
    )
    assert focal_length.agreed(tally) == pytest.approx(FOCAL, rel=0.04)
    assert focal_length.agreed(tally[:-1]) is None


def test_a_tally_that_says_nothing_is_not_believed():
    rng = np.random.default_rng(0)
    assert focal_length.agreed(0.01 * rng.random((20, len(focal_length.GRID)))) is None
    slope = np.tile(np.linspace(0, 3, len(focal_length.GRID)), (20, 1))
    assert focal_length.agreed(slope) is None  # the best one may lie beyond the grid


def with_exif(path, entries: dict[int, tuple[int, int]]) -> None:
    """A TIFF with these rational Exif tags (or shorts, where the denominator is 0)."""
    exif_at = 8 + 2 + 12 + 4
    tail_at = exif_at + 2 + 12 * len(entries) + 4
    directory, tail = b"", b""
    for number, (over, under) in sorted(entries.items()):
        if under:
            directory += struct.pack("<HHII", number, 5, 1, tail_at + len(tail))
            tail += struct.pack("<II", over, under)
        else:
            directory += struct.pack("<HHIHH", number, 3, 1, over, 0)
    path.write_bytes(
        struct.pack("<2sHI", b"II", 42, 8)
        + struct.pack("<HHHIII", 1, 34665, 4, 1, exif_at, 0)
        + struct.pack("<H", len(entries)) + directory + struct.pack("<I", 0) + tail
    )  # fmt: skip


def test_exif_tells_the_focal_length(tmp_path):
    file = tmp_path / "a.tif"
    with_exif(file, {41989: (35, 0)})
    assert focal_length.field_of_view_deg(focal_length.told(file, 6000, 4000)) == pytest.approx(54.4, abs=0.2)
    # 24 mm on a sensor 23.5 mm wide, of 6000 pixels: 2553 to the centimetre.
    with_exif(file, {37386: (24, 1), 41486: (25532, 10), 41488: (3, 0)})
    assert focal_length.field_of_view_deg(focal_length.told(file, 6000, 4000)) == pytest.approx(52.2, abs=0.2)


def test_what_exif_does_not_tell_is_not_made_up(tmp_path):
    file = tmp_path / "a.tif"
    with_exif(file, {37386: (24, 1)})  # without the sensor's size
    assert focal_length.told(file, 6000, 4000) is None
    with_exif(file, {41989: (0, 0)})
    assert focal_length.told(file, 6000, 4000) is None
    write(tmp_path / "b.dng", np.full((40, 60), 900, np.uint16), 0.01)
    assert focal_length.told(tmp_path / "b.dng", 60, 40) is None
    file.write_bytes(b"II*\0" + bytes(50))
    assert focal_length.told(file, 6000, 4000) is None


def test_a_focal_length_and_its_field_of_view_go_together():
    for degrees in (20.0, 60.0, 100.0):
        assert focal_length.field_of_view_deg(focal_length.focal_of(degrees)) == pytest.approx(degrees)
    assert focal_length.focal_of(90.0) == pytest.approx(0.5)
