import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.hdr import exposures
from engine.hdr.exposures import Exposure, SensorNoise
from engine.io.raw import Facts, Mosaic
from hardware.virtual import sensor

CAMERA = sensor.Sensor()
FULL = float(CAMERA.white - CAMERA.black)
GAIN = CAMERA.counts_per_electron()
NOISE = SensorNoise(GAIN, CAMERA.read_electrons * GAIN)


def exposed(level: np.ndarray, times: list[float], seed: int) -> list[Exposure]:
    """Green sites of light `level` (shares of a full site per unit of time)."""
    rng = np.random.default_rng(seed)
    radiance = (
        np.repeat(level[..., None], 3, axis=-1) * CAMERA.full_electrons / CAMERA.electrons_per_radiance_s()
    )
    stack = []
    for time in times:
        # Only every second site of the Bayer cell is green: twice the size, then those sites.
        mosaic = sensor.expose(np.kron(radiance, np.ones((2, 2, 1))), time, CAMERA, rng)[0::2, 1::2]
        counts = mosaic.astype(np.float32) - CAMERA.black
        stack.append(Exposure(counts, counts < 0.98 * FULL, FULL))
    return stack


def test_two_clean_exposures_merge_to_the_sum_over_the_sum_worked_by_hand():
    # 100 counts in 1 s and 900 in 8 s without read noise: (100 + 900) / (1 + 8).
    both = [Exposure(np.full((1, 1), c, np.float32), np.ones((1, 1), bool), FULL) for c in (100, 900)]
    merged = exposures.merge(both, np.array([1.0, 8.0]), SensorNoise(GAIN, 0.0))
    assert merged.light[0, 0] == pytest.approx(1000 / 9, rel=1e-6)


def test_read_noise_trusts_the_long_exposure_more():
    both = [Exposure(np.full((1, 1), c, np.float32), np.ones((1, 1), bool), FULL) for c in (0, 80)]
    merged = exposures.merge(both, np.array([1.0, 8.0]), SensorNoise(1e-6, 5.0))
    # Inverse variance with equal read noise: weights 1 and 64 on 0 and 10.
    assert merged.light[0, 0] == pytest.approx(640 / 65, rel=1e-3)


@settings(max_examples=12, deadline=None)
@given(exponent=st.floats(-3.0, 0.8), seed=st.integers(0, 1000))
def test_the_merge_is_unbiased_and_as_precise_as_the_photons_allow(exponent, seed):
    level, times = 10.0**exponent, np.array([1 / 8, 1.0, 8.0])
    merged = exposures.merge(exposed(np.full((120, 120), level), times.tolist(), seed), times, NOISE)
    used = times[times * level < 0.95]
    if np.abs(times * level - 0.98).min() < 0.03:
        return  # at the edge of saturation noise decides which exposures count
    electrons = level * CAMERA.full_electrons * used.sum()
    best = np.sqrt(electrons + len(used) * CAMERA.read_electrons**2) / electrons
    error = merged.light / FULL / level - 1
    assert abs(error.mean()) < 5 * best / 120 + 5e-4
    assert error.std() < 1.1 * best + 1e-3


def test_sites_saturated_in_every_exposure_are_lower_bounds():
    times = np.array([1 / 8, 1.0, 8.0])
    merged = exposures.merge(exposed(np.full((20, 20), 20.0), times.tolist(), 0), times, NOISE)
    assert merged.clipped.all()
    assert (merged.light / FULL <= 20).all()
    assert (merged.light / FULL > 7).all()


@pytest.mark.parametrize("true_ratio", [2.0, 8.0, 11.3])
def test_the_ratio_is_read_from_the_pixels(true_ratio):
    level = np.random.default_rng(0).lognormal(-2.5, 1, (150, 150))
    short, long = exposed(level, [1.0, true_ratio], 1)
    assert exposures.ratio(short, long) == pytest.approx(true_ratio, rel=2e-3)


def test_things_that_move_between_exposures_do_not_move_the_ratio():
    level = np.random.default_rng(0).lognormal(-2.5, 1, (150, 150))
    moved = level.copy()
    moved[:50] = moved[:50, ::-1]
    short, _ = exposed(level, [1.0, 8.0], 1)
    _, long = exposed(moved, [1.0, 8.0], 2)
    assert exposures.ratio(short, long) == pytest.approx(8.0, rel=1e-2)


def test_a_ratio_that_no_pixel_can_tell_is_nan():
    short, long = exposed(np.full((40, 40), 5.0), [1.0, 8.0], 1)
    assert np.isnan(exposures.ratio(short, long))


def test_one_wrong_statement_among_three_does_not_move_the_scale():
    times = exposures.times(np.array([1.0, 8.0, 128.0]), np.array([8.0, 8.0]))
    np.testing.assert_allclose(times, [1.0, 8.0, 64.0])


def test_sensor_noise_is_learnt_from_brackets():
    level = np.minimum(np.random.default_rng(0).lognormal(-5, 2, (300, 300)), 0.9)
    pairs = [(*exposed(level / 8, [1.0, 8.0], seed), 8.0) for seed in range(4)]
    learnt = exposures.sensor_noise(pairs)
    assert learnt is not None
    assert learnt.gain == pytest.approx(GAIN, rel=0.05)
    assert learnt.read == pytest.approx(CAMERA.read_electrons * GAIN, rel=0.3)


def test_single_exposures_do_not_tell_the_noise():
    assert exposures.sensor_noise([]) is None


def test_a_sample_of_a_large_mosaic_has_whole_cells_from_all_over():
    facts = Facts("none", 2000, 1201, 0.1, 100.0, 1.0, np.nan, 0)
    y, x = np.mgrid[:1201, :2000]
    counts = (2 * (y % 2) + x % 2 + 4 * (y // 300)).astype(np.uint16)
    mosaic = Mosaic(counts, np.array([[0, 1], [3, 2]]), (0.0,) * 4, (99.0,) * 4, np.eye(3), facts)
    found = exposures.sampled(mosaic).counts
    assert 0.5 < found.size / exposures.SAMPLED_SITES < 2
    np.testing.assert_array_equal(found[:2, :4] % 4, [[0, 1, 0, 1], [2, 3, 2, 3]])
    assert set(np.unique(found // 4)) == {0, 1, 2, 3}
