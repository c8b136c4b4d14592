import numpy as np
import OpenEXR
import pytest

from engine.errors import RawError
from engine.io.images import read_radiance

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


def parts(path, *held):
    """A file of several parts: (name, channels) each."""
    header = {"type": OpenEXR.scanlineimage}
    OpenEXR.File([OpenEXR.Part(dict(header), channels, name) for name, channels in held]).write(str(path))
    return path


GREY = {"Z": IMAGE[..., 0].copy()}


@pytest.mark.parametrize(
    "held",
    [
        (("depth", GREY), ("rgba", planes())),
        (("rgba", planes()), ("matte", {"R": IMAGE[..., 2].copy()})),
        (("Combined", planes("Combined.")), ("Depth", {"Depth.Z": IMAGE[..., 0].copy()})),
        tuple((name, {name: plane}) for name, plane in planes().items()),
    ],
)
def test_colours_are_found_in_whatever_part_they_are(tmp_path, held):
    np.testing.assert_array_equal(read_radiance(parts(tmp_path / "a.exr", *held)), IMAGE)


def test_colours_in_several_parts_are_ambiguous_and_named(tmp_path):
    path = parts(tmp_path / "a.exr", ("left", planes()), ("right", planes()))
    with pytest.raises(RawError, match=r"more than one layer with R, G and B: left, right;"):
        read_radiance(path)


def test_a_deep_picture_is_refused_by_name(tmp_path):
    samples = np.empty((2, 3), object)
    for place in np.ndindex(2, 3):
        samples[place] = np.ones(2, np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    OpenEXR.File(header, dict.fromkeys("RGB", samples)).write(str(tmp_path / "a.exr"))
    with pytest.raises(RawError, match="is a deep picture"):
        read_radiance(tmp_path / "a.exr")


def test_whole_numbers_are_no_light(tmp_path):
    with pytest.raises(RawError, match="whole numbers"):
        read_radiance(write(tmp_path / "a.exr", planes(image=IMAGE.astype(np.uint32))))


def test_squeezed_pictures_are_refused(tmp_path):
    with pytest.raises(RawError, match=r"not square \(aspect 2\)"):
        read_radiance(write(tmp_path / "a.exr", planes(), pixelAspectRatio=2.0))


def test_a_named_colour_space_counts_like_its_primaries(tmp_path):
    acescg = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    told = read_radiance(write(tmp_path / "a.exr", planes(), chromaticities=acescg))
    named = read_radiance(write(tmp_path / "b.exr", planes(), colorInteropID="lin_ap1_scene"))
    np.testing.assert_allclose(named, told, rtol=1e-5)
    assert not np.allclose(named, IMAGE)
    with pytest.raises(RawError, match="its colours are srgb_rec709_scene, not linear RGB"):
        read_radiance(write(tmp_path / "c.exr", planes(), colorInteropID="srgb_rec709_scene"))


def test_a_damaged_part_is_not_taken_for_another(tmp_path):
    path = parts(tmp_path / "a.exr", ("one", planes()), ("two", {"a.R": IMAGE[..., 0].copy()}))
    content = bytearray(path.read_bytes())
    content[content.index(IMAGE[0, :, 2].tobytes()[:4]) :] = b""
    path.write_bytes(content)
    with pytest.raises(RawError, match="cannot be read as OpenEXR"):
        read_radiance(path)
