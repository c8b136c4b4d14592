import datetime

import numpy as np
import pytest

from hardware.errors import StudioError
from hardware.virtual import sensor

CAMERA = sensor.Sensor()


def flat(level: float, h: int = 200, w: int = 200) -> np.ndarray:
    return np.full((h, w, 3), level)


def filling(share: float, shutter_s: float = 1.0) -> float:
    """Radiance of white that fills this share of a green site."""
    return share * CAMERA.full_electrons / CAMERA.electrons_per_radiance_s() / shutter_s


def green(mosaic: np.ndarray) -> np.ndarray:
    return mosaic[0::2, 1::2].astype(float) - CAMERA.black


def test_mean_is_linear_and_variance_is_shot_plus_read_noise():
    rng = np.random.default_rng(1)
    for share in (0.0, 0.001, 0.1, 0.8):
        values = green(sensor.expose(flat(filling(share)), 1.0, CAMERA, rng)) / CAMERA.counts_per_electron()
        electrons = share * CAMERA.full_electrons
        assert values.mean() == pytest.approx(electrons, abs=4 * np.sqrt((electrons + 13) / values.size))
        rounding = 1 / 12 / CAMERA.counts_per_electron() ** 2
        assert values.var() == pytest.approx(electrons + CAMERA.read_electrons**2 + rounding, rel=0.05)


def test_a_full_site_reads_white_and_no_more():
    mosaic = sensor.expose(flat(filling(50.0)), 1.0, CAMERA, np.random.default_rng(0))
    assert (mosaic == CAMERA.white).all()


def test_white_reads_as_the_neutral_that_the_file_states():
    mosaic = (
        sensor.expose(flat(filling(0.5)), 1.0, CAMERA, np.random.default_rng(0)).astype(float) - CAMERA.black
    )
    red, blue = mosaic[0::2, 0::2].mean(), mosaic[1::2, 1::2].mean()
    assert (
        red / green(mosaic + CAMERA.black).mean(),
        blue / green(mosaic + CAMERA.black).mean(),
    ) == pytest.approx((CAMERA.neutral()[0], CAMERA.neutral()[2]), rel=2e-3)


def test_no_rec709_colour_gives_negative_electrons():
    assert (CAMERA.camera_from_rec709() > 0).all()


def test_the_meter_leaves_headroom_for_all_but_lamps():
    rng = np.random.default_rng(0)
    room = rng.lognormal(0, 0.5, (4, 60, 80, 3))
    room[:, :4, :4] = 300.0
    shutter_s = sensor.meter(room, CAMERA)
    shortest, middle, longest = sensor.bracket(room[0], shutter_s, CAMERA, datetime.datetime(2024, 1, 1), rng)
    assert 0.01 < (middle.mosaic == CAMERA.white).mean() + 0.01 < 0.05
    assert (shortest.mosaic == CAMERA.white).mean() <= 16 / 4800
    assert np.median(longest.mosaic) > CAMERA.black + 0.3 * (CAMERA.white - CAMERA.black)
    assert longest.shutter_s / shortest.shutter_s == pytest.approx(64)
    assert shortest.time < middle.time < longest.time


def test_vignetting_darkens_corners_only_when_asked():
    dim = sensor.Sensor(vignetting=0.4)
    image = sensor.expose(flat(filling(0.5)), 1.0, dim, np.random.default_rng(0)).astype(float) - dim.black
    assert image[:4, :4].mean() / image[98:102, 98:102].mean() == pytest.approx(0.6, rel=0.05)


def test_impossible_radiance_is_refused():
    bad = flat(1.0)
    bad[0, 0, 0] = np.nan
    bad[1, 1, 1] = -1
    with pytest.raises(StudioError, match="2 of 120000"):
        sensor.expose(bad, 1.0, CAMERA, np.random.default_rng(0))


def test_a_black_room_cannot_be_metered():
    with pytest.raises(StudioError, match="black"):
        sensor.meter(np.zeros((1, 8, 8, 3)), CAMERA)


def test_the_same_seed_takes_the_same_photograph():
    first, second = (
        sensor.expose(flat(filling(0.3)), 1.0, CAMERA, np.random.default_rng(5)) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)
