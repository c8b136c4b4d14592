import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from engine.errors import ImportFault, MaskError, RawError
from engine.io.images import read_mask, read_radiance, srgb_decode, tone_map
from engine.io.normal_maps import read_normals
from engine.io.png import encode, srgb

OBJECT = np.zeros((6, 7), bool)
OBJECT[2:4, 3:5] = True
BLACK = np.zeros((6, 7, 3), np.uint8)


def test_other_formats_and_missing_files_are_refused(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"x")
    with pytest.raises(RawError, match="linear images are read from"):
        read_radiance(tmp_path / "a.jpg")
    with pytest.raises(RawError, match="no such file"):
        read_radiance(tmp_path / "b.exr")


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_mask_is_what_is_brighter_than_half(tmp_path, depth):
    image = np.zeros((6, 7), depth)
    image[2:4, 3:5] = np.iinfo(depth).max * 0.6
    image[0, 0] = np.iinfo(depth).max * 0.4
    cv2.imwrite(str(tmp_path / "m.png"), image)
    mask = read_mask(tmp_path / "m.png", 6, 7)
    assert mask.sum() == 4
    assert mask[2:4, 3:5].all()


@pytest.mark.parametrize("colour", [BLACK, BLACK + 80, np.random.default_rng(0).integers(0, 255, (6, 7, 3))])
def test_a_cut_out_is_the_mask_whatever_its_colours(tmp_path, colour):
    _saved(tmp_path, np.dstack([colour, 255 * OBJECT]))
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)


def test_grey_and_black_and_16_bit_cut_outs_are_masks_too(tmp_path):
    _saved(tmp_path, np.dstack([0 * OBJECT, 255 * OBJECT]))
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)
    cv2.imwrite(str(tmp_path / "d.png"), np.dstack([BLACK, 65535 * OBJECT]).astype(np.uint16))
    np.testing.assert_array_equal(read_mask(tmp_path / "d.png", 6, 7), OBJECT)


@pytest.mark.parametrize("opacity", [255, 128, 0])
def test_colours_decide_where_opacity_tells_nothing(tmp_path, opacity):
    _saved(tmp_path, np.dstack([BLACK + 255 * OBJECT[..., None], np.full((6, 7), opacity)]))
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)


@pytest.mark.parametrize("transparent", [0, bytes([0, 255]), None])
def test_palettes_are_taken_by_their_transparency_and_else_by_their_colours(tmp_path, transparent):
    indexed = Image.fromarray(OBJECT.astype(np.uint8), "L")
    indexed.putpalette([0, 0, 0, 255, 255, 255] if transparent is None else [255, 255, 255, 0, 0, 0])
    indexed.save(tmp_path / "m.png", **({} if transparent is None else {"transparency": transparent}))
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)


def test_a_grey_that_stands_for_transparent_is_no_object(tmp_path):
    Image.fromarray(np.where(OBJECT, 0, 255).astype(np.uint8)).save(tmp_path / "m.png", transparency=255)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)


def test_masks_of_one_bit_and_with_ringing_are_read(tmp_path):
    Image.fromarray(OBJECT).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)
    Image.fromarray((255 * OBJECT).astype(np.uint8)).save(tmp_path / "m.jpg", quality=80)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.jpg", 6, 7), OBJECT)


def _saved(folder, samples):
    Image.fromarray(samples.astype(np.uint8)).save(folder / "m.png")


def test_unfit_masks_are_refused(tmp_path):
    path = tmp_path / "m.png"
    cv2.imwrite(str(path), np.zeros((6, 7), np.uint8))
    with pytest.raises(MaskError, match="no object"):
        read_mask(path, 6, 7)
    with pytest.raises(MaskError, match="the mask is 7 x 6, the photographs are 8 x 6"):
        read_mask(path, 6, 8)
    path.write_bytes(b"x")
    with pytest.raises(MaskError, match="cannot be read"):
        read_mask(path, 6, 7)
    with pytest.raises(MaskError, match="no such file"):
        read_mask(tmp_path / "other.png", 6, 7)
    Image.fromarray(OBJECT.astype(np.float32)).save(tmp_path / "m.tif")
    with pytest.raises(MaskError, match="without a largest one"):
        read_mask(tmp_path / "m.tif", 6, 7)


@given(st.floats(0, 1))
def test_srgb_round_trip(x):
    value = np.array([x])
    np.testing.assert_allclose(srgb_decode(srgb(value)), value, atol=1e-9)


def test_srgb_of_middle_grey_by_hand():
    np.testing.assert_allclose(srgb(np.array([0.2140411, 0.002])), [0.5, 0.02584], atol=1e-5)


def test_tone_map_rises_and_gives_the_anchor_a_middle_grey():
    ramp = np.geomspace(1e-4, 100, 50)[None, :, None] * np.ones((1, 1, 3))
    codes = tone_map(ramp, 1.0)[0, :, 0].astype(int)
    assert (np.diff(codes) >= 0).all()
    assert (codes[0], codes[-1]) == (0, 255)
    assert 100 < tone_map(np.ones((1, 1, 3)), 1.0)[0, 0, 0] < 140


@pytest.mark.parametrize(("tag", "turns"), [(3, 2), (6, 1), (8, -1)])
def test_a_mask_whose_own_tag_turns_it_is_taken_as_viewers_show_it(tmp_path, tag, turns):
    exif = Image.Exif()
    exif[0x112] = tag
    stored = Image.fromarray(np.ascontiguousarray(np.rot90(255 * OBJECT.astype(np.uint8), turns)))
    stored.save(tmp_path / "m.png", exif=exif)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 6, 7), OBJECT)


def test_the_size_that_a_header_claims_is_judged_before_pixels_are_made_of_it(tmp_path, monkeypatch):
    _claiming(tmp_path / "m.png", 12000, 12000)
    monkeypatch.setattr(Image.Image, "load", lambda image: pytest.fail("decoded"))
    with pytest.raises(MaskError, match="the mask is 12000 x 12000, the photographs are 7 x 6"):
        read_mask(tmp_path / "m.png", 6, 7)
    with pytest.raises(ImportFault, match="normal is of shape 12000 x 12000, the photographs ask for 6 x 7"):
        read_normals(tmp_path / "m.png", OBJECT, "opengl")


def _claiming(path, width, height):
    """A small PNG whose header says that it is large."""
    header = struct.pack(">4sIIBBBBB", b"IHDR", width, height, 8, 0, 0, 0, 0)
    whole = encode(255 * OBJECT.astype(np.uint8))
    path.write_bytes(whole[:12] + header + struct.pack(">I", zlib.crc32(header)) + whole[33:])
