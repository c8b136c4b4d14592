import math
import struct
import time

import numpy as np
import pytest
import rawpy
import tifffile

from engine.errors import RawError
from engine.io.raw import XYZ_FROM_REC709, read_facts, read_mosaic
from hardware.virtual import dng, sensor
from tests.engine import brackets_on_disk as disk
from tests.engine import foreign_raw


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


MAKERS = [
    ("SONY", "ILCE-7M3", "ARW"), ("SONY", "ILCE-6400", "ARW"), ("NIKON CORPORATION", "NIKON D850", "NEF"),
    ("NIKON CORPORATION", "NIKON Z 8", "NEF"), ("Canon", "Canon EOS R5", "CR2"), ("Canon", "Canon EOS 80D", "CR2"),
    ("PENTAX", "PENTAX K-1", "PEF"), ("Panasonic", "DC-GH5", "RW2"), ("FUJIFILM", "GFX 50S", "RAF"),
    ("SAMSUNG", "NX500", "SRW"), ("LEICA CAMERA AG", "LEICA Q2", "DNG"), ("Phase One", "IQ3 100MP", "IIQ"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "model", "suffix"), MAKERS)
def test_a_makers_own_file_has_the_colour_that_a_dng_of_it_has(tmp_path, make, model, suffix):
    path = foreign_raw.write_maker(tmp_path / f"own.{suffix}", make, model)
    own = read_mosaic(path)
    assert own.facts.camera.endswith(model)
    np.testing.assert_array_equal(own.counts, foreign_raw.counts())
    with rawpy.imread(str(path)) as raw:
        assert not raw.color_matrix.any()
        camera_from_xyz = raw.rgb_xyz_matrix[:3].astype(float)
    # White is what a white sheet under daylight gives; its green sites keep their value.
    white = np.linalg.inv(own.rec709_from_camera).sum(axis=1)
    camera_white = camera_from_xyz @ XYZ_FROM_REC709.sum(axis=1)
    np.testing.assert_allclose(white, camera_white / camera_white[1], rtol=1e-6)
    rounded = dng._fractions(camera_from_xyz.round(4).ravel().tolist())
    converted = foreign_raw.write(
        tmp_path / "a.dng",
        foreign_raw.counts(),
        make=make,
        model=model,
        changed=[(50721, dng.SRATIONAL, rounded)],
    )
    by_dng = read_mosaic(converted).rec709_from_camera
    assert np.abs(own.rec709_from_camera - by_dng).max() < 0.007 * np.abs(by_dng).max()


def test_levels_are_those_of_the_makers_own_tags(tmp_path):
    depth = (258, dng.SHORT, [14])
    sony = foreign_raw.write_maker(
        tmp_path / "a.ARW", "SONY", "ILCE-7M3", changed=[depth, (0x7310, dng.SHORT, [512] * 4)]
    )
    mosaic = read_mosaic(sony)
    assert (mosaic.black, mosaic.white) == ((512,) * 4, (16383,) * 4)
    nikon = foreign_raw.write_maker(
        tmp_path / "a.NEF",
        "NIKON CORPORATION",
        "NIKON D850",
        exif=foreign_raw.nikon_note(400),
        changed=[depth],
    )
    mosaic = read_mosaic(nikon)
    # LibRaw knows up to where a Nikon is linear.
    assert (mosaic.black, mosaic.white) == ((400,) * 4, (15311,) * 4)


def test_fujis_container_is_read(tmp_path):
    mosaic = foreign_raw.counts(96, 128)
    path = foreign_raw.write_raf(tmp_path / "a.RAF", "GFX 50S", mosaic, 1022)
    read = read_mosaic(path)
    np.testing.assert_array_equal(read.counts, mosaic)
    assert (read.black, read.white) == ((1022,) * 4, (15872,) * 4)
    assert (read.facts.camera, read.facts.shutter_s, read.facts.iso) == ("FUJIFILM GFX 50S", 0.01, 100)
    assert math.isfinite(read.facts.time_s)


def test_olympus_files_are_read(tmp_path):
    mosaic = foreign_raw.counts(96, 128) % 4096
    read = read_mosaic(foreign_raw.write_orf(tmp_path / "a.ORF", "E-M1MarkII", mosaic))
    np.testing.assert_array_equal(read.counts, mosaic)
    assert read.white == (4095,) * 4
    assert (read.facts.camera, read.facts.shutter_s) == ("OLYMPUS CORPORATION E-M1MarkII", 0.01)


def test_a_model_in_no_table_is_refused_with_a_remedy(tmp_path):
    path = foreign_raw.write_maker(tmp_path / "own.NEF", "Acme", "Acme One")
    with pytest.raises(
        RawError, match=r"own\.NEF: no colour matrix is known for Acme One; convert .*DNG Converter"
    ):
        read_mosaic(path)


LAMP = 30.0


@pytest.mark.parametrize("tile", [None, (32, 48)], ids=["strips", "tiles"])
@pytest.mark.parametrize("predictor", [1, 3, 34894, 34895])
@pytest.mark.parametrize(("bits", "error"), [(16, 5e-4), (24, 2e-5), (32, 1e-7)])
def test_floats_keep_one_scale_whatever_the_brightest_pixel_is(tmp_path, bits, error, predictor, tile):
    room = np.random.default_rng(0).uniform(0.05, 0.9, (50, 72)).astype(np.float32)
    lamp = room.copy()
    lamp[10:16, 10:16] = LAMP
    for picture in (room, lamp):
        path = foreign_raw.write_floats(tmp_path / "a.dng", picture, bits, predictor, tile)
        mosaic = read_mosaic(path)
        np.testing.assert_allclose(mosaic.counts, picture * mosaic.white[1], rtol=error)
        assert set(mosaic.black) == {0.0}
    if predictor == 1:
        return  # LibRaw takes the default predictor for granted
    with rawpy.imread(str(path)) as raw:  # an independent decoder, to the scale it chose for this file
        np.testing.assert_allclose(raw.raw_image_visible, lamp * raw.white_level / LAMP, atol=1.5)


def test_floats_as_they_come_without_compression(tmp_path):
    room = np.random.default_rng(0).uniform(0.05, 0.9, (50, 72)).astype(np.float32)
    for bits in (16, 24, 32):
        path = foreign_raw.write_floats(tmp_path / "a.dng", room, bits, deflate=False)
        np.testing.assert_allclose(read_mosaic(path).counts, room * read_mosaic(path).white[1], rtol=5e-4)
        path = foreign_raw.write_floats(tmp_path / "a.dng", room, bits, tile=(32, 48), deflate=False)
        with pytest.raises(
            RawError, match=rf"does not support .*floats in tiles of {bits} bits, uncompressed"
        ):
            read_mosaic(path)


def test_floats_that_are_no_numbers_or_cut_off_are_refused(tmp_path):
    room = np.full((40, 48), 0.5, np.float32)
    room[3, 4] = np.nan
    path = foreign_raw.write_floats(tmp_path / "a.dng", room, 32)
    with pytest.raises(RawError, match=r"a\.dng: 1 of 1920 values are no numbers"):
        read_mosaic(path)
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(RawError, match="cut off"):
        read_mosaic(path)


def test_full_colour_floats_are_refused_as_that(tmp_path):
    rgb = np.full((40, 48, 3), 0.5, np.float32)
    path = foreign_raw.write(
        tmp_path / "a.dng", rgb[..., 0], [rgb.tobytes()],
        changed=[(258, 3, [32] * 3), (262, 3, [34892]), (277, 3, [3]), (339, 3, [3] * 3), (50717, 4, [1] * 3)],
        without=(33421, 33422),
    )  # fmt: skip
    with pytest.raises(RawError, match=r"full-colour pixels, not a Bayer mosaic; .*linear EXR"):
        read_mosaic(path)


@pytest.mark.parametrize(
    ("exif", "iso"),
    [
        ([(34855, dng.SHORT, [200, 0])], 200),
        ([(34855, dng.SHORT, [0, 400])], 400),
        ([(34855, dng.SHORT, [800, 800])], 800),
        ([(34855, dng.SHORT, [65535]), (34866, dng.LONG, [102400])], 102400),
        ([(34855, dng.SHORT, [65535]), (34867, dng.LONG, [204800])], 204800),
        ([(34855, dng.SHORT, [0]), (34865, dng.LONG, [320])], 320),
    ],
)
def test_iso_is_read_where_one_number_is_not_all(tmp_path, exif, iso):
    path = foreign_raw.write(tmp_path / "a.dng", foreign_raw.counts(), exif=exif)
    assert read_facts(path).iso == iso


def test_no_iso_is_refused(tmp_path):
    path = foreign_raw.write(tmp_path / "a.dng", foreign_raw.counts(), without=(34855,))
    with pytest.raises(RawError, match="does not tell its shutter time and ISO"):
        read_facts(path)


@pytest.mark.parametrize(
    ("changed", "kind"),
    [
        ([(259, dng.SHORT, [52546])], "counts of 16 bits, JPEG XL"),
        ([(259, dng.SHORT, [8])], "counts of 16 bits, deflate"),
        ([(259, dng.SHORT, [9])], "counts of 16 bits, VC-5"),
        ([(259, dng.SHORT, [34892])], "counts of 16 bits, lossy JPEG"),
        ([(258, dng.SHORT, [32])], "counts of 32 bits, uncompressed"),
    ],
)
def test_what_libraw_does_not_decode_is_not_called_damaged(tmp_path, changed, kind):
    mosaic = foreign_raw.counts()
    path = foreign_raw.write(tmp_path / "a.dng", mosaic, [mosaic.astype("<u4").tobytes()], changed=changed)
    with pytest.raises(RawError) as fault:
        read_mosaic(path)
    assert f"does not support this kind of DNG ({kind}); convert it" in str(fault.value)
    assert "damaged" not in str(fault.value)


@pytest.mark.parametrize("kind", [rawpy.LibRawFileUnsupportedError, rawpy.LibRawNotImplementedError])
def test_a_makers_compression_that_libraw_lacks_is_not_called_damaged(tmp_path, monkeypatch, kind):
    class Refusing(rawpy.RawPy):
        def unpack(self):
            raise kind(b"Unsupported file format")

    monkeypatch.setattr(rawpy, "RawPy", Refusing)
    path = foreign_raw.write_maker(tmp_path / "a.NEF", "NIKON CORPORATION", "NIKON Z 8")
    with pytest.raises(RawError, match=r"does not support how its pixels are compressed.*lossless") as fault:
        read_mosaic(path)
    assert "damaged" not in str(fault.value)


def test_pixels_that_are_not_square_are_refused(tmp_path):
    scale = dng._fractions([1.0, 2.0])
    path = foreign_raw.write(tmp_path / "a.dng", foreign_raw.counts(), changed=[(50718, dng.RATIONAL, scale)])
    with pytest.raises(RawError, match="not square"):
        read_mosaic(path)


def test_more_pixels_than_its_bytes_can_tell_are_refused_before_they_are_decoded(tmp_path):
    """LibRaw makes 400 million zeros of such a file, or spends a minute on it."""
    large = [(256, dng.LONG, [20000]), (257, dng.LONG, [20000]), (259, dng.SHORT, [7])]
    path = foreign_raw.write(tmp_path / "a.dng", foreign_raw.counts(), changed=large)
    assert read_facts(path).width == 20000
    with pytest.raises(
        RawError, match=r"a\.dng: says that it holds 20000 x 20000 pixels, too many for its \d+ b"
    ):
        read_mosaic(path)


def test_lossless_jpeg_that_does_not_begin_as_one_is_refused(tmp_path):
    """LibRaw reads such a file without a word: its pixels are whatever was in memory."""
    path = foreign_raw.write(tmp_path / "a.dng", foreign_raw.counts(), changed=[(259, dng.SHORT, [7])])
    with pytest.raises(RawError, match=r"a\.dng: 1 of its 1 parts of pixels are damaged, .* copy it again"):
        read_mosaic(path)


def test_a_tag_that_claims_gigabytes_is_no_news_of_the_photograph(tmp_path):
    path = foreign_raw.write(tmp_path / "a.dng", foreign_raw.counts())
    entry, fractions = struct.pack("<H", 36867), struct.pack("<HI", dng.RATIONAL, 2**32 - 1)
    content = bytearray(path.read_bytes())
    at = content.index(entry + struct.pack("<H", dng.ASCII)) + 2
    content[at : at + len(fractions)] = fractions
    path.write_bytes(content)
    assert read_facts(path).width == 96
