import datetime

import numpy as np
import pytest
import rawpy
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from hardware.errors import StudioError
from hardware.virtual import dng, sensor

CAMERA = sensor.Sensor()
WHEN = datetime.datetime(2024, 2, 29, 23, 59, 58, 7000)


def photograph(mosaic: np.ndarray, **facts: object) -> dng.Photograph:
    given_facts = {
        "black": 512, "white": 16383, "camera_from_xyz": CAMERA.camera_from_xyz, "neutral": (0.5, 1.0, 0.75),
        "shutter_s": 1 / 437, "iso": 100, "aperture": 5.6, "time": WHEN,
    } | facts  # fmt: skip
    return dng.Photograph(mosaic, **given_facts)


def counts(h: int, w: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 16384, (h, w)).astype(np.uint16)


@settings(max_examples=12, deadline=None)
@given(half=st.tuples(st.integers(12, 60), st.integers(12, 60)), seed=st.integers(0, 99))
def test_libraw_reads_back_every_count(tmp_path_factory, half, seed):
    mosaic = counts(2 * half[0], 2 * half[1], seed)
    path = tmp_path_factory.mktemp("dng") / "a.dng"
    dng.write(path, photograph(mosaic))
    with rawpy.imread(str(path)) as raw:
        np.testing.assert_array_equal(raw.raw_image_visible, mosaic)


def test_libraw_reads_levels_pattern_and_exposure(tmp_path):
    path = tmp_path / "a.dng"
    dng.write(path, photograph(counts(64, 96), black=500, white=15000 + 1383))
    with rawpy.imread(str(path)) as raw:
        assert raw.raw_colors_visible[:2, :2].tolist() == [[0, 1], [3, 2]]
        assert raw.black_level_per_channel == [500] * 4
        assert raw.white_level == 16383
        assert raw.other.shutter_speed == pytest.approx(1 / 437, rel=1e-6)
        assert raw.other.iso_speed == 100
        assert raw.other.aperture == pytest.approx(5.6)
        assert raw.other.timestamp.replace(tzinfo=None) == WHEN.replace(microsecond=0)
        assert raw.camera_whitebalance[:3] == pytest.approx([2.0, 1.0, 4 / 3], rel=1e-5)
        assert raw.sizes.flip == 0


def test_libraw_undoes_the_colour_matrix(tmp_path):
    path = tmp_path / "a.dng"
    dng.write(path, photograph(counts(64, 96)))
    with rawpy.imread(str(path)) as raw:
        rec709_from_camera = raw.color_matrix[:, :3] * np.array(raw.daylight_whitebalance[:3])
    product = rec709_from_camera @ CAMERA.camera_from_rec709()
    np.testing.assert_allclose(product / product[0, 0], np.eye(3), atol=1e-4)


def test_tags_say_what_another_reader_expects(tmp_path):
    path = tmp_path / "a.dng"
    dng.write(path, photograph(counts(64, 96)))
    with tifffile.TiffFile(path) as tiff:
        tags = {tag.code: tag.value for tag in tiff.pages.first.tags.values()}
    assert (tags[271], tags[272]) == (dng.MAKE, dng.MODEL)
    assert tags[259] == 7  # lossless JPEG
    assert tags[34665]["DateTimeOriginal"] == "2024:02:29 23:59:58"
    assert tags[34665]["SubsecTimeOriginal"] == "007"
    assert bytes(tags[33422]) == bytes((0, 1, 1, 2))


def test_a_bundled_capture_of_48_brackets_fits_25_megabytes(tmp_path):
    path = tmp_path / "a.dng"
    dng.write(path, photograph(counts(240, 320)))
    assert 48 * 3 * path.stat().st_size < 25e6


def test_an_odd_size_is_refused(tmp_path):
    with pytest.raises(StudioError, match="even"):
        dng.write(tmp_path / "a.dng", photograph(counts(63, 96)))
    assert not (tmp_path / "a.dng").exists()


def test_counts_above_white_are_refused(tmp_path):
    mosaic = counts(64, 96)
    mosaic[3, 4] = 16383
    with pytest.raises(StudioError, match="16383 is above the white level 9000"):
        dng.write(tmp_path / "a.dng", photograph(mosaic, white=9000))
