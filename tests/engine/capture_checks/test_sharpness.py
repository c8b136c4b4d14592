import dataclasses
import math

import cv2
import numpy as np
import pytest

from engine.capture_checks import sharpness
from engine.capture_checks.shot_preview import ShotPreview, glance_linear

H, W = 200, 260


def picture(light: np.ndarray, pitch: float = 1.0) -> ShotPreview:
    noisy = light + 0.002 * np.random.default_rng(3).standard_normal(light.shape)
    return ShotPreview(
        "shot", W, H, (), (1.0,), pitch, noisy.astype(np.float32), np.zeros(light.shape, bool), (1e-7, 0.002),
        np.zeros((4, 4, 3), np.float32), np.zeros((4, 4), np.float32), np.zeros((4, 4), bool), 1e4, 0.0, 0.0,
        np.zeros(1),
    )  # fmt: skip


def discs(sigma: float, seed: int = 0, steps: float = 1.0) -> np.ndarray:
    """Discs of different light, edges in all directions, blurred as by a lens of that width."""
    rng = np.random.default_rng(seed)
    image = np.full((4 * H, 4 * W), 0.4, np.float32)
    for _ in range(24):
        place = (int(rng.uniform(0, 4 * W)), int(rng.uniform(0, 4 * H)))
        cv2.circle(
            image, place, int(rng.uniform(60, 130)), float(0.4 * np.exp(steps * rng.uniform(-1, 1))), -1
        )
    if sigma:
        image = cv2.GaussianBlur(image, (0, 0), 4 * sigma)
    return cv2.resize(image, (W, H), interpolation=cv2.INTER_AREA)


def room(light: np.ndarray) -> sharpness.Sharpness:
    return sharpness.measure(sharpness.edges_of(picture(light)), None)


@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.5])
def test_the_width_of_blurred_steps_is_measured(sigma):
    assert room(discs(sigma)).room == pytest.approx(np.full(4, sigma), rel=0.25)


def test_nothing_is_said_of_a_view_without_edges():
    y = np.mgrid[:H, :W][0] / H
    for light in (np.full((H, W), 0.4), 0.2 + 0.5 * y, discs(12.0)):
        now = room(light.astype(np.float32))
        assert np.isnan(now.room).all()
        assert sharpness.check(picture(light), now, [room(discs(0.5, seed)) for seed in range(4)]) == ()


def test_noise_has_no_edges():
    light = np.random.default_rng(1).normal(0.4, 0.04, (H, W)).astype(np.float32)
    noisy = dataclasses.replace(picture(light), noise=(0.004, 0.0))
    assert len(sharpness.edges_of(noisy).row) < 0.001 * light.size
    assert len(sharpness.edges_of(dataclasses.replace(noisy, noise=(1e-9, 1e-6))).row) > 0.1 * light.size


def test_blur_is_told_against_earlier_shots_and_alone():
    usual = [room(discs(0.5, seed)) for seed in range(4)]
    blurred = discs(2.2, 9)
    assert sharpness.check(picture(blurred), room(blurred), usual)
    assert sharpness.check(picture(blurred), room(blurred), [])
    sharp = discs(0.5, 9)
    assert sharpness.check(picture(sharp), room(sharp), usual) == ()
    # A soft lens is soft in all shots: that it is so again is no news.
    assert (
        sharpness.check(picture(blurred), room(blurred), [room(discs(2.2, seed)) for seed in range(4)]) == ()
    )


def test_motion_is_told_with_its_direction_and_in_sites():
    usual = [room(discs(0.5, seed)) for seed in range(4)]
    swept = cv2.blur(discs(0.5, 9), (1, 7))
    now = room(swept)
    (found,) = sharpness.check(picture(swept, pitch=4.0), now, usual)
    assert "vertical" in found.seen
    assert found.value == pytest.approx(4 * np.nanmax(now.room))


def test_clipped_edges_say_nothing():
    clipped = dataclasses.replace(picture(discs(2.2)), fine_clipped=np.ones((H, W), bool))
    assert len(sharpness.edges_of(clipped).row) == 0


def test_one_number_tells_how_blurred_a_picture_is_also_a_linear_image():
    picture_of_room = np.repeat(picture(discs(1.5)).fine[..., None], 3, axis=-1)
    linear = glance_linear("render", picture_of_room)
    assert sharpness.blur_px(linear) == pytest.approx(1.5, rel=0.25)
    assert sharpness.blur_px(picture(discs(1.5), pitch=4.0)) == pytest.approx(6.0, rel=0.25)
    assert math.isnan(sharpness.blur_px(picture(np.full((H, W), 0.4, np.float32))))
    picture_of_room[:50] = 7e4
    assert glance_linear("render", picture_of_room).share_clipped == pytest.approx(0.25)
