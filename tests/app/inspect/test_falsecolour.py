"""Numbers become the colours they should: worked out by hand."""

import numpy as np
import pytest

from app.inspect import falsecolour
from app.inspect.falsecolour import Scale

EVERYWHERE = np.ones((1, 1), bool)


def rgba(picture: np.ndarray, row: int = 0, column: int = 0) -> tuple[int, ...]:
    blue, green, red, alpha = (int(v) for v in picture[row, column])
    return red, green, blue, alpha


@pytest.mark.parametrize(
    ("normal", "frame", "colour"),
    [
        ((0, 0, -1), "opengl", (128, 128, 255)),  # towards the viewer: blue
        ((0, 0, -1), "camera", (128, 128, 0)),  # ours points away where z > 0
        ((0, -1, 0), "opengl", (128, 255, 128)),  # up: green
        ((0, -1, 0), "directx", (128, 0, 128)),  # green is down there
        ((1, 0, 0), "opengl", (255, 128, 128)),
    ],
)
def test_normals_are_coloured_in_the_frame_that_is_asked(normal, frame, colour) -> None:
    picture = falsecolour.normals(np.array([[normal]], np.float32), EVERYWHERE, frame)
    assert rgba(picture) == (*colour, 255)


def test_radiance_is_srgb_encoded_and_exposed_in_stops() -> None:
    half = np.full((1, 1, 3), 1.0, np.float32)
    assert rgba(falsecolour.radiance(half, 2.0)) == (188, 188, 188, 255)  # 0.5 is code 188
    assert rgba(falsecolour.radiance(half, 2.0, 1.0)) == (255, 255, 255, 255)
    assert rgba(falsecolour.radiance(0 * half, 2.0)) == (0, 0, 0, 255)


def test_the_logarithmic_tone_spans_twelve_stops() -> None:
    light = np.array([[[1, 1, 1], [2**-6, 2**-6, 2**-6], [2**-12, 2**-12, 2**-12]]], np.float32)
    picture = falsecolour.radiance(light, 1.0, tone="log")
    assert [rgba(picture, 0, i)[0] for i in range(3)] == pytest.approx([255, 128, 0], abs=1)


def test_clipped_pixels_are_red_where_they_are_marked() -> None:
    light = np.ones((1, 2, 3), np.float32)
    picture = falsecolour.radiance(light, 1.0, clipped=np.array([[True, False]]))
    assert rgba(picture, 0, 0)[0] > 200 > rgba(picture, 0, 0)[1]
    assert rgba(picture, 0, 1) == (255, 255, 255, 255)


def test_a_map_of_numbers_keeps_to_its_scale_and_is_transparent_without_an_answer() -> None:
    values = np.array([[-5.0, 0.0, 1.0, 9.0, np.nan, 0.5]], np.float32)
    mask = np.array([[True, True, True, True, True, False]])
    picture = falsecolour.scalar(values, mask, Scale(0, 1, "", "grey"))
    assert [rgba(picture, 0, i) for i in range(6)] == [
        (0, 0, 0, 255), (0, 0, 0, 255), (255, 255, 255, 255), (255, 255, 255, 255), (0, 0, 0, 0), (0, 0, 0, 0),
    ]  # fmt: skip


def test_the_signed_scale_is_pale_at_zero_and_dark_at_both_ends() -> None:
    low, middle, high = falsecolour.table("signed")[[0, 128, 255]].astype(int)
    assert middle.min() > 230
    assert abs(int(low.sum()) - int(high.sum())) < 100
    assert low[2] > low[0]
    assert high[0] > high[2]


def test_parts_have_a_colour_each_and_small_ones_none() -> None:
    picture = falsecolour.parts(np.array([[0, 1, 2, 5, 6]], np.int16), np.array([[True] * 4 + [False]]))
    assert len({tuple(pixel) for pixel in picture[0, :4]}) == 4
    assert tuple(picture[0, 0, :3]) == falsecolour.UNFLAGGED
    assert picture[0, 4, 3] == 0


def test_flags_have_a_colour_each_and_another_together() -> None:
    picture = falsecolour.flags(np.array([[0, 1, 2, 4, 8, 16, 3, 24]], np.uint8), np.ones((1, 8), bool))
    assert len({rgba(picture, 0, i) for i in range(7)}) == 7
    assert rgba(picture, 0, 6) == rgba(picture, 0, 7)
    assert falsecolour.told_flags(9) == "grazing, ill-conditioned"
    assert falsecolour.told_flags(0) == "none"


def test_smaller_levels_are_means() -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (512, 300, 4)).astype(np.uint8)
    levels = falsecolour.halves(picture, smallest=64)
    assert [level.shape[:2] for level in levels] == [(512, 300), (256, 150), (128, 75)]
    corner = picture[:2, :2].astype(float).mean((0, 1))
    assert levels[1][0, 0] == pytest.approx(corner, abs=0.51)
