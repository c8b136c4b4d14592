"""Promises of `engine.sfm.reconstruct`, on a small room ray cast in numpy."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest

from engine.errors import Cancelled, PoseError
from engine.geometry import inverse, transform
from engine.progress import Progress
from engine.sfm import mapping, reconstruct
from engine.sfm.features import chosen
from engine.sfm.params import FeatureParams, PoseParams
from engine.sfm.reconstruct import find_poses, moved
from engine.sfm.rig_alignment import RigLog, angle_between, mean_rotation
from engine.types import Camera, Frames, Masks
from tests.engine import box_room

CAMERA = Camera(320, 240, 250.0, 250.0, 160.0, 120.0, k1=-0.04)
VIEWS, HELD = 16, 32
# Small pictures of a well textured room do not need enlarging.
PARAMS = PoseParams(features=FeatureParams(maximum=1000, enlarge_most=1))
GEOMETRY = {
    "pan_axis": [0.0, -1.0, 0.0],
    "pan_point": [0.0, 0.0, 0.5],
    "tilt_axis": [1.0, 0.0, 0.0],
    "tilt_point": [0.0, 0.0, 0.5],
}


def as_frames(radiance: np.ndarray) -> tuple[Frames, Masks]:
    """Photographs with an object: a dark disc that stays in the middle of every view, with its own texture."""
    n, h, w = radiance.shape[:3]
    v, u = np.mgrid[:h, :w]
    disc = (u - w / 2) ** 2 + (v - h / 2) ** 2 < (0.18 * w) ** 2
    radiance = radiance.copy()
    radiance[:, disc] = np.random.default_rng(1).uniform(0.01, 0.05, (int(disc.sum()), 3))
    none = np.zeros((n, h, w), bool)
    frames = Frames(tuple(f"v{i:02d}" for i in range(n)), radiance, none, none, (0.0, 0.0))
    return frames, Masks(disc, np.broadcast_to(~disc, none.shape).copy())


@pytest.fixture(scope="module")
def turned() -> tuple[Frames, Masks, np.ndarray]:
    """Views held by hand: nodding, rolling and far apart enough to fix the focal length."""
    truth = box_room.handheld(HELD, reach=0.6)
    return *as_frames(box_room.render(CAMERA, truth)), truth


@pytest.fixture(scope="module")
def matched(tmp_path_factory) -> Path:
    """Where the database lies, with features and matches and as yet without models, once `found` has been asked for."""
    return tmp_path_factory.mktemp("matched") / "features.db"


@contextmanager
def keeping(folder: Path) -> Iterator[None]:
    """Poses that are found meanwhile leave there their database as matched, and their latest model."""
    match, grow = mapping.match, mapping.grow

    def kept(database: Path, *args) -> None:
        match(database, *args)
        shutil.copytree(database.parent, folder, dirs_exist_ok=True)

    def kept_too(*args):
        model, sizes = grow(*args)
        model.write_binary(str(folder))
        return model, sizes

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping, "match", kept)
        patch.setattr(mapping, "grow", kept_too)
        yield


@pytest.fixture(scope="module")
def found(turned, matched, tmp_path_factory):
    frames, masks, _ = turned
    with keeping(matched.parent):
        return find_poses(frames, masks, None, PARAMS, tmp_path_factory.mktemp("sfm"), Progress())


def match_as_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Features and matches are those of poses that were found `keeping(folder)`."""

    def there(frames, masks, guess, params, workdir: Path, progress) -> Path:
        shutil.copytree(folder, workdir, dirs_exist_ok=True)
        mapping._begin_with(workdir / "features.db", guess.params, guess.has_prior_focal_length)
        return workdir / "features.db"

    monkeypatch.setattr(reconstruct, "detect", there)
    monkeypatch.setattr(mapping, "match", lambda *_: None)


@pytest.fixture
def already_matched(found, matched, monkeypatch: pytest.MonkeyPatch) -> None:
    """Photographs whose features and matches are known: what is tried are the models grown from them."""
    match_as_in(matched.parent, monkeypatch)


@pytest.fixture
def already_grown(already_matched, matched, monkeypatch: pytest.MonkeyPatch) -> None:
    """One model as well, whatever it is to grow from: what is tried is which of them are asked for and kept."""
    model = pycolmap.Reconstruction
    monkeypatch.setattr(mapping, "grow", lambda *_: (model(str(matched.parent)), (HELD,)))


def errors(cam_from_world: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Per view: angle in degrees and distance as a share of the path, after a similarity alignment."""
    world, true = inverse(cam_from_world), inverse(truth)
    rotation = mean_rotation(true[:, :, :3] @ np.swapaxes(world[:, :, :3], 1, 2))
    angles = np.degrees(angle_between(rotation @ world[:, :, :3], true[:, :, :3]))
    a, b = world[:, :, 3] @ rotation.T, true[:, :, 3]
    a, b = a - a.mean(0), b - b.mean(0)
    scale = (a * b).sum() / (a * a).sum()
    return angles, np.linalg.norm(scale * a - b, axis=1) / np.linalg.norm(np.ptp(b, axis=0))


def test_every_view_is_placed_where_it_was(turned, found) -> None:
    poses, report = found
    assert poses.registered.all()
    assert (report.placed, report.unregistered, report.from_rig) == (HELD, (), ())
    angles, distances = errors(poses.cam_from_world, turned[2])
    assert np.median(angles) < 0.1
    assert np.median(distances) < 0.005
    assert poses.reprojection_px < 0.3
    assert poses.camera.fx == pytest.approx(CAMERA.fx, rel=0.005)
    assert poses.camera.k1 == pytest.approx(CAMERA.k1, abs=0.02)


def test_without_a_known_length_the_unit_is_the_distance_to_the_room(found) -> None:
    poses, report = found
    assert poses.scale == "unknown"
    assert report.scale_stderr is None
    assert "median distance" in report.scale_note
    centres = inverse(poses.cam_from_world)[:, :, 3]
    np.testing.assert_allclose(centres.mean(0), 0, atol=1e-9)
    assert np.median(np.linalg.norm(poses.points, axis=1)) == pytest.approx(1)
    assert inverse(poses.cam_from_world)[:, 1, 1].mean() > 0.9  # y points down


def test_moving_the_world_moves_no_projection() -> None:
    rng = np.random.default_rng(0)
    poses = box_room.handheld(4)
    points = rng.normal(size=(6, 3))
    new_from_world = box_room.look(0.4, -0.2, 1.0, rng.normal(size=3))
    new_poses, new_points = moved(poses, points, 2.5, new_from_world)
    for pose, new_pose in zip(poses, new_poses, strict=True):
        np.testing.assert_allclose(transform(new_pose, new_points), 2.5 * transform(pose, points), atol=1e-12)


def rig_log(pan_deg: np.ndarray) -> RigLog:
    return RigLog("turntable", pan_deg, np.zeros(len(pan_deg)), GEOMETRY)


def tilted_turntable() -> np.ndarray:
    """The same turntable as `GEOMETRY` describes, level: its world is the first camera's frame."""
    pan = np.arange(VIEWS) * 2 * np.pi / VIEWS
    return np.stack([box_room.look(p, 0.0, 0.0, box_room.on_arm(p, 0.5)) for p in pan])


@pytest.fixture(scope="module")
def rigged(tmp_path_factory):
    """A level turntable with one view of a blank wall, and a log of its angles."""
    truth = tilted_turntable()
    radiance = box_room.render(CAMERA, truth)
    radiance[5] = 0.2
    frames, masks = as_frames(radiance)
    # `look` turns the world about y by its yaw, so the camera turns about -y, the rig's axis, by the same.
    pan = np.arange(VIEWS) * 360.0 / VIEWS + np.random.default_rng(2).normal(size=VIEWS) * 0.02
    return frames, masks, truth, rig_log(pan)


@pytest.fixture(scope="module")
def rig_found(rigged, tmp_path_factory):
    """What is found with the log, and where its matches are kept."""
    frames, masks, _, log = rigged
    folder = tmp_path_factory.mktemp("rig matched")
    with keeping(folder):
        return find_poses(frames, masks, log, PARAMS, tmp_path_factory.mktemp("rig"), Progress()), folder


def test_a_logged_rig_gives_metres_and_places_the_blank_view(rigged, rig_found) -> None:
    truth, (poses, report) = rigged[2], rig_found[0]
    assert poses.scale == "rig"
    assert report.from_rig == ("v05",)
    assert poses.registered.all()
    path = np.ptp(inverse(poses.cam_from_world)[:, :, 3], axis=0)
    np.testing.assert_allclose(path, np.ptp(inverse(truth)[:, :, 3], axis=0), atol=0.0075)
    assert report.rig_rotation_deg == pytest.approx(0, abs=0.2)
    assert not report.rig_doubtful
    angles, distances = errors(poses.cam_from_world, truth)
    assert angles[5] < 0.2
    assert distances.mean() < 0.0025


def test_a_log_that_contradicts_the_photographs_is_not_used(
    rigged, rig_found, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, masks, _, log = rigged
    match_as_in(rig_found[1], monkeypatch)
    poses, report = find_poses(frames, masks, rig_log(-log.pan_deg * 0.9), PARAMS, tmp_path, Progress())
    assert poses.scale == "unknown"
    assert "was not used" in report.scale_note
    assert report.rig_doubtful
    assert report.unregistered == ("v05",)
    assert not poses.registered[5]
    assert np.isnan(poses.cam_from_world[5]).all()


def test_views_without_texture_are_an_error_that_counts_them(turned, tmp_path: Path) -> None:
    frames, masks, _ = turned
    blank = Frames(
        frames.names, np.full_like(frames.radiance, 0.1), frames.clipped, frames.dark, frames.noise
    )
    with pytest.raises(PoseError, match=r"none of 32 views could be placed.*--poses"):
        find_poses(blank, masks, None, PARAMS, tmp_path, Progress())


@pytest.mark.usefixtures("already_matched")
def test_a_stop_is_heard_while_views_are_placed(turned, tmp_path: Path) -> None:
    frames, masks, _ = turned
    notes: list[str] = []
    progress = Progress(lambda _, note: notes.append(note), lambda: bool(notes) and "placing" in notes[-1])
    with pytest.raises(Cancelled):
        find_poses(frames, masks, None, PARAMS, tmp_path, progress)


def test_a_repeated_run_gives_the_same_bits(rigged, rig_found, tmp_path: Path) -> None:
    frames, masks, _, log = rigged
    again, report = find_poses(frames, masks, log, PARAMS, tmp_path, Progress())
    poses, told = rig_found[0]
    assert again.cam_from_world.tobytes() == poses.cam_from_world.tobytes()
    assert again.points.tobytes() == poses.points.tobytes()
    assert again.camera == poses.camera
    assert report == told


@pytest.mark.usefixtures("already_matched")
def test_a_model_that_its_matches_contradict_is_grown_again_from_its_lens(
    turned, found, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, masks, truth = turned
    grow, lenses = mapping.grow, []

    def unlucky_once(database: Path, *args):
        with pycolmap.Database.open(database) as opened:
            camera = opened.read_all_cameras()[0]
        lenses.append((camera.params[0], camera.has_prior_focal_length))
        model, sizes = grow(database, *args)
        if len(lenses) == 1:  # half of the views a little off: it still holds together
            for image in list(model.images.values())[::2]:
                turn = pycolmap.Rotation3d(np.array([0.0, np.radians(2), 0.0]))
                off = pycolmap.Rigid3d(turn, np.zeros(3)) * image.cam_from_world()
                model.frame(image.frame_id).set_cam_from_world(image.camera_id, off)
        return model, sizes

    monkeypatch.setattr(mapping, "grow", unlucky_once)
    poses, report = find_poses(frames, masks, None, PARAMS, tmp_path, Progress())
    assert (report.attempts, found[1].attempts) == (2, 1)
    assert report.agreement > 0.97
    angles, _ = errors(poses.cam_from_world, truth)
    assert np.median(angles) < 0.1
    assert lenses[0] == (pytest.approx(250, rel=0.1), True)  # by pairs of views, that know of no distortion
    assert lenses[1] == (pytest.approx(250, rel=0.02), True)


def sliding(monkeypatch: pytest.MonkeyPatch, *shares: float) -> list[float]:
    """Each model's focal length becomes a share of what it is, as a path can slide along with its lens; the list
    fills with the focal lengths that models start from."""
    grow, starts = mapping.grow, []

    def slid(database: Path, *args):
        with pycolmap.Database.open(database) as opened:
            starts.append(opened.read_all_cameras()[0].params[0])
        model, sizes = grow(database, *args)
        model.cameras[1].params = model.cameras[1].params * np.array([shares[len(starts) - 1], 1, 1, 1])
        model.update_point_3d_errors()
        return model, sizes

    monkeypatch.setattr(mapping, "grow", slid)
    monkeypatch.setattr(mapping, "AGREED", 0.0)  # matches tell nothing
    return starts


@pytest.mark.usefixtures("already_matched")
def test_a_lens_that_slid_off_is_grown_again_held_straight_and_then_from_the_other_side(
    turned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, masks, truth = turned
    held, run = [], mapping._place_each

    def noted(database: Path, folder: Path, options, *args):
        held.append(not options.ba_refine_extra_params)
        return run(database, folder, options, *args)

    monkeypatch.setattr(mapping, "_place_each", noted)
    starts = sliding(monkeypatch, 0.8, 0.8, 1.0)
    poses, report = find_poses(frames, masks, None, PARAMS, tmp_path, Progress())
    assert (report.attempts, report.lens_doubtful) == (3, False)
    assert starts == pytest.approx([starts[0], starts[0], 1.3 * starts[0]])
    assert held == [True, False]  # the first placed all at once
    assert poses.camera.fx == pytest.approx(250, rel=0.01)
    angles, _ = errors(poses.cam_from_world, truth)
    assert np.median(angles) < 0.1


@pytest.mark.usefixtures("already_matched")
def test_a_lens_held_straight_while_views_are_placed_bends_in_the_end(
    turned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, masks, truth = turned
    starts = sliding(monkeypatch, 0.8, 1.0)
    poses, report = find_poses(frames, masks, None, PARAMS, tmp_path, Progress())
    assert (report.attempts, report.lens_doubtful, len(starts)) == (2, False, 2)
    assert poses.camera.fx == pytest.approx(250, rel=0.01)
    assert poses.camera.k1 == pytest.approx(CAMERA.k1, abs=0.02)
    angles, _ = errors(poses.cam_from_world, truth)
    assert np.median(angles) < 0.1


@pytest.mark.usefixtures("already_grown")
@pytest.mark.parametrize(("last", "doubtful"), [(1.2, True), (1.6, False)])
def test_a_lens_that_every_attempt_finds_elsewhere_is_doubtful_where_points_fit_another_as_well(
    turned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: float, doubtful: bool
) -> None:
    frames, masks, _ = turned
    sliding(monkeypatch, 0.8, 0.8, last)
    _, report = find_poses(frames, masks, None, replace(PARAMS, trusted_share=0.0), tmp_path, Progress())
    assert report.lens_doubtful == doubtful


def stretched(cam_from_world: np.ndarray, by: float) -> np.ndarray:
    """The same cameras on a path that is longer along z."""
    world = inverse(cam_from_world)
    world[:, 2, 3] *= by
    return inverse(world)


def grown_beside_a_log(
    monkeypatch: pytest.MonkeyPatch, workdir: Path, database: Path, logged: np.ndarray, *stretches: float
) -> tuple[mapping.Grown, list[mapping.Mapper]]:
    """What is kept of models whose path is stretched, and how they were grown; matches tell nothing."""
    grow, held = mapping.grow, []

    def bent(database: Path, factor, params, seed, progress, mapper):
        held.append(mapper)
        model, sizes = grow(database, factor, params, seed, progress, mapper)
        places = stretched(mapping.placed(model, HELD), stretches[len(held) - 1])
        for image in model.images.values():
            pose = pycolmap.Rigid3d(places[int(image.name[1:].split(".")[0])])
            model.frame(image.frame_id).set_cam_from_world(image.camera_id, pose)
        return model, sizes

    monkeypatch.setattr(mapping, "grow", bent)
    monkeypatch.setattr(mapping, "AGREED", 0.0)
    copied = Path(shutil.copytree(database.parent, workdir / "copy")) / database.name
    kept = mapping.best_grown(copied, 1, HELD, 250.0, logged, PARAMS.mapping, 0, Progress())
    assert kept is not None
    return kept, held


@pytest.mark.usefixtures("already_grown")
def test_a_path_that_the_rig_did_not_log_is_found_again_held_straight(
    turned, matched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept, held = grown_beside_a_log(monkeypatch, tmp_path, matched, turned[2], 1.5, 1.0)
    assert held == ["global", "straight"]
    assert kept.log_off < mapping.LOG_OFF / 2
    assert errors(mapping.placed(kept.model, HELD), turned[2])[1].max() < 0.01


@pytest.mark.usefixtures("already_grown")
def test_a_path_that_two_models_agree_on_outweighs_the_log(
    turned, matched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept, held = grown_beside_a_log(monkeypatch, tmp_path, matched, stretched(turned[2], 1.5), 1.0, 1.0)
    assert held == ["global", "straight"]
    assert kept.log_off > mapping.LOG_OFF
    assert errors(mapping.placed(kept.model, HELD), turned[2])[1].max() < 0.01


@pytest.mark.usefixtures("already_grown")
@pytest.mark.parametrize(
    ("shares", "doubtful"), [((1.0, 1.0), False), ((0.8, 1.0, 1.0), False), ((0.8, 1.2, 0.8), True)]
)
def test_a_lens_that_nothing_is_known_of_is_found_twice(
    turned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shares: tuple[float, ...], doubtful: bool
) -> None:
    frames, masks, _ = turned
    starts = sliding(monkeypatch, *shares)
    monkeypatch.setattr(mapping, "calibrate", lambda *_: None)
    poses, report = find_poses(frames, masks, None, replace(PARAMS, trusted_share=0.0), tmp_path, Progress())
    assert len(starts) == len(shares)
    assert report.focal_expected_px is None
    assert doubtful or poses.camera.fx == pytest.approx(250, rel=0.01)
    assert report.lens_doubtful == doubtful


@pytest.mark.usefixtures("already_grown")
def test_poses_that_all_contradict_their_matches_are_an_error(
    turned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, masks, _ = turned
    sliding(monkeypatch, 0.5, 0.5, 0.5)
    with pytest.raises(PoseError, match=f"no pose of {HELD} views agrees"):
        find_poses(frames, masks, None, PARAMS, tmp_path, Progress())


@pytest.mark.usefixtures("found")
@pytest.mark.parametrize(
    ("ends", "implied"), [((250, 400, 251, 250), 250), ((250, 0, 0, 250), 250), ((100, 200, 300, 0), None)]
)
def test_pairs_imply_the_focal_length_at_which_most_beginnings_end(
    matched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: tuple[int, ...], implied: int | None
) -> None:
    database = Path(shutil.copy(matched, tmp_path))
    begun = []

    def stuck(trial: Path, options) -> bool:
        with pycolmap.Database.open(trial) as opened:
            camera = opened.read_all_cameras()[0]
        assert not camera.has_prior_focal_length
        begun.append(camera.params[0])
        end = float(ends[len(begun) - 1])
        mapping._begin_with(trial, (end, *camera.params[1:]))
        return end > 0

    monkeypatch.setattr(pycolmap, "calibrate_view_graph", stuck)
    assert mapping.calibrate(database, 0) == implied
    assert len(set(begun)) == 4


@pytest.mark.usefixtures("already_matched")
def test_an_expected_focal_length_that_no_attempt_ends_at_was_wrong(turned, tmp_path: Path) -> None:
    frames, masks, _ = turned
    poses, report = find_poses(frames, masks, None, replace(PARAMS, focal_px=330.0), tmp_path, Progress())
    assert not report.lens_doubtful
    assert (report.focal_expected_px, poses.camera.fx) == (330, pytest.approx(250, rel=0.01))


def test_pairs_hold_neighbours_in_time_and_in_looks() -> None:
    votes = np.zeros((8, 8), int)
    votes[0, 6] = votes[6, 0] = 9
    pairs = chosen(votes, 1)
    assert (0, 6) in pairs
    assert {(i, i + 1) for i in range(7)} | {(i, i + 2) for i in range(6)} <= set(pairs)
    assert all(i < j for i, j in pairs)
    assert len(set(pairs)) == len(pairs)


def test_marker_free_rotation_helpers_agree_with_opencv() -> None:
    turn = cv2.Rodrigues(np.array([0.1, -0.2, 0.3]))[0]
    assert angle_between(np.eye(3), turn) == pytest.approx(np.linalg.norm([0.1, -0.2, 0.3]))
