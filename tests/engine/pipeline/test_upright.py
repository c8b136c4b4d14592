"""What leaves a session stands upright: exports of photographs taken on the side are those of the sensor's, turned."""

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import trimesh
from PIL import Image

from engine.io import session as sessions
from engine.io.poses.pose_files import read_poses
from engine.light.fitting.lamp_model import with_lamps
from engine.orientation import back, rotation, turn_picture, turn_vectors, turned
from engine.pipeline import artifacts, stage_functions, stage_table, stages
from engine.pipeline.settings import Settings
from engine.pipeline.stages import Work
from engine.progress import Progress
from engine.results.params import ExportParams
from engine.types import Emitters, Lamps
from tests.app import furnace

PLACES = {"hdr": "hhhh", "segment": "ssss", "poses": "pppp", "surface": "aaaa"}
YUP = np.diag([1.0, -1.0, -1.0])
TURNS = pytest.mark.parametrize("flip", [3, 5, 6])


def exported(folder: Path, flip: int) -> Path:
    """An export of the furnace's ball under a ceiling that is brighter than the rest, of photographs held so."""
    finished = furnace.finished(folder / "finished")
    gaussians, _ = furnace.room()
    gaussians.radiance[gaussians.means[:, 1] < -0.7 * furnace.ROOM] *= 6
    lamp = Lamps(np.array([[0, 0, 2.5]]), np.array([0.1]), np.full((1, 3), 9.0), np.array([True]))
    emitters = Emitters(with_lamps(gaussians, lamp), lamp, 0)
    artifacts.save(finished / "stages" / "surface" / "aaaa", "emitters", emitters)
    frames = furnace.photographs(furnace.surface())
    frames.radiance[:, :5, :7] *= 3  # a corner that tells how a picture lies
    artifacts.save(finished / "stages" / "hdr" / "hhhh", "frames", frames)
    session = sessions.create(folder / "session", "linear", {"width": 40, "height": 30, "orientation": flip})
    to = folder / "export"
    to.mkdir()

    def load(stage: str, name: str, kind: type):
        return artifacts.load(finished / "stages" / stage / PLACES[stage], name, kind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage_functions, "PANORAMA_ROWS", 64)
        stage_functions.export(Work(session, ExportParams(), 0, "cpu", to, False, load, Progress()))
    return to


@pytest.fixture(scope="module")
def as_sensor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory.mktemp("sensor"), 0)


@pytest.fixture(scope="module", params=[3, 5, 6])
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Path]:
    return request.param, exported(tmp_path_factory.mktemp("upright"), request.param)


def channels(path: Path) -> dict[str, np.ndarray]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def test_every_map_is_the_sensors_turned_and_its_normals_with_it(
    as_sensor: Path, pair: tuple[int, Path]
) -> None:
    flip, upright = pair
    before, after = channels(as_sensor / "maps.exr"), channels(upright / "maps.exr")
    normals = [np.stack([maps[f"normal.{axis}"] for axis in "XYZ"], -1) for maps in (before, after)]
    np.testing.assert_allclose(normals[1], turn_vectors(turn_picture(normals[0], flip), flip), atol=1e-6)
    for name in before.keys() - {"normal.X", "normal.Y", "normal.Z"}:
        np.testing.assert_array_equal(after[name], turn_picture(before[name], flip), err_msg=name)


def test_every_picture_stands_upright(as_sensor: Path, pair: tuple[int, Path]) -> None:
    flip, upright = pair
    for path in sorted(as_sensor.glob("*.png")):
        if path.name in ("normal.png", "normal_16.png", "coverage.png"):
            continue
        before, after = (
            cv2.imread(str(place / path.name), cv2.IMREAD_UNCHANGED) for place in (as_sensor, upright)
        )
        np.testing.assert_array_equal(after, turn_picture(before, flip), err_msg=path.name)
    normal = np.asarray(Image.open(upright / "normal.png"), float) / 127.5 - 1
    maps = channels(upright / "maps.exr")
    inside = maps["mask.Y"] > 0
    np.testing.assert_allclose(normal[inside][:, 0], maps["normal.X"][inside], atol=0.02)
    np.testing.assert_allclose(normal[inside][:, 1], -maps["normal.Y"][inside], atol=0.02)


@pytest.mark.parametrize("name", ["surface.ply", "surface.glb"])
def test_a_mesh_is_turned_about_the_viewing_axis(as_sensor: Path, pair: tuple[int, Path], name: str) -> None:
    flip, upright = pair
    before, after = (trimesh.load(str(place / name), force="mesh").vertices for place in (as_sensor, upright))
    expected = np.array(before) @ (YUP @ rotation(flip) @ YUP).T
    for made, one in ((expected, np.array(after)), (np.array(after), expected)):
        away = np.linalg.norm(made[:, None] - one[None], axis=-1).min(1)
        assert np.quantile(away, 0.98) < 1e-5


def test_camera_and_poses_are_those_of_the_upright_pictures(pair: tuple[int, Path]) -> None:
    flip, upright = pair
    expected = turned(furnace.poses(), flip)
    names = [f"view{i:02d}" for i in range(furnace.VIEWS)]
    for path in (upright / "transforms.json", upright / "colmap"):
        read = read_poses(path, names, (expected.camera.width, expected.camera.height))
        np.testing.assert_allclose(read.cam_from_world, expected.cam_from_world, atol=1e-6)
        assert (read.camera.cx, read.camera.cy) == pytest.approx((expected.camera.cx, expected.camera.cy))
    index = json.loads((upright / "export.json").read_text())
    assert (index["camera"]["width"], index["camera"]["height"]) == (
        expected.camera.width,
        expected.camera.height,
    )


def test_the_panorama_is_of_the_upright_camera(as_sensor: Path, pair: tuple[int, Path]) -> None:
    """The ceiling is over the sensor: it comes to lie below, left or right in the upright camera's frame."""
    flip, upright = pair
    towards = rotation(flip) @ [0, -1, 0]
    for place, way in ((as_sensor, np.array([0, -1.0, 0])), (upright, towards)):
        green = channels(place / "light.exr")["G"]
        rows, columns = green.shape
        row = min(int(np.arccos(np.clip(-way[1], -1, 1)) / np.pi * rows), rows - 1)
        column = int((np.arctan2(way[0], way[2]) / (2 * np.pi) + 0.5) * columns) % columns
        assert green[row, column] > 4 * np.median(green)


def test_light_and_lamps_stay_in_the_world(as_sensor: Path, pair: tuple[int, Path]) -> None:
    for name in ("light.ply", "lamps.json"):
        assert (as_sensor / name).read_bytes() == (pair[1] / name).read_bytes()


def fingerprints(folder: Path, **facts: int) -> dict[str, str]:
    session = sessions.create(folder, "raw", {"model": "none", "width": 4, "height": 4, **facts})
    return {
        step.stage.name: step.fingerprint for step in stages.plan(session, stage_table.stages(), Settings())
    }


def test_only_what_uses_the_orientation_is_computed_anew_for_it(tmp_path: Path) -> None:
    plain, level, side = (
        fingerprints(tmp_path / name, **facts)
        for name, facts in (("a", {}), ("b", {"orientation": 0}), ("c", {"orientation": 6}))
    )
    assert plain == level
    assert {name for name in plain if plain[name] != side[name]} == {"surface", "export"}


@TURNS
def test_maps_to_start_from_are_of_the_upright_picture(tmp_path: Path, flip: int) -> None:
    from engine.io import initial_maps

    shape = furnace.surface()
    seen = turned(shape, flip)
    np.savez(tmp_path / "maps.npz", normal=seen.normal, roughness=seen.roughness, albedo=seen.albedo)
    read = initial_maps.read(tmp_path / "maps.npz", None, "opencv", shape.mask, True, flip)
    np.testing.assert_allclose(read.normals, shape.normal[shape.mask], atol=1e-6)
    np.testing.assert_allclose(read.roughness, shape.roughness[shape.mask], atol=1e-6)
    np.testing.assert_allclose(read.albedo, shape.albedo[shape.mask], atol=1e-6)
    assert back(back(flip)) == flip
