import cv2
import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import MaskError, RawError
from engine.images import read_mask, read_radiance, rec709_from, srgb_decode, tone_map
from engine.png import srgb

IMAGE = np.random.default_rng(0).lognormal(0, 1, (8, 10, 3)).astype(np.float32)


def write(path, channels, **header):
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, dict(channels)).write(str(path))
    return path


def planes(prefix="", image=IMAGE):
    return {prefix + name: image[..., i].copy() for i, name in enumerate("RGB")}


def test_reads_plain_channels(tmp_path):
    np.testing.assert_array_equal(read_radiance(write(tmp_path / "a.exr", planes())), IMAGE)


def test_reads_half_floats(tmp_path):
    path = write(tmp_path / "a.exr", planes(image=IMAGE.astype(np.float16)))
    np.testing.assert_array_equal(read_radiance(path), IMAGE.astype(np.float16).astype(np.float32))


def test_reads_the_only_layer_that_has_colours(tmp_path):
    path = write(tmp_path / "a.exr", planes("beauty.") | {"depth.Z": IMAGE[..., 0].copy()})
    np.testing.assert_array_equal(read_radiance(path), IMAGE)


def test_plain_channels_go_before_layers(tmp_path):
    path = write(tmp_path / "a.exr", planes() | planes("noisy.", 2 * IMAGE))
    np.testing.assert_array_equal(read_radiance(path), IMAGE)


def test_two_colour_layers_are_ambiguous(tmp_path):
    with pytest.raises(RawError, match="more than one layer"):
        read_radiance(write(tmp_path / "a.exr", planes("left.") | planes("right.")))


def test_a_picture_without_colours_is_refused_naming_its_channels(tmp_path):
    with pytest.raises(RawError, match=r"no layer with R, G and B among the channels Y, Z"):
        read_radiance(write(tmp_path / "a.exr", {"Y": IMAGE[..., 0].copy(), "Z": IMAGE[..., 1].copy()}))


def test_other_primaries_become_rec709_and_white_stays_white(tmp_path):
    rec2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    white = np.ones((4, 4, 3), np.float32)
    white[0, 0] = (0, 1, 0)
    found = read_radiance(write(tmp_path / "a.exr", planes(image=white), chromaticities=rec2020))
    np.testing.assert_allclose(found[1:], 1, atol=2e-4)
    # ITU-R BT.2087: green of BT.2020 in BT.709.
    np.testing.assert_allclose(found[0, 0], (-0.5876, 1.1329, -0.1006), atol=1e-3)


def test_rec709_of_itself_is_the_identity():
    np.testing.assert_allclose(
        rec709_from((0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)), np.eye(3), atol=1e-12
    )


@pytest.mark.parametrize("keep", [0, 60, 400])
def test_a_cut_off_picture_is_refused(tmp_path, keep):
    path = write(tmp_path / "a.exr", planes())
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(RawError, match=r"a\.exr: cannot be read as OpenEXR"):
        read_radiance(path)


def test_a_cropped_picture_is_refused(tmp_path):
    window = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
    with pytest.raises(RawError, match="cropped"):
        read_radiance(write(tmp_path / "a.exr", planes(), displayWindow=window))


def test_reads_radiance_pictures(tmp_path):
    path = tmp_path / "a.hdr"
    cv2.imwrite(str(path), IMAGE[..., ::-1])
    np.testing.assert_allclose(read_radiance(path), IMAGE, rtol=0.01, atol=0.02 * IMAGE.max())


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


def test_transparent_parts_are_no_object(tmp_path):
    image = np.full((6, 7, 4), 255, np.uint8)
    image[:3, :, 3] = 0
    cv2.imwrite(str(tmp_path / "m.png"), image)
    assert read_mask(tmp_path / "m.png", 6, 7)[3:].all()
    assert not read_mask(tmp_path / "m.png", 6, 7)[:3].any()


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
