from pathlib import Path

import cv2
import numpy as np
import pytest

from engine.color import rec709_from
from engine.errors import HdrError
from engine.hdr.linear_input import check_values, noise

PATH = Path("a.exr")
REC2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)


def room(spread=0.01, level=0.5):
    grey = level + spread * np.random.default_rng(0).standard_normal((48, 64, 3))
    return grey.astype(np.float32)


def test_a_picture_without_negative_values_has_none():
    assert check_values(PATH, room()) == 0


def test_colours_outside_rec709_are_light_and_counted():
    picture = room()
    picture[5:8, 5:8] = rec709_from(REC2020) @ (0.02, 1.5, 0.05)
    assert check_values(PATH, picture) == 3 * 3 * 2


def test_a_value_of_no_weight_is_counted():
    picture = room()
    picture[0, 0, 0] = -1e-6
    assert check_values(PATH, picture) == 1


@pytest.mark.parametrize("filter_", [cv2.INTER_CUBIC, cv2.INTER_LANCZOS4])
@pytest.mark.parametrize("size", [(32, 24), (128, 96)])
def test_undershoots_beside_a_lamp_are_no_fault(filter_, size):
    picture = room()
    picture[20:24, 30:34] = 300
    assert check_values(PATH, cv2.resize(picture, size, interpolation=filter_)) > 0


def test_noise_about_zero_is_no_fault_in_a_dark_room():
    picture = room(level=0.0)
    picture[10:20, 10:20] += 1
    assert check_values(PATH, picture) > 3000


@pytest.mark.parametrize("shift", [0.3, 2.0])
def test_light_below_zero_is_refused(shift):
    picture = room()
    picture[:, 32:] -= 0.5 + shift
    with pytest.raises(
        HdrError, match=r"a\.exr: 4608 of 9216 values are negative, the first at x 32, y 0, in R"
    ):
        check_values(PATH, picture)


def test_normals_are_no_light():
    y, x = np.mgrid[-1:1:48j, -1:1:64j]
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1).astype(np.float32)
    with pytest.raises(HdrError, match="negative"):
        check_values(PATH, normals)


def test_noise_of_values_about_zero_is_finite_and_right():
    shot, floor = noise(room(level=0.0)[None])
    assert 0 <= shot < 0.01
    assert floor == pytest.approx(0.01, rel=0.2)
