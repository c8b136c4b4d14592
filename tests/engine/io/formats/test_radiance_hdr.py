import cv2
import numpy as np
import pytest

from engine.errors import RawError
from engine.io.images import read_radiance

RGBE = "FORMAT=32-bit_rle_rgbe"
# Powers of two times whole mantissas: RGBE holds them exactly.
IMAGE = np.random.default_rng(0).integers(128, 256, (12, 16, 3)).astype(np.float32) / 128


def write(path, lines=(RGBE,), size="-Y 12 +X 16", stored=IMAGE, end="\n"):
    pixels = np.concatenate([stored * 128, np.full((*stored.shape[:2], 1), 129)], axis=-1).astype(np.uint8)
    path.write_bytes((end.join(["#?RADIANCE", *lines, "", size]) + end).encode() + pixels.tobytes())
    return path


def test_reads_run_lengths_as_well(tmp_path):
    cv2.imwrite(str(tmp_path / "a.hdr"), IMAGE[..., ::-1])
    np.testing.assert_array_equal(read_radiance(tmp_path / "a.hdr"), IMAGE)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_reads_plain_pixels_whatever_ends_a_line(tmp_path, end):
    lines = ("SOFTWARE=x", "made by y", RGBE, "GAMMA=1")
    np.testing.assert_array_equal(read_radiance(write(tmp_path / "a.hdr", lines, end=end)), IMAGE)


@pytest.mark.parametrize(
    ("lines", "scale"),
    [
        (("EXPOSURE=4", RGBE), 4),
        ((RGBE, "EXPOSURE= 4.0", "EXPOSURE=0.5"), 2),
        (("COLORCORR=1 2 4", RGBE, "COLORCORR=0.5 1 1"), (0.5, 2, 4)),
        (("EXPOSURE=2", "COLORCORR=1 2 1", RGBE), (2, 4, 2)),
        (("\tEXPOSURE=2", RGBE), 1),  # of a picture that this one was made of
        ((), 1),
    ],
)
def test_what_the_values_were_multiplied_by_is_divided_out(tmp_path, lines, scale):
    found = read_radiance(write(tmp_path / "a.hdr", lines))
    np.testing.assert_array_equal(found, IMAGE / np.float32(scale))


@pytest.mark.parametrize("y", "+-")
@pytest.mark.parametrize("x", "+-")
@pytest.mark.parametrize("first", "XY")
def test_all_orders_of_the_pixels_are_read_upright(tmp_path, y, x, first):
    stored = IMAGE[:: 1 if y == "-" else -1, :: 1 if x == "+" else -1]
    size = f"{y}Y 12 {x}X 16"
    if first == "X":
        stored, size = stored.transpose(1, 0, 2), f"{x}X 16 {y}Y 12"
    np.testing.assert_array_equal(read_radiance(write(tmp_path / "a.pic", size=size, stored=stored)), IMAGE)


def test_primaries_are_converted_and_white_stays_white(tmp_path):
    white = np.ones_like(IMAGE)
    white[0, 0] = (0, 1, 0)
    rec2020 = "PRIMARIES= 0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.329"
    found = read_radiance(write(tmp_path / "a.hdr", (RGBE, rec2020), stored=white))
    np.testing.assert_allclose(found[1:], 1, atol=2e-4)
    np.testing.assert_allclose(found[0, 0], (-0.5876, 1.1329, -0.1006), atol=1e-3)


def test_xyz_is_converted_from_its_own_white(tmp_path):
    flat = np.ones_like(IMAGE)
    lines = ("FORMAT=32-bit_rle_xyze", "WHTEFFICACY=179")
    np.testing.assert_allclose(read_radiance(write(tmp_path / "a.hdr", lines, stored=flat)), 1, atol=1e-5)
    flat[:] = (122 / 128, 1, 139 / 128)  # nearly D65, Rec.709's white: 0.9505 1 1.089 by IEC 61966-2-1
    lines = ("FORMAT=32-bit_rle_xyze", "PRIMARIES=1 0 0 1 0 0 0.3127 0.3290")
    np.testing.assert_allclose(read_radiance(write(tmp_path / "b.hdr", lines, stored=flat)), 1, atol=0.015)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ({"lines": ("FORMAT=Radiance_spectra",)}, "is of format Radiance_spectra"),
        ({"lines": (RGBE, "EXPOSURE=0")}, r"EXPOSURE lines make \[0.0\], no scale of light"),
        ({"lines": (RGBE, "EXPOSURE=bright")}, "line EXPOSURE=bright does not hold 1 number"),
        ({"lines": (RGBE, "PRIMARIES=0.64 0.33")}, "does not hold 8 number"),
        ({"lines": (RGBE, "PRIMARIES=0 0 0 0 0 0 0 0")}, "span no colours"),
        ({"lines": ("FORMAT=32-bit_rle_xyze", "PRIMARIES=1 0 0 1 0 0 0 0")}, "span no colours"),
        ({"lines": (RGBE, "PIXASPECT=2")}, "not square"),
        ({"size": "-Y 12 +Y 16"}, "tells its size by '-Y 12 .Y 16'"),
        ({"size": "-Y 13 +X 16"}, "do not make 16 x 13, it may be cut off"),
        ({"size": "-Y 0 +X 16"}, "do not make 16 x 0"),
        ({"stored": np.full((2, 16, 3), np.float32(1 / 128))}, "before 1991"),
    ],
)
def test_what_is_not_read_is_refused_for_its_own_reason(tmp_path, made, message):
    with pytest.raises(RawError, match=message):
        read_radiance(write(tmp_path / "a.hdr", **made))


def test_another_file_by_that_name_is_refused(tmp_path):
    (tmp_path / "a.hdr").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(99))
    with pytest.raises(RawError, match="does not begin like a Radiance picture"):
        read_radiance(tmp_path / "a.hdr")


def test_a_size_beyond_its_bytes_is_refused_before_memory_is_taken(tmp_path):
    cv2.imwrite(str(tmp_path / "a.hdr"), IMAGE[..., ::-1])
    content = (tmp_path / "a.hdr").read_bytes().replace(b"-Y 12", b"-Y 99999999")
    (tmp_path / "a.hdr").write_bytes(content)
    with pytest.raises(RawError, match="do not make 16 x 99999999"):
        read_radiance(tmp_path / "a.hdr")
