"""What a person sees of a shot: greys stay grey, lamps are white, and what is lost is marked."""

import dataclasses
import math

import numpy as np
import pytest

from engine.capture_checks.display_image import CLIPPED_RGB, LOST_RGB, PER_EV, WHITE_BIN, picture
from engine.capture_checks.shot_preview import learn, preview
from engine.io.raw import Facts, Mosaic

BLACK, WHITE = 512.0, 16383.0
HEIGHT, WIDTH = 48, 64
NEUTRAL = np.array([0.5, 1.0, 0.6])  # camera RGB of a white sheet
PATTERN = np.array([[0, 1], [3, 2]])


def bracket(light: np.ndarray, shutters_s: tuple[float, ...]) -> list[Mosaic]:
    """Photographs of grey `light` (shares of a full green site in one second), without noise."""
    channel = np.tile(np.where(PATTERN == 3, 1, PATTERN), (HEIGHT // 2, WIDTH // 2))
    made = []
    for shutter_s in shutters_s:
        share = np.minimum(light * NEUTRAL[channel] * shutter_s, 1.0)
        counts = np.rint(BLACK + share * (WHITE - BLACK)).astype(np.uint16)
        facts = Facts("test", WIDTH, HEIGHT, shutter_s, 100.0, math.nan, 0.0, 0)
        black, white = (BLACK, BLACK, BLACK, BLACK), (WHITE, WHITE, WHITE, WHITE)
        made.append(Mosaic(counts, PATTERN, black, white, np.diag(1 / NEUTRAL), facts))
    return made


def flat(share: float) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), share)


@pytest.mark.parametrize("edge_px", [1024, 16])
def test_grey_is_grey_and_as_bright_as_it_was_exposed(edge_px: int) -> None:
    shown = picture(bracket(flat(0.2), (1.0,)), edge_px).rgb
    assert max(shown.shape) <= max(edge_px, WIDTH if edge_px == 1024 else 0)
    # sRGB of 0.2 is 0.4845.
    np.testing.assert_allclose(shown, 124, atol=1)


@pytest.mark.parametrize("edge_px", [1024, 16])
def test_a_lamp_is_white_and_not_magenta(edge_px: int) -> None:
    light = flat(0.1)
    light[:, :16] = 1.7  # green is full, red is not
    shown = picture(bracket(light, (1.0,)), edge_px).rgb
    np.testing.assert_array_equal(shown[:, : shown.shape[1] // 8], 255)


def test_what_only_the_one_shown_has_clipped_is_told_apart_from_what_is_lost() -> None:
    light = flat(0.05)
    light[:, :16] = 3.0
    light[:24, :16] = 100.0
    seen = picture(bracket(light, (1 / 8, 1.0, 8.0)), 1024)
    assert seen.shutter_s == 1.0
    assert seen.clipped == pytest.approx(1 / 8)
    assert seen.clipped_here == pytest.approx(1 / 4)
    assert seen.overlay.shape == (HEIGHT, WIDTH, 4)
    np.testing.assert_array_equal(seen.overlay[:24, :16], [[[*LOST_RGB, 255]] * 16] * 24)
    np.testing.assert_array_equal(seen.overlay[24:, :16], [[[*CLIPPED_RGB, 255]] * 16] * 24)
    assert not seen.overlay[:, 16:, 3].any()


def test_the_share_clipped_is_that_which_the_checks_warn_of() -> None:
    light = flat(0.1)
    light[:, :16] = 1.5  # green is full, red and blue are not
    shot = bracket(light, (1.0,))
    seen = picture(shot, 1024)
    assert seen.clipped == pytest.approx(1 / 8)
    assert seen.clipped == pytest.approx(preview("a", shot, learn(shot)).share_clipped)


def test_the_histogram_counts_light_beyond_the_white_of_the_one_shown() -> None:
    light = flat(0.3)  # -1.7 EV in green, -2.7 in red
    light[:, :16] = 3.0  # 1.6 EV above white: only the short exposure tells
    red, green, _ = picture(bracket(light, (1 / 8, 1.0, 8.0)), 1024).histogram
    cells = HEIGHT * WIDTH // 4
    assert green[WHITE_BIN + math.floor(math.log2(0.3) * PER_EV)] == cells * 3 / 4
    assert green[WHITE_BIN + math.floor(math.log2(3.0) * PER_EV)] == cells / 4
    assert red[WHITE_BIN + math.floor(math.log2(0.15) * PER_EV)] == cells * 3 / 4
    assert red.sum() == green.sum() == cells


def test_dark_is_what_the_longest_exposure_does_not_lift_from_its_noise() -> None:
    light = flat(0.1)
    light[:, :16] = 0.0
    assert picture(bracket(light, (1.0,)), 1024).dark == pytest.approx(1 / 4)
    assert picture(bracket(light + 1e-4, (1.0,)), 1024).dark == pytest.approx(1 / 4)
    assert picture(bracket(light + 1e-4, (1.0, 64.0)), 1024).dark == 0.0


def test_a_sensor_that_is_full_below_its_stated_white_is_white_there() -> None:
    light = flat(0.1)
    light[:, :32] = 5.0
    (mosaic,) = bracket(light, (1.0,))
    mosaic = dataclasses.replace(mosaic, counts=np.minimum(mosaic.counts, 13000))
    seen = picture([mosaic], 1024)
    assert seen.clipped == pytest.approx(1 / 2)
    np.testing.assert_array_equal(seen.rgb[:, :28], 255)
