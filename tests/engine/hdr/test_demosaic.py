import cv2
import numpy as np
import pytest

from engine.hdr.demosaic import demosaic

RGGB = np.array([[0, 1], [3, 2]])


def sampled(image: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    h, w, _ = image.shape
    channel = np.tile(np.where(pattern == 3, 1, pattern), (h // 2, w // 2))
    return np.take_along_axis(image, channel[..., None], axis=2)[..., 0].astype(np.float32)


def textured(h: int, w: int) -> np.ndarray:
    """Patches of paint under a shading that spans three decades, with a lamp."""
    rng = np.random.default_rng(3)
    grey, tint = rng.uniform(0.1, 0.9, (24, 32, 1)), rng.uniform(0.6, 1.0, (24, 32, 3))
    paint = cv2.resize(grey * tint, (2 * w, 2 * h), interpolation=cv2.INTER_NEAREST)
    shade = 10 ** cv2.resize(rng.uniform(-1.5, 1.5, (4, 5)), (2 * w, 2 * h), interpolation=cv2.INTER_CUBIC)
    image = paint * shade[..., None]
    cv2.circle(image, (w // 2, h), 30, (800.0, 700.0, 600.0), -1)
    return cv2.GaussianBlur(image, (0, 0), 1.0)[::2, ::2]  # as a lens would


@pytest.mark.parametrize("pattern", [RGGB, np.array([[2, 1], [3, 0]]), np.array([[1, 0], [2, 3]])])
def test_a_grey_plane_stays_exact_in_every_pattern(pattern):
    image = np.full((32, 40, 3), 0.37)
    np.testing.assert_allclose(demosaic(sampled(image, pattern), pattern, 0.02), image, rtol=1e-5)


def test_own_colours_are_kept():
    image = textured(64, 80)
    mosaic = sampled(image, RGGB)
    full = demosaic(mosaic, RGGB, 0.02)
    np.testing.assert_allclose(sampled(full, RGGB), mosaic, rtol=1e-4, atol=1e-6)


def test_beats_linear_interpolation_on_a_scene_of_high_contrast():
    image = textured(240, 320)
    mosaic = sampled(image, RGGB)
    ours = demosaic(mosaic, RGGB, 0.02)
    linear = np.empty_like(ours)
    for colour in range(3):
        own = np.tile(np.array([[0, 1], [1, 2]]) == colour, (120, 160)).astype(np.float32)
        kernel = np.float32([[1, 2, 1], [2, 4, 2], [1, 2, 1]])
        linear[..., colour] = cv2.filter2D(mosaic * own, -1, kernel) / cv2.filter2D(own, -1, kernel)
    inside = np.s_[8:-8, 8:-8]
    relative = [np.abs(found / image - 1)[inside].mean() for found in (ours, linear)]
    assert relative[0] < 0.25 * relative[1]


def test_noise_around_black_averages_to_black():
    rng = np.random.default_rng(0)
    mosaic = (1e-3 * rng.standard_normal((200, 200))).astype(np.float32)
    found = demosaic(mosaic, RGGB, toe=5e-3)
    assert np.abs(found.mean(axis=(0, 1))).max() < 5e-5


def test_a_lamp_does_not_turn_its_surround_negative():
    found = demosaic(sampled(textured(240, 320), RGGB), RGGB, 0.02)
    assert found.min() > 0
