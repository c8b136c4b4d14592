import math
import time

import numpy as np
import pytest
import tifffile

from engine.errors import RawError
from engine.raw import read_facts, read_mosaic
from hardware.virtual import dng, sensor
from tests.engine import brackets_on_disk as disk


@pytest.fixture
def bracket(tmp_path):
    return disk.write(tmp_path, "0000", disk.scene(64, 96, 0), 0.05)


def test_facts_are_those_of_the_exposure(bracket):
    facts = [read_facts(path) for path in bracket.exposures]
    assert facts[0].camera == "Roomlight Virtual One"
    assert (facts[0].width, facts[0].height, facts[0].orientation) == (96, 64, 0)
    assert [fact.shutter_s for fact in facts] == pytest.approx([0.05 / 8, 0.05, 0.4], rel=1e-6)
    assert facts[1].exposure() == pytest.approx(0.05 / 64, rel=1e-6)
    assert facts[1].time_s - facts[0].time_s == pytest.approx(0.05 / 8 + sensor.READOUT_S, abs=2e-3)


def test_the_time_zone_of_this_machine_changes_no_time(bracket, monkeypatch):
    before = read_facts(bracket.exposures[0]).time_s
    monkeypatch.setenv("TZ", "Pacific/Auckland")
    time.tzset()
    try:
        assert read_facts(bracket.exposures[0]).time_s == before
    finally:
        monkeypatch.delenv("TZ")
        time.tzset()


def test_mosaic_holds_counts_levels_and_pattern(bracket, tmp_path):
    counts = np.random.default_rng(0).integers(0, 16384, (64, 96)).astype(np.uint16)
    camera = sensor.Sensor()
    path = tmp_path / "x.dng"
    dng.write(
        path,
        dng.Photograph(
            counts, 512, 16383, camera.camera_from_xyz, camera.neutral(), 0.1, 100, 8.0, disk.START
        ),
    )
    mosaic = read_mosaic(path)
    np.testing.assert_array_equal(mosaic.counts, counts)
    assert mosaic.pattern.tolist() == [[0, 1], [3, 2]]
    assert mosaic.black == (512,) * 4
    assert mosaic.white == (16383,) * 4


def test_colour_matrix_takes_camera_rgb_back_to_rec709(bracket):
    matrix = read_mosaic(bracket.exposures[0]).rec709_from_camera
    np.testing.assert_allclose(matrix @ sensor.Sensor().camera_from_rec709(), np.eye(3), atol=1e-5)


def test_unknown_aperture_counts_as_f1(tmp_path):
    bracket = disk.write(tmp_path, "a", disk.scene(64, 96, 0), 0.05)
    data = bytearray(bracket.exposures[0].read_bytes())
    # Turn both FNumber tags (33437) into an unknown one, as with a lens that has no contacts.
    while (at := data.find((33437).to_bytes(2, "little") + (5).to_bytes(2, "little"))) >= 0:
        data[at : at + 2] = (33436).to_bytes(2, "little")
    path = tmp_path / "manual.dng"
    path.write_bytes(data)
    facts = read_facts(path)
    assert math.isnan(facts.aperture)
    assert facts.exposure() == pytest.approx(0.05 / 8, rel=1e-6)


@pytest.mark.parametrize("keep", [0, 300, 5000])
def test_a_cut_off_file_is_refused_by_name(bracket, tmp_path, keep):
    path = tmp_path / "cut.dng"
    path.write_bytes(bracket.exposures[0].read_bytes()[:keep])
    with pytest.raises(RawError, match=r"cut\.dng: .*copy the file again"):
        read_mosaic(path)


def test_a_file_of_another_kind_is_refused(tmp_path):
    path = tmp_path / "notes.cr2"
    path.write_bytes(b"not a photograph" * 500)
    for read in (read_facts, read_mosaic):
        with pytest.raises(RawError, match="not a RAW file LibRaw can open"):
            read(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(RawError, match="no such file"):
        read_facts(tmp_path / "gone.dng")


def test_a_file_that_may_not_be_read_is_refused_as_that(tmp_path, monkeypatch):
    path = tmp_path / "locked.dng"
    path.touch()
    monkeypatch.setattr("os.access", lambda file, mode: False)  # whoever runs this may read everything
    with pytest.raises(RawError, match=r"locked\.dng: no permission to read it; change its permissions"):
        read_mosaic(path)


def test_xtrans_is_refused_with_a_remedy(tmp_path, monkeypatch):
    bayer = dng._image
    # G B G G R G / R G R B G B / G B G G R G, and the same with red and blue changed over.
    xtrans = [int(c) for c in "121101010212121101101121212010101121"]
    swapped = {33421: (33421, dng.SHORT, [6, 6]), 33422: (33422, dng.BYTE, xtrans)}
    monkeypatch.setattr(dng, "_image", lambda *given: [swapped.get(tag[0], tag) for tag in bayer(*given)])
    bracket = disk.write(tmp_path, "a", disk.scene(66, 96, 0), 0.05)
    with pytest.raises(RawError, match=r"X-Trans.*develop to linear EXR"):
        read_mosaic(bracket.exposures[0])


def test_a_developed_tiff_is_refused(tmp_path):
    path = tmp_path / "developed.tif"
    tifffile.imwrite(path, np.zeros((64, 96, 3), np.uint16), photometric="rgb")
    with pytest.raises(RawError):
        read_mosaic(path)
