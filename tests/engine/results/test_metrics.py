"""Scores against values worked out by hand, and the truth loader's refusals."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.errors import TruthError
from engine.io.ground_truth import Truth, read_truth
from engine.results.metrics import (
    angle_between,
    evaluate,
    evaluate_mask,
    evaluate_poses,
    normal_coverage,
    sparsification_error,
)
from engine.types import Camera, Poses, Surface


def flat_truth(height: int = 4, width: int = 5) -> Truth:
    """A plate that faces the camera, tilted in depth so that it has relief; albedo 0.5, roughness 0.4."""
    shape = (height, width)
    depth = np.ones(shape) + 0.1 * np.arange(width)
    return Truth(
        normal=np.tile([0.0, 0.0, -1.0], (*shape, 1)),
        albedo=np.full((*shape, 3), 0.5),
        roughness=np.full(shape, 0.4),
        depth=depth,
        mask=np.ones(shape, bool),
    )


def surface_like(truth: Truth, **changes) -> Surface:
    shape = truth.mask.shape
    values = {
        "mask": truth.mask.copy(),
        "normal": truth.normal.copy(),
        "albedo": truth.albedo.copy(),
        "roughness": truth.roughness.copy(),
        "depth": truth.depth.copy(),
        "stderr_normal": np.full(shape, np.radians(1.0)),
        "stderr_albedo": np.full(shape, 0.01),
        "stderr_roughness": np.full(shape, 0.01),
        "residual": np.zeros(shape),
        "flags": np.zeros(shape, np.uint8),
    }
    return Surface(**{**values, **changes})


def tilted(deg: float) -> list[float]:
    return [math.sin(math.radians(deg)), 0.0, -math.cos(math.radians(deg))]


def test_a_perfect_surface_scores_perfectly():
    truth = flat_truth()
    score = evaluate(surface_like(truth), truth)
    assert score.normal_mean_deg == 0
    assert score.normal_mean_charged_deg == 0
    assert score.albedo_psnr_db == math.inf
    assert score.roughness_mae == 0
    assert score.depth_relative_median == pytest.approx(0, abs=1e-12)
    assert (score.coverage, score.iou, score.unanswered_pixels, score.extra_pixels) == (1, 1, 0, 0)
    assert score.as_dict()["albedo_psnr_db"] is None
    json.dumps(score.as_dict(), allow_nan=False)


def test_normal_errors_are_angles_in_degrees():
    truth = flat_truth(1, 4)
    normal = np.array([[tilted(d) for d in (0, 2, 4, 10)]])
    score = evaluate(surface_like(truth, normal=normal), truth)
    assert score.normal_mean_deg == pytest.approx(4.0)
    assert score.normal_median_deg == pytest.approx(3.0)
    # 1 deg of standard error: only the 0 lies within 1.73 of it.
    assert score.normal_in_band == 0.25


def test_of_normals_that_err_as_they_state_the_band_holds_95_percent():
    rng = np.random.default_rng(0)
    truth = flat_truth(200, 200)
    aside = np.radians(2.0) * rng.normal(size=(200, 200, 2)) / np.sqrt(2)
    normal = np.concatenate([np.tan(aside), -np.ones((200, 200, 1))], 2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    stated = np.full((200, 200), np.radians(2.0))
    surface = replace(surface_like(truth, normal=normal), stderr_normal=stated)
    assert evaluate(surface, truth).normal_in_band == pytest.approx(0.95, abs=0.005)


def test_angles_of_a_millionth_of_a_radian_survive():
    angle = angle_between(np.array([[1e-6, 0, 1.0]]), np.array([[0, 0, 1.0]]))
    assert angle[0] == pytest.approx(1e-6, rel=1e-6)


def test_albedo_psnr_is_that_of_the_mean_squared_error_and_matching_takes_out_one_factor():
    truth = flat_truth()
    score = evaluate(surface_like(truth, albedo=truth.albedo + 0.1), truth)
    assert score.albedo_psnr_db == pytest.approx(20.0)  # mse 0.01
    assert score.albedo_match == pytest.approx(0.5 / 0.6)
    assert score.albedo_psnr_matched_db > 200
    one_channel = truth.albedo.copy()
    one_channel[..., 0] += 0.1
    score = evaluate(surface_like(truth, albedo=one_channel), truth)
    assert score.albedo_psnr_db == pytest.approx(10 * math.log10(300))  # mse 0.01 / 3


def test_depth_is_compared_after_one_factor():
    truth = flat_truth(1, 5)
    depth = truth.depth / 2.0
    depth[0, 0] *= 1.2
    score = evaluate(surface_like(truth, depth=depth), truth)
    assert score.depth_scale == pytest.approx(2.0)
    assert score.depth_relative_median == pytest.approx(0.0, abs=1e-12)
    depth = truth.depth * [[1.0, 0.9, 1.0, 1.1, 1.1]]
    score = evaluate(surface_like(truth, depth=depth), truth)
    assert score.depth_relative_median == pytest.approx(0.1)


def test_roughness_is_mean_absolute():
    truth = flat_truth(1, 2)
    score = evaluate(surface_like(truth, roughness=np.array([[0.5, 0.1]])), truth)
    assert score.roughness_mae == pytest.approx(0.2)


def test_leaving_out_a_bad_pixel_cannot_improve_the_charged_score():
    truth = flat_truth(1, 4)
    normal = np.array([[tilted(d) for d in (0, 0, 0, 80)]])
    albedo = truth.albedo.copy()
    albedo[0, 3] = 0.9
    rough = truth.roughness.copy()
    rough[0, 3] = 0.9
    honest = evaluate(surface_like(truth, normal=normal, albedo=albedo, roughness=rough), truth)
    mask = np.array([[True, True, True, False]])
    coy = evaluate(surface_like(truth, mask=mask, normal=normal, albedo=albedo, roughness=rough), truth)
    assert coy.normal_mean_deg < honest.normal_mean_deg
    assert coy.unanswered_pixels == 1
    assert coy.coverage == 0.75
    assert coy.iou == 0.75
    assert coy.normal_mean_charged_deg == pytest.approx(22.5)
    assert coy.normal_mean_charged_deg > honest.normal_mean_charged_deg
    assert coy.albedo_psnr_charged_db == pytest.approx(10 * math.log10(16))  # mse 0.25 / 4
    assert coy.albedo_psnr_charged_db < honest.albedo_psnr_charged_db
    assert coy.roughness_mae_charged == pytest.approx(0.15)  # worse end of 0.4 is 0.6 away
    assert coy.roughness_mae_charged > honest.roughness_mae_charged


def test_a_truth_of_another_size_or_place_is_refused():
    truth = flat_truth()
    with pytest.raises(TruthError, match="5 x 4 pixels, the result 6 x 4"):
        evaluate(surface_like(flat_truth(4, 6)), truth)
    with pytest.raises(TruthError, match="none of the truth's pixels"):
        evaluate(surface_like(truth, mask=np.zeros((4, 5), bool)), truth)


def ring(count: int) -> np.ndarray:
    """Cameras on a circle of radius 1 that look along their tangent."""
    a = 2 * np.pi * np.arange(count) / count
    rotation = np.stack([[[np.cos(t), 0, -np.sin(t)], [0, 1, 0], [np.sin(t), 0, np.cos(t)]] for t in a])
    centre = np.stack([np.cos(a), 0.1 * np.cos(3 * a), np.sin(a)], -1)
    return np.concatenate([rotation, -(rotation @ centre[..., None])], -1)


def poses_of(cam_from_world: np.ndarray) -> Poses:
    camera = Camera(8, 6, 10.0, 10.0, 4.0, 3.0)
    known = np.isfinite(cam_from_world).all((1, 2))
    return Poses(camera, cam_from_world, known, np.zeros((0, 3)), "given", math.nan)


def in_another_world(cam_from_world: np.ndarray, scale: float) -> np.ndarray:
    """The same views in a world turned by 40 deg about z, shifted and scaled."""
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    rotation = cam_from_world[:, :, :3] @ turn
    shift = np.array([3.0, -2.0, 5.0])
    return np.concatenate([rotation, scale * cam_from_world[:, :, 3:] + rotation @ shift[:, None]], -1)


def test_poses_in_another_world_at_another_scale_have_no_error():
    true = ring(12)
    score = evaluate_poses(poses_of(in_another_world(true, 0.25)), true)
    assert score.rotation_max_deg < 1e-6
    assert score.position_max_percent < 1e-6
    assert score.scale == pytest.approx(4.0)
    assert score.registered_share == 1


def test_one_turned_view_and_one_lost_view_are_told():
    true = ring(12)
    estimate = in_another_world(true, 1.0)
    c, s = math.cos(math.radians(1.0)), math.sin(math.radians(1.0))
    centre = -estimate[0, :, :3].T @ estimate[0, :, 3]
    estimate[0, :, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ estimate[0, :, :3]
    estimate[0, :, 3] = -estimate[0, :, :3] @ centre
    estimate[5] = np.nan
    score = evaluate_poses(poses_of(estimate), true)
    assert (score.views, score.registered) == (12, 11)
    assert score.rotation_max_deg == pytest.approx(10 / 11, rel=0.02)  # the mean turn takes up a share
    assert score.position_max_percent < 1e-6


def test_position_error_is_a_share_of_the_paths_extent():
    true = ring(200)
    estimate = true.copy()
    centre = -estimate[0, :, :3].T @ estimate[0, :, 3] + [0.02, 0, 0]  # radial: 1 % of the diameter 2
    estimate[0, :, 3] = -estimate[0, :, :3] @ centre
    score = evaluate_poses(poses_of(estimate), true)
    assert score.extent == pytest.approx(2.0, rel=0.01)
    assert score.position_max_percent == pytest.approx(1.0, rel=0.05)
    assert score.position_median_percent < 0.02


def test_poses_of_another_capture_are_refused():
    with pytest.raises(TruthError, match="12 poses, the session 10"):
        evaluate_poses(poses_of(ring(10)), ring(12))
    lost = np.full((12, 3, 4), np.nan)
    with pytest.raises(TruthError, match="only 0 views"):
        evaluate_poses(poses_of(lost), ring(12))


def test_a_mask_one_pixel_too_large_is_one_pixel_off():
    true = np.zeros((60, 80), bool)
    true[20:40, 20:60] = True
    grown = np.zeros_like(true)
    grown[19:41, 19:61] = True
    score = evaluate_mask(grown, true)
    assert score.iou == pytest.approx(800 / 924)
    assert score.boundary_mean_px == pytest.approx(1.0, abs=0.02)
    assert evaluate_mask(true, true).boundary_mean_px == 0
    with pytest.raises(TruthError, match="without outline"):
        evaluate_mask(np.zeros((60, 80), bool), true)
    with pytest.raises(TruthError, match="80 x 60"):
        evaluate_mask(np.zeros((6, 8), bool), true)


def saved(tmp_path: Path, **changes) -> Path:
    truth = flat_truth()
    data = {key: getattr(truth, key) for key in ("normal", "albedo", "roughness", "depth", "mask")}
    data |= changes
    np.savez(tmp_path / "truth.npz", **{k: v for k, v in data.items() if v is not None})
    return tmp_path


def test_a_truth_is_read_from_a_folder_or_a_file_with_poses_and_camera(tmp_path):
    camera = '{"width": 5, "height": 4, "fx": 9.0, "fy": 9.0, "cx": 2.5, "cy": 2.0, "k1": 0.1}'
    folder = saved(tmp_path, cam_from_world=ring(3), camera=camera)
    for path in (folder, folder / "truth.npz"):
        truth = read_truth(path)
        assert truth.camera == Camera(5, 4, 9.0, 9.0, 2.5, 2.0, 0.1)
        assert truth.cam_from_world is not None
        assert truth.cam_from_world.shape == (3, 3, 4)
        assert truth.mask.dtype == bool


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"roughness": None, "depth": None}, "lacks roughness, depth"),
        ({"albedo": np.zeros((4, 4, 3))}, r"albedo has shape \(4, 4, 3\)"),
        ({"mask": np.zeros((4, 5), bool)}, "mask is empty"),
        ({"depth": np.zeros((4, 5))}, "depth is not positive"),
        ({"roughness": np.full((4, 5), np.nan)}, "roughness holds NaN"),
        ({"normal": np.full((4, 5, 3), 0.1)}, "unit length"),
        ({"normal": np.tile([0.0, 0.0, 1.0], (4, 5, 1))}, "look away from the camera"),
        ({"cam_from_world": np.zeros((3, 4, 4))}, "views x 3 x 4"),
        ({"camera": "[1]"}, "not a JSON object"),
    ],
)
def test_a_truth_that_cannot_be_one_is_refused_by_name(tmp_path, changes, says):
    with pytest.raises(TruthError, match=says):
        read_truth(saved(tmp_path, **changes))


def test_a_missing_or_broken_file_is_told(tmp_path):
    with pytest.raises(TruthError, match="no such file"):
        read_truth(tmp_path)
    (tmp_path / "truth.npz").write_bytes(b"PK\x03\x04 not really")
    with pytest.raises(TruthError, match="not a readable"):
        read_truth(tmp_path)


def test_coverage_and_sparsification_of_errors_that_are_as_stated():
    rng = np.random.default_rng(0)
    stderr = rng.uniform(0.5, 3, 200_000)
    error = np.hypot(*(rng.normal(size=(2, len(stderr))) * stderr / np.sqrt(2)))
    for level in (0.5, 0.68, 0.9, 0.95):
        assert abs(normal_coverage(error, stderr, level) - level) < 0.005
    assert sparsification_error(error, error) == 0
    random = sparsification_error(error, rng.permutation(stderr))
    assert 0 < sparsification_error(error, stderr) < 0.7 * random
