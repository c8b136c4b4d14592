"""Photographs beside their renderings: how far the object stands from where it was rendered."""

import numpy as np
import pytest
from scipy import ndimage

from engine.rerendering import displacement, object_shift
from engine.types import Frames, ValidationRenders

HEIGHT, WIDTH = 60, 80
MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[8:52, 12:70] = True


def rendered(seed: int = 0) -> np.ndarray:
    """A mottled surface."""
    noise = np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH))
    mottled = np.exp(2 * ndimage.gaussian_filter(noise, 2.5))
    return (mottled[..., None] * [0.4, 0.5, 0.3]).astype(np.float32)


def moved(picture: np.ndarray, down: float, right: float) -> np.ndarray:
    return ndimage.shift(picture, (down, right, 0), order=3, mode="nearest")


@pytest.mark.parametrize(("down", "right"), [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.1)])
def test_a_displaced_object_is_told_to_a_twentieth_of_a_pixel(down: float, right: float):
    photographed = 1.7 * moved(rendered(), down, right)
    found, stderr = displacement(rendered(), photographed, MASK)
    assert found == pytest.approx([down, right], abs=0.05)
    assert (stderr < 0.05).all()


def test_glints_that_were_not_rendered_move_nothing():
    photographed = moved(rendered(), 0.4, 0.0)
    photographed[20:26, 30:40] *= 6
    assert displacement(rendered(), photographed, MASK)[0] == pytest.approx([0.4, 0.0], abs=0.1)


def test_where_nothing_stands_out_nothing_is_told():
    even = np.ones((HEIGHT, WIDTH, 3), np.float32)
    assert not displacement(even, even, MASK)[0].any()
    assert np.isnan(displacement(even, even, np.zeros_like(MASK))).all()


def test_the_shift_is_that_of_the_two_views_farthest_apart():
    pictures = np.stack([rendered(seed) for seed in range(4)])
    downs = (0.4, 0.4, -0.4, 0.0)
    views, flags = (0, 1, 2, 3), np.zeros((4, HEIGHT, WIDTH), bool)
    radiance = np.stack([moved(picture, down, 0) for picture, down in zip(pictures, downs, strict=True)])
    frames = Frames(tuple("abcd"), radiance, flags, flags, (0.0, 0.01))
    assert object_shift(frames, ValidationRenders(views, pictures), MASK) == pytest.approx(0.8, abs=0.1)
    assert object_shift(frames, ValidationRenders(views[:2], pictures[:2]), MASK) < 0.05
    assert np.isnan(object_shift(frames, ValidationRenders(views[:1], pictures[:1]), MASK))


def test_what_is_clipped_moves_nothing():
    pictures = np.stack([rendered(seed) for seed in range(2)])
    most = np.quantile(pictures[..., 1], 0.7)
    clipped = pictures[..., 1] > most
    clipped[1] = False
    radiance = np.where(clipped[..., None], most, pictures)
    frames = Frames(tuple("ab"), radiance, clipped, np.zeros_like(clipped), (0.0, 0.01))
    assert object_shift(frames, ValidationRenders((0, 1), pictures), MASK) < 0.02
