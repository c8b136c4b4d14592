"""What a session shows in space: places, sizes and units."""

from pathlib import Path

import numpy as np
import pytest

from app.viewer import scene as scenes
from app.viewer.reading import Results
from app.viewer.scene import compose, load
from engine.geometry import inverse, transform
from engine.types import Gaussians, Poses
from tests.app.viewer import made


def whole(side: int = 24, views: int = 5, scale: str = "rig", emitters: int = 400) -> scenes.Scene:
    return compose(
        "/s",
        Results(
            tuple(map(str, range(views))), made.poses(views, side, scale), made.gaussians(emitters),
            made.lamps(), made.surface(side),
        ),
    )  # fmt: skip


def test_a_session_is_loaded_and_says_what_it_does(tmp_path: Path) -> None:
    said: list[str] = []
    scene = load(made.session(tmp_path / "s"), said.append)
    assert said
    contents = scene.contents
    assert (contents.emitters, contents.lamps, contents.points, contents.missing) == (400, 1, 64, ())
    assert contents.surfaces == ("shaded", "albedo", "normals", "roughness", "confidence")
    assert contents.folder == str(tmp_path / "s")


@pytest.mark.parametrize(("scale", "unit"), [("rig", "m"), ("board", "m"), ("given", ""), ("unknown", "")])
def test_metres_only_where_the_scale_is_known(scale: str, unit: str) -> None:
    assert whole(scale=scale).contents.unit == unit


def test_up_is_the_cameras_own_up() -> None:
    np.testing.assert_allclose(whole().contents.up, (0, -1, 0), atol=1e-9)


def test_the_front_is_level_and_where_most_cameras_look() -> None:
    poses = made.poses(8, 24)
    tilted = Poses(
        poses.camera, poses.cam_from_world[:3], poses.registered[:3], poses.points, "rig", 0.5
    )  # they look within 90 degrees of one another
    contents = compose("/s", Results(("a", "b", "c"), tilted, None, None, None)).contents
    up, front = np.array(contents.up), np.array(contents.front)
    assert up @ front == pytest.approx(0, abs=1e-9)
    ahead = tilted.cam_from_world[:, 2, :3].mean(0)
    assert front @ ahead / np.linalg.norm(ahead) > 0.99


def test_the_object_stands_in_front_of_the_chosen_camera() -> None:
    scene = whole()
    middle = np.array([0.0, 0.0, made.DEPTH])
    poses = made.poses(5, 24)
    for view in (0, 2):
        place = transform(scene.world_from_cam(view), middle)
        np.testing.assert_allclose(place, transform(inverse(poses.cam_from_world[view]), middle))
    np.testing.assert_allclose(scene.world_from_cam(4), scene.world_from_cam(0))  # not registered
    assert scene.contents.object_depth == pytest.approx(made.DEPTH, rel=0.3)


def test_views_that_are_not_registered_have_no_pose() -> None:
    poses = whole().contents.poses
    assert [len(pose) for pose in poses] == [12, 12, 12, 12, 0]
    np.testing.assert_allclose(np.reshape(poses[1], (3, 4)), made.poses(5, 24).cam_from_world[1])


def test_the_room_holds_nearly_all_emitters_and_no_strays() -> None:
    gaussians = made.gaussians(1000)
    means = np.array(gaussians.means)
    means[0] = 1e6
    stray = Gaussians(means, gaussians.quaternions, gaussians.scales, gaussians.density, gaussians.radiance)
    contents = compose("/s", Results((), None, stray, None, None)).contents
    assert contents.room_radius == pytest.approx(made.ROOM * 3**0.5, rel=0.1)
    assert np.linalg.norm(contents.room) < 0.3


def test_the_brightest_emitters_come_first() -> None:
    scene = whole(emitters=1000)
    assert scene.emitters is not None
    first = scene.emitters.radiance[:20].mean(1)
    np.testing.assert_allclose(first, 20.0, rtol=1e-3)  # the windows
    assert (scene.emitters.radiance[100:].mean(1) < 1).all()
    assert scene.white == pytest.approx(0.47, rel=0.1)  # bright walls, not windows


def test_emitters_keep_their_shape_in_their_new_order() -> None:
    gaussians = made.gaussians(50)
    scene = compose("/s", Results((), None, gaussians, None, None))
    assert scene.emitters is not None
    for k in (0, 7, 49):
        (old,) = np.nonzero((gaussians.means == scene.emitters.gaussians.means[k]).all(1))
        np.testing.assert_allclose(scene.emitters.axes[k], np.diag(gaussians.scales[old[0]]), rtol=1e-6)


def test_a_large_surface_has_a_coarse_mesh_of_the_same_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes, "MOVING_TRIANGLES", 500)
    full, coarse = whole(side=48).sheets
    assert len(full.triangles) > 3000
    assert len(coarse.triangles) < 700
    for row, column in ((12, 12), (24, 36)):
        (a,), (b,) = (np.nonzero((sheet.pixels == (row, column)).all(1))[0] for sheet in (full, coarse))
        np.testing.assert_allclose(full.points[a], coarse.points[b], rtol=1e-6)
        np.testing.assert_allclose(full.normals[a], coarse.normals[b])


def test_an_enormous_surface_is_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes, "MOST_TRIANGLES", 900)
    assert len(whole(side=48).sheets[0].triangles) < 900


def test_nothing_at_all_is_a_scene_too() -> None:
    contents = compose("/s", Results((), None, None, None, None)).contents
    assert contents.missing == ("poses", "light", "surface")
    assert contents.radius > 0
    assert contents.room_radius > 0


def test_a_surface_without_poses_is_not_shown() -> None:
    scene = compose("/s", Results((), None, None, None, made.surface(24)))
    assert (scene.sheets, scene.contents.surfaces) == ((), ())
