from pathlib import Path

import cv2
import numpy as np
import pytest

from engine.capture_checks import shot_preview
from tests.engine.brackets_on_disk import CAMERA, scene, write


def seen(
    tmp_path: Path, width: int, height: int, shutter_s: float = 0.03, lamp: float = 0.0
) -> shot_preview.ShotPreview:
    bracket = write(tmp_path, "a", scene(height, width, 4, lamp), shutter_s)
    mosaics = shot_preview.read(bracket.exposures)
    return shot_preview.preview("a", mosaics, shot_preview.learn(mosaics))


@pytest.mark.parametrize(("width", "height", "pitch"), [(400, 300, 1), (960, 640, 2), (2600, 60, 4)])
def test_light_is_the_scene_at_every_size(tmp_path, width, height, pitch):
    now = seen(tmp_path, width, height)
    expected = scene(height, width, 4) @ CAMERA.camera_from_rec709()[1]
    expected *= CAMERA.electrons_per_radiance_s() / CAMERA.full_electrons

    per_s = now.fine / 64  # light is per unit of exposure, which at f/8 is 64 s
    assert now.pitch == pitch
    assert max(now.fine.shape) <= shot_preview.FINE_EDGE_PX
    assert max(now.small.shape) <= 1.5 * shot_preview.SMALL_EDGE_PX
    block = cv2.resize(expected, now.fine.shape[::-1], interpolation=cv2.INTER_AREA)
    assert np.median(np.abs(per_s / block - 1)) < 0.02


def test_files_are_sorted_by_exposure(tmp_path):
    bracket = write(tmp_path, "a", scene(60, 80, 1), 0.03)
    mosaics = shot_preview.read(bracket.exposures[::-1])
    times = [mosaic.facts.shutter_s for mosaic in mosaics]
    assert times == sorted(times)


@pytest.mark.parametrize(("width", "height"), [(400, 300), (960, 640)])
def test_what_no_exposure_holds_is_clipped_and_nothing_else(tmp_path, width, height):
    now = seen(tmp_path, width, height, lamp=1e5)
    true = np.pi * 7**2 / (width * height)  # a disc of 7 sites
    assert now.share_clipped == pytest.approx(true, rel=0.4)
    assert now.clipped.mean() == pytest.approx(true, rel=0.4)
    assert true < now.fine_clipped.mean() < 2.5 * true
    assert seen(tmp_path, width, height).share_clipped == 0


def test_noise_is_what_the_picture_shows(tmp_path):
    flat = np.full((640, 960, 3), 0.5)
    bracket = write(tmp_path, "flat", flat, 0.03)
    mosaics = shot_preview.read(bracket.exposures)
    # A flat picture tells no noise: it is learnt from another one.
    other = shot_preview.read(write(tmp_path, "other", scene(640, 960, 4), 0.03).exposures)
    now = shot_preview.preview("flat", mosaics, shot_preview.learn(other))
    shot, floor = now.noise
    assert now.fine.var() == pytest.approx(shot * now.fine.mean() + floor**2, rel=0.3)


def test_a_dark_picture_is_dark(tmp_path):
    assert seen(tmp_path, 400, 300, shutter_s=8e-6).share_dark > 0.9
    assert seen(tmp_path, 400, 300).share_dark == 0
