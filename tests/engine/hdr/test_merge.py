"""Brackets become radiance: merges worked out by hand, what is lost is marked, EXIF is not believed blindly."""

from pathlib import Path

import numpy as np
import pytest

from engine.errors import HdrError
from engine.hdr import exposures, merge
from engine.hdr.exposures import Exposure, SensorNoise
from engine.hdr.params import HdrParams
from engine.io.raw import Bracket, Facts, Mosaic
from engine.progress import Progress
from tests.engine import brackets_on_disk as disk

SHUTTER_S, HEIGHT, WIDTH = 0.15, 64, 96
TIMES = np.array([1.0, 8.0, 64.0])
FULL = 1000.0


def bayer(counts: list[list[float]]) -> Exposure:
    """A 2 x 2 cell of counts above black; saturated from 980 on."""
    cell = np.array(counts, np.float32)
    return Exposure(cell, cell < 0.98 * FULL, FULL)


def merged(folder: Path, scenes: list[np.ndarray], misstate: float = 1.0):
    brackets = [
        disk.write(folder, f"view{i}", scene, SHUTTER_S, i, misstate) for i, scene in enumerate(scenes)
    ]
    return merge.merge(brackets, HdrParams(), Progress())


def test_a_bayer_cell_of_three_exposures_worked_by_hand() -> None:
    # Without read noise a site is the sum of its unsaturated counts over the sum of their times.
    stack = [bayer([[2, 10], [15, 990]]), bayer([[16, 82], [990, 999]]), bayer([[130, 999], [999, 999]])]
    found = exposures.merge(stack, TIMES, SensorNoise(0.5, 0.0))
    expected = [[148 / 73, 92 / 9], [15 / 1, 990 / 1]]
    np.testing.assert_allclose(found.light, expected, rtol=1e-6)
    np.testing.assert_array_equal(found.clipped, [[False, False], [False, True]])


def test_read_noise_worked_by_hand() -> None:
    # Gain 1, read 3 counts. First guess 110/11 = 10 a unit; variances of count / time: (10 + 9) / 1 and
    # (100 + 9) / 100; so (4 / 19 + 10.6 / 1.09) / (1 / 19 + 1 / 1.09).
    stack = [bayer([[4, 4], [4, 4]]), bayer([[106, 106], [106, 106]])]
    found = exposures.merge(stack, np.array([1.0, 10.0]), SensorNoise(1.0, 3.0))
    np.testing.assert_allclose(found.light, (4 / 19 + 10.6 / 1.09) / (1 / 19 + 1 / 1.09), rtol=1e-6)
    assert found.floor == pytest.approx(3 / np.sqrt(101), rel=1e-12)


def test_every_colour_has_its_own_black_and_white() -> None:
    black, white = (100.0, 200.0, 300.0, 400.0), (1100.0, 2200.0, 3300.0, 4400.0)
    pattern = np.array([[0, 1], [3, 2]])
    counts = np.array([[600, 1200], [2400, 1800], [1079, 2159], [4319, 3239], [1081, 2161], [4321, 3241]])
    facts = Facts("none", 2, 6, 0.1, 100.0, 1.0, np.nan, 0)
    one = exposures.exposure(
        Mosaic(counts.astype(np.uint16), pattern, black, white, np.eye(3), facts), saturation=0.98
    )
    np.testing.assert_array_equal(one.counts[:2], [[500, 1000], [2000, 1500]])
    np.testing.assert_array_equal(one.unsaturated, [[True, True]] * 4 + [[False, False]] * 2)
    assert one.full == 2000


@pytest.mark.parametrize("level", [0.0003, 0.003, 0.03, 0.3])
def test_the_merge_is_as_precise_as_the_photons_allow(level: float) -> None:
    rng, side = np.random.default_rng(0), 300
    gain, read = 0.4, 1.5  # counts an electron, counts
    light = level * FULL / 8  # counts a unit of time: `level` fills that share of the middle exposure
    stack, used = [], []
    for time in TIMES:
        electrons = rng.poisson(np.full((side, side), light * time / gain))
        counts = (gain * electrons + rng.normal(0, read, electrons.shape)).astype(np.float32)
        stack.append(Exposure(counts, counts < 0.98 * FULL, FULL))
        used += [time] * bool((counts < 0.98 * FULL).all())
    found = exposures.merge(stack, TIMES, SensorNoise(gain, read)).light
    times = np.array(used)
    best = 1 / (times**2 / (gain * light * times + read**2)).sum()  # Cramer-Rao
    assert found.mean() == pytest.approx(light, abs=4 * np.sqrt(best) / side + 0.01 * light)
    assert 0.95 * best < found.var() < 1.1 * best


def test_radiance_comes_back_on_the_sessions_scale(tmp_path: Path) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, seed) for seed in range(3)]
    frames, report = merged(tmp_path, scenes)
    for radiance, scene in zip(frames.radiance, scenes, strict=True):
        expected = disk.in_session_scale(scene, SHUTTER_S)
        error = (radiance / expected - 1)[4:-4, 4:-4]
        assert abs(np.median(error)) < 0.01
        assert np.median(np.abs(error)) < 0.03
    assert report.suspect == ()
    assert not frames.clipped.any()
    assert [step.exif_ev for step in report.steps] == pytest.approx([3, 3], abs=0.02)


def test_the_stated_noise_is_the_noise(tmp_path: Path) -> None:
    grey = np.full((HEIGHT, WIDTH, 3), 0.1)  # below saturation in all three exposures
    frames, _ = merged(tmp_path, [grey + 0.1 * i for i in range(4)])
    shot, floor = frames.noise
    for radiance in frames.radiance:
        inner = radiance[8:-8, 8:-8]
        stated = shot * inner.mean() + floor**2
        # Where nothing has colour, filling in the colours averages noise away.
        assert 0.3 * stated < inner.var((0, 1)).mean() < 1.2 * stated


@pytest.mark.parametrize("misstate", [0.95, 1.05])
def test_an_exposure_that_exif_misstates_by_a_twentieth_is_fitted_from_the_pixels(
    tmp_path: Path, misstate: float
) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, seed) for seed in range(3)]
    frames, report = merged(tmp_path, scenes, misstate)
    step = report.steps[1]
    assert step.exif_ev - step.fitted_ev == pytest.approx(np.log2(misstate), abs=0.01)
    # Two of three exposures tell the truth, so the scale is theirs.
    expected = disk.in_session_scale(scenes[0], SHUTTER_S)
    assert np.median(frames.radiance[0] / expected) == pytest.approx(1, abs=0.01)


def test_an_exposure_that_exif_misstates_by_a_third_makes_the_views_suspect(tmp_path: Path) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, seed) for seed in range(3)]
    _, report = merged(tmp_path, scenes, 1.33)
    assert report.suspect == ("view0", "view1", "view2")


def test_a_lamp_beyond_every_exposure_is_marked_and_the_room_around_it_is_not_touched(tmp_path: Path) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, seed, lamp=1e5) for seed in range(3)]
    frames, report = merged(tmp_path, scenes)
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    away = np.hypot(row - HEIGHT // 3, column - WIDTH // 3)
    assert frames.clipped[:, away < 6].all()
    assert not frames.clipped[:, away > 11].any()
    assert report.share_clipped == pytest.approx(frames.clipped.mean())
    lamp = frames.radiance[:, away < 5]
    assert (lamp > 5).all()  # the shortest exposure is eight times shorter than the one that 1 fills
    rim = (away > 8) & ~frames.clipped.any(0) & (away < 14)
    for radiance, scene in zip(frames.radiance, scenes, strict=True):
        error = radiance[rim] / disk.in_session_scale(scene, SHUTTER_S)[rim] - 1
        assert abs(np.median(error)) < 0.02


def test_what_no_exposure_lifts_above_the_noise_is_dark(tmp_path: Path) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, seed) for seed in range(3)]
    for scene in scenes:
        scene[:, :32] = 0
    frames, report = merged(tmp_path, scenes)
    assert frames.dark[:, :, :28].mean() > 0.9
    assert not frames.dark[:, :, 36:].any()
    assert report.share_dark == pytest.approx(frames.dark.mean())


def test_a_view_that_is_clipped_in_every_exposure_is_refused(tmp_path: Path) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, 0), np.full((HEIGHT, WIDTH, 3), 1e5)]
    with pytest.raises(HdrError, match=r"view1: 100% of its sites are saturated .* shorter exposures"):
        merged(tmp_path, scenes)
    brackets = [disk.write(tmp_path, f"again{i}", scene, SHUTTER_S) for i, scene in enumerate(scenes)]
    frames, _ = merge.merge(brackets, HdrParams(), Progress(), left_out=("again1",))
    assert frames.names == ("again0", "again1")


def test_a_view_in_the_dark_is_refused(tmp_path: Path) -> None:
    scenes = [disk.scene(HEIGHT, WIDTH, 0), disk.scene(HEIGHT, WIDTH, 1), np.zeros((HEIGHT, WIDTH, 3))]
    for scene in scenes:
        scene[:, :48] *= 1e-3  # read noise is learnt where there is little else
    with pytest.raises(HdrError, match=r"view2: \d+% of its sites are below noise .*\(lens cap"):
        merged(tmp_path, scenes)


def test_a_bracket_that_lacks_an_exposure_is_named(tmp_path: Path) -> None:
    brackets = [disk.write(tmp_path, f"view{i}", disk.scene(HEIGHT, WIDTH, i), SHUTTER_S) for i in range(3)]
    brackets[1] = Bracket("view1", brackets[1].exposures[:2])
    with pytest.raises(HdrError, match="view1: has 2 exposures where the other views have 3"):
        merge.merge(brackets, HdrParams(), Progress())


def test_photographs_are_averaged_down_by_a_whole_factor(tmp_path: Path) -> None:
    brackets = [disk.write(tmp_path, f"view{i}", disk.scene(HEIGHT, WIDTH, i), SHUTTER_S) for i in range(2)]
    whole, _ = merge.merge(brackets, HdrParams(), Progress())
    small, report = merge.merge(brackets, HdrParams(long_edge_px=40), Progress())
    assert report.reduced_by == 3
    assert small.radiance.shape == (2, 21, 32, 3)
    block = whole.radiance[1, 30:33, 60:63].mean((0, 1))
    np.testing.assert_allclose(small.radiance[1, 10, 20], block, rtol=1e-5)


@pytest.mark.parametrize("long_edge_px", [40, 200])
def test_tiles_make_one_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, long_edge_px: int) -> None:
    shot = disk.write(tmp_path, "view0", disk.scene(HEIGHT, WIDTH, 0, lamp=1e5), SHUTTER_S)
    params = HdrParams(long_edge_px=long_edge_px)
    whole, _ = merge.merge([shot], params, Progress())
    monkeypatch.setattr(merge, "TILE_EDGE", 18)
    tiled, _ = merge.merge([shot], params, Progress())
    np.testing.assert_allclose(tiled.radiance, whole.radiance, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(tiled.clipped, whole.clipped)


def test_every_photograph_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shots = [disk.write(tmp_path, f"view{i}", disk.scene(HEIGHT, WIDTH, i), SHUTTER_S) for i in range(3)]
    decoded: list[Path] = []
    read = merge.read_mosaic
    monkeypatch.setattr(merge, "read_mosaic", lambda path: (decoded.append(path), read(path))[1])
    place = np.zeros((3, HEIGHT, WIDTH, 3), np.float32)
    frames, _ = merge.merge(
        shots, HdrParams(learning_views=2), Progress(), place=lambda shape: place.reshape(shape)
    )
    assert sorted(decoded) == sorted(path for shot in shots for path in shot.exposures)
    assert frames.radiance.base is place
